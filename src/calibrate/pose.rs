//! Where a camera is, and how pictures tell it.

use glam::{DMat3, DQuat, DVec2, DVec3};

/// A camera's place and direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// World axes to camera axes.
    pub rotation: DMat3,
    /// The camera in the world.
    pub position: DVec3,
}

impl Pose {
    /// At the origin, along the world's axes.
    pub const ORIGIN: Self = Self {
        rotation: DMat3::IDENTITY,
        position: DVec3::ZERO,
    };

    /// A world point in camera axes.
    pub fn to_camera(self, point: DVec3) -> DVec3 {
        self.rotation * (point - self.position)
    }

    /// A world point on the plane z = 1; `None` behind the camera.
    pub fn plane(self, point: DVec3) -> Option<DVec2> {
        let p = self.to_camera(point);
        (p.z > 1e-6).then(|| p.truncate() / p.z)
    }

    /// Direction in the world of a point on the plane z = 1, a unit vector.
    pub fn direction(self, plane: DVec2) -> DVec3 {
        (self.rotation.transpose() * plane.extend(1.0)).normalize()
    }

    /// Turned by a rotation vector in camera axes and moved.
    pub fn moved(self, turn: DVec3, by: DVec3) -> Self {
        let rotation = DMat3::from_quat(DQuat::from_scaled_axis(turn)) * self.rotation;
        Self {
            // Many small steps must not bend the axes.
            rotation: DMat3::from_quat(DQuat::from_mat3(&rotation).normalize()),
            position: self.position + by,
        }
    }
}

/// Rows of the derivative of a point's image on the plane z = 1 by the point in camera axes.
pub fn plane_jacobian(p: DVec3) -> [DVec3; 2] {
    let inverse = 1.0 / p.z;
    [
        DVec3::new(inverse, 0.0, -p.x * inverse * inverse),
        DVec3::new(0.0, inverse, -p.y * inverse * inverse),
    ]
}
