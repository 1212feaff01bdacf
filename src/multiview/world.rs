//! What is up in a calibration's axes.

use glam::{DQuat, DVec3};

use crate::camera::View;
use crate::message::{World, WorldState};

/// Cameras hang level enough on average: the cosine of up and the calibration's axis that is meant by it.
const LEVEL: f64 = 0.8;
/// The same of cameras that all look down steeply from one side, where more speaks for the axis.
const STEEP: f64 = 0.5;
/// How far the horizontal of a picture may lean from that of the world: the sine of 10 degrees.
const ROLLED: f64 = 0.17;
/// Pictures in portrait tell no up: length of the mean of all cameras' ups.
const AGREED: f64 = 0.5;

/// What turns the calibration's axes so that y points up: its axis nearest to the cameras' mean up; where none is near,
/// the one on which all of them look down, their pictures upright; else the mean up itself. The origin stays where it
/// is, as a calibration's origin lies on the floor. No world where cameras do not agree.
pub fn world(views: &[View]) -> World {
    let up = -views.iter().map(|v| v.rotation.row(1)).sum::<DVec3>() / views.len().max(1) as f64;
    if up.length().is_nan() || up.length() < AGREED {
        return World::default();
    }
    let up = axis(views, up.normalize()).unwrap_or_else(|| up.normalize());
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

/// The calibration's axis that is meant by the cameras' mean up.
fn axis(views: &[View], up: DVec3) -> Option<DVec3> {
    let nearest = |least: f64, may: &dyn Fn(DVec3) -> bool| {
        let axes = DVec3::AXES.into_iter().flat_map(|a| [a, -a]);
        let near = axes.filter(|a| a.dot(up) > least && may(*a));
        near.max_by(|a, b| a.dot(up).total_cmp(&b.dot(up)))
    };
    // Of an axis of any other calibration hardly ever all pictures are upright.
    let looked_down_on = |axis: DVec3| {
        views.iter().all(|v| {
            let [across, _, ahead] = [0, 1, 2].map(|row| v.rotation.row(row).dot(axis));
            across.abs() < ROLLED && ahead < 0.0
        })
    };
    nearest(LEVEL, &|_| true).or_else(|| nearest(STEEP, &looked_down_on))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec2};

    /// A camera that looks along `forward` and down a little, in a world with this axis up.
    fn view(up: DVec3, forward: DVec3) -> View {
        looking_down(0.3, up, forward)
    }

    /// The same, down by this share of what it looks ahead.
    fn looking_down(down: f64, up: DVec3, forward: DVec3) -> View {
        let z = (forward - down * up).normalize();
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
        // Up to 50 degrees down from one side, or from two beside each other.
        for (down, forward) in [
            (0.84, [DVec3::Y; 2]),
            (1.19, [DVec3::Y; 2]),
            (0.84, [DVec3::new(0.6, 0.8, 0.0); 2]),
            (1.19, [DVec3::X, DVec3::Y]),
        ] {
            let up = DVec3::Z;
            let world = world(&forward.map(|f| looking_down(down, up, f)));
            let turned = world.direction(up.as_vec3().to_array());
            assert!(
                (turned[1] - 1.0).abs() < 1e-5,
                "{down}, {forward:?}: {turned:?}"
            );
        }
        // Axes that mean nothing, as of a board on a stand: pictures lean in all of them.
        let any = DMat3::from_rotation_x(1.0) * DMat3::from_rotation_z(0.6);
        let leaning = [DVec3::X, DVec3::Y].map(|forward| {
            let mut leaning = view(DVec3::Z, forward);
            leaning.rotation *= any.transpose();
            leaning
        });
        let told = world(&leaning);
        let turned = told.direction((any * DVec3::Z).as_vec3().to_array());
        assert!(turned[1] > 0.95, "{turned:?}");
        // Two cameras on their sides, each on another one.
        let lying = [DVec3::X, DVec3::NEG_X].map(|up| view(up, DVec3::Z));
        assert!(!world(&lying).is_known());
    }
}
