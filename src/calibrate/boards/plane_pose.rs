//! A board before one camera with a known lens: its corners go in, where it is comes out.

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::adjust::{Camera, Free, Scene, Seen, adjust};
use super::homography::homography;
use super::lens::Lens;
use super::placement::Placement;
use crate::calibrate::pose::Pose;

/// Where a board with these corners (places in metres, pixels) is in the camera's axes, and the root mean square of how
/// far its corners are off, pixels. A small board far away looks nearly the same from two sides: both are tried.
pub fn placed(lens: &Lens, corners: &[(DVec2, DVec2)], sigma: f64) -> Option<(Placement, f64)> {
    let on_plane: Vec<(DVec2, DVec2)> = corners
        .iter()
        .map(|(place, pixel)| (*place, lens.plane(*pixel)))
        .collect();
    let first = by_map(&homography(&on_plane)?, corners)?;
    let middle = corners.iter().map(|c| c.0).sum::<DVec2>() / corners.len() as f64;
    let seen: Vec<Seen> = corners
        .iter()
        .map(|(place, pixel)| Seen {
            camera: 0,
            board: 0,
            place: *place,
            pixel: *pixel,
        })
        .collect();
    let refined = [first, mirrored(first, middle)].into_iter().map(|start| {
        let camera = Camera {
            lens: *lens,
            pose: Pose::ORIGIN,
        };
        let mut scene = Scene {
            cameras: vec![camera],
            boards: vec![start],
        };
        adjust(&mut scene, &[Free::NOTHING], &seen, sigma);
        let squares: f64 = seen.iter().map(|s| scene.off(s).length_squared()).sum();
        (scene.boards[0], (squares / seen.len() as f64).sqrt())
    });
    refined
        .filter(|(_, rms)| rms.is_finite())
        .min_by(|a, b| a.1.total_cmp(&b.1))
}

/// The placement that a map from the board to the plane z = 1 means.
fn by_map(h: &DMat3, corners: &[(DVec2, DVec2)]) -> Option<Placement> {
    let size = (h.x_axis.length() + h.y_axis.length()) / 2.0;
    let depth = |place: &DVec2| (*h * place.extend(1.0)).z;
    let ahead: f64 = corners.iter().map(|(place, _)| depth(place)).sum();
    let h = *h * (ahead.signum() / size);
    // The rotation nearest to two axes that are only nearly perpendicular.
    let between = (h.x_axis.normalize() + h.y_axis.normalize()).normalize();
    let normal = h.x_axis.cross(h.y_axis).normalize();
    let across = normal.cross(between);
    let x = (between - across) * std::f64::consts::FRAC_1_SQRT_2;
    let y = (between + across) * std::f64::consts::FRAC_1_SQRT_2;
    let found = Placement {
        rotation: DMat3::from_cols(x, y, normal),
        position: h.z_axis,
    };
    (found.rotation.is_finite() && found.position.is_finite()).then_some(found)
}

/// The same board with its normal on the other side of the line of sight.
fn mirrored(board: Placement, middle: DVec2) -> Placement {
    let at = board.point(middle);
    let sight = at.normalize();
    let normal = board.rotation * DVec3::Z;
    let other = 2.0 * normal.dot(sight) * sight - normal;
    let rotation = DMat3::from_quat(DQuat::from_rotation_arc(normal, other)) * board.rotation;
    Placement {
        rotation,
        position: at - rotation * middle.extend(0.0),
    }
}
