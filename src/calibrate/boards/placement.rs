//! Where a board is.

use glam::{DMat3, DQuat, DVec2, DVec3};

use crate::calibrate::pose::Pose;

/// A board's place and direction in some frame, metres. The board's axes: x and y along it, z into it, away from
/// whoever sees its front.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Board axes to the frame's.
    pub rotation: DMat3,
    /// The board's first corner in the frame.
    pub position: DVec3,
}

impl Placement {
    /// A place on the board, metres, in the frame.
    pub fn point(self, place: DVec2) -> DVec3 {
        self.rotation * place.extend(0.0) + self.position
    }

    /// Turned by a rotation vector in the frame's axes and moved.
    pub fn moved(self, turn: DVec3, by: DVec3) -> Self {
        let rotation = DMat3::from_quat(DQuat::from_scaled_axis(turn)) * self.rotation;
        Self {
            // Many small steps must not bend the axes.
            rotation: DMat3::from_quat(DQuat::from_mat3(&rotation).normalize()),
            position: self.position + by,
        }
    }

    /// The same board in the world, if this is where a camera of that pose sees it, in its axes.
    pub fn seen_from(self, camera: Pose) -> Self {
        let back = camera.rotation.transpose();
        Self {
            rotation: back * self.rotation,
            position: back * self.position + camera.position,
        }
    }

    /// The pose of a camera that sees at `seen`, in its axes, the board that is here in the world.
    pub fn camera_that_sees(self, seen: Self) -> Pose {
        let rotation = seen.rotation * self.rotation.transpose();
        Pose {
            rotation,
            position: self.position - rotation.transpose() * seen.position,
        }
    }
}
