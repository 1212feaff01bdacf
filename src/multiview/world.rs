//! What is up in a calibration's axes.

use glam::{DQuat, DVec3};

use crate::camera::View;
use crate::message::{World, WorldState};

/// Cameras hang level enough on average: the cosine of up and the calibration's axis that is meant by it.
const LEVEL: f64 = 0.8;
/// Pictures in portrait tell no up: length of the mean of all cameras' ups.
const AGREED: f64 = 0.5;

/// What turns the calibration's axes so that y points up: its axis nearest to the cameras' mean up, which is up itself
/// where none is near. The origin stays where it is, as a calibration's origin lies on the floor. No world where
/// cameras do not agree.
pub fn world(views: &[View]) -> World {
    let up = -views.iter().map(|v| v.rotation.row(1)).sum::<DVec3>() / views.len().max(1) as f64;
    if up.length().is_nan() || up.length() < AGREED {
        return World::default();
    }
    let up = up.normalize();
    let axes = DVec3::AXES.into_iter().flat_map(|a| [a, -a]);
    let (up, _) = axes.fold((up, LEVEL), |(best, level), axis| {
        let cosine = axis.dot(up);
        if cosine > level {
            (axis, cosine)
        } else {
            (best, level)
        }
    });
    let turn = if up.y < -0.999 {
        // Half a turn about any level axis does: the one that camera axes take.
        DQuat::from_rotation_x(std::f64::consts::PI)
    } else {
        DQuat::from_rotation_arc(up, DVec3::Y)
    };
    World {
        rotation: turn.as_quat().to_array(),
        translation: [0.0; 3],
        state: WorldState::GIVEN,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec2};

    /// A camera that looks along `forward` and down a little, in a world with this axis up.
    fn view(up: DVec3, forward: DVec3) -> View {
        let z = (forward - 0.3 * up).normalize();
        let x = z.cross(up).normalize();
        View {
            name: String::new(),
            size: [640, 480],
            focal: DVec2::splat(500.0),
            centre: DVec2::new(319.5, 239.5),
            distortion: Default::default(),
            rotation: DMat3::from_cols(x, z.cross(x), z).transpose(),
            position: 2.0 * up,
        }
    }

    #[test]
    fn what_is_up_in_the_calibration_is_up_in_the_world() {
        for (up, a, b) in [
            (DVec3::Y, DVec3::X, DVec3::Z),
            (DVec3::NEG_Y, DVec3::X, DVec3::NEG_Z),
            (DVec3::Z, DVec3::Y, DVec3::X),
        ] {
            let world = world(&[view(up, a), view(up, b)]);
            assert!(world.is_known());
            let turned = world.direction(up.as_vec3().to_array());
            assert!((turned[1] - 1.0).abs() < 1e-5, "{up}: {turned:?}");
        }
        // Two cameras on their sides, each on another one.
        let lying = [DVec3::X, DVec3::NEG_X].map(|up| view(up, DVec3::Z));
        assert!(!world(&lying).is_known());
    }
}
