//! In: a body frame. Out: its bodies in the floor-aligned world, where y is up and the floor is y = 0.

use crate::joints::BODY_JOINTS;
use crate::message::{Body, BodyFrame, World, WorldState};

/// A body in the floor-aligned world: x to the camera's right, y up, z towards the viewer, metres, origin on the floor
/// below the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorldBody {
    /// Pelvis, metres.
    pub position: [f32; 3],
    /// Rotation of the pelvis from the skeleton's rest axes to world axes, xyzw; upright and facing the camera:
    /// identity.
    pub orientation: [f32; 4],
    /// Pelvis velocity, metres per second.
    pub velocity: [f32; 3],
    /// Joints, metres.
    pub joints3d: [[f32; 3]; BODY_JOINTS],
}

impl World {
    /// Whether there is a world: a floor is known or has been found.
    pub fn is_known(&self) -> bool {
        self.state == WorldState::ESTIMATED || self.state == WorldState::GIVEN
    }

    /// A direction or velocity given in camera axes.
    pub fn direction(&self, v: [f32; 3]) -> [f32; 3] {
        let [x, y, z, w] = self.rotation;
        let q = [x, y, z];
        // v + 2 q × (q × v + w v)
        let inner = cross(q, v);
        let inner: [f32; 3] = std::array::from_fn(|i| inner[i] + w * v[i]);
        let outer = cross(q, inner);
        std::array::from_fn(|i| v[i] + 2.0 * outer[i])
    }

    /// A camera-space point, metres.
    pub fn point(&self, p: [f32; 3]) -> [f32; 3] {
        let turned = self.direction(p);
        std::array::from_fn(|i| turned[i] + self.translation[i])
    }

    /// An orientation given in camera axes, xyzw.
    pub fn orientation(&self, q: [f32; 4]) -> [f32; 4] {
        let [ax, ay, az, aw] = self.rotation;
        let [bx, by, bz, bw] = q;
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ]
    }
}

impl BodyFrame {
    /// A body of this frame in the floor-aligned world; `None` while there is no floor.
    pub fn in_world(&self, body: &Body) -> Option<WorldBody> {
        let world = &self.world;
        world.is_known().then(|| WorldBody {
            position: world.point(body.position),
            orientation: world.orientation(body.orientation),
            velocity: world.direction(body.velocity),
            joints3d: body.joints3d.map(|p| world.point(p)),
        })
    }
}

fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(a: &[f32], b: &[f32]) {
        assert!(
            a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5),
            "{a:?} is not {b:?}"
        );
    }

    #[test]
    fn a_level_camera_two_metres_up() {
        // Half a turn about x: what is down becomes up, what is in front lies towards −z.
        let mut frame = BodyFrame::default();
        let mut body = Body {
            position: [0.5, 1.0, 4.0],
            orientation: [1.0, 0.0, 0.0, 0.0],
            velocity: [0.1, 0.2, 0.3],
            ..Body::default()
        };
        body.joints3d[3] = [0.0, 2.0, 3.0];
        assert_eq!(frame.in_world(&body), None);
        frame.world = World {
            rotation: [1.0, 0.0, 0.0, 0.0],
            translation: [0.0, 2.0, 0.0],
            state: WorldState::GIVEN,
        };
        let there = frame.in_world(&body).unwrap();
        near(&there.position, &[0.5, 1.0, -4.0]);
        near(&there.velocity, &[0.1, -0.2, -0.3]);
        near(&there.joints3d[3], &[0.0, 0.0, -3.0]);
        // Upright and facing the camera.
        near(&there.orientation.map(f32::abs), &[0.0, 0.0, 0.0, 1.0]);
    }

    #[test]
    fn a_quarter_turn_about_the_vertical() {
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let world = World {
            rotation: [0.0, half, 0.0, half],
            translation: [0.0; 3],
            state: WorldState::ESTIMATED,
        };
        near(&world.direction([0.0, 0.0, 1.0]), &[1.0, 0.0, 0.0]);
        near(&world.direction([1.0, 0.0, 0.0]), &[0.0, 0.0, -1.0]);
        // Turned twice by a quarter: half a turn.
        near(&world.orientation(world.rotation), &[0.0, 1.0, 0.0, 0.0]);
        // Without a state it is no world, whatever the numbers.
        assert!(
            !World {
                state: 7.into(),
                ..world
            }
            .is_known()
        );
    }
}
