//! The floor as a plane, and the world that stands on it: y up, origin on the floor below the camera.

use glam::{DMat3, DQuat, DVec3};

use crate::fit::config::GroundConfig;

/// The floor in camera axes: points p with normal · p + offset = 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FloorPlane {
    /// Unit vector away from the floor.
    pub normal: DVec3,
    /// Height of the camera above the floor, metres.
    pub offset: f64,
}

impl FloorPlane {
    /// From settings; `None` if the normal is no direction.
    pub fn from_config(config: &GroundConfig) -> Option<Self> {
        Some(Self {
            normal: DVec3::from_array(config.normal).try_normalize()?,
            offset: config.offset,
        })
    }

    /// Rotation and translation from camera axes to the floor-aligned world: x to the camera's right, y up, z towards
    /// the camera's back; the origin is on the floor below the camera. World = rotation · camera + translation.
    pub fn world_from_camera(&self) -> (DQuat, DVec3) {
        let y = self.normal;
        let x = (DVec3::X - y * y.x).try_normalize().unwrap_or(DVec3::Z);
        let z = x.cross(y);
        // Rows are the world's axes in camera coordinates.
        let rotation = DQuat::from_mat3(&DMat3::from_cols(x, y, z).transpose()).normalize();
        (rotation, DVec3::new(0.0, self.offset, 0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_world_stands_on_the_floor() {
        let ground = FloorPlane {
            normal: DQuat::from_rotation_x(-0.3) * DVec3::NEG_Y,
            offset: 1.7,
        };
        let (rotation, translation) = ground.world_from_camera();
        assert!((translation - DVec3::new(0.0, 1.7, 0.0)).length() < 1e-12);
        let below = ground.normal * -1.7;
        assert!((rotation * below + translation).length() < 1e-12);
        assert!((rotation * ground.normal - DVec3::Y).length() < 1e-12);
        assert!((rotation * DVec3::X - DVec3::X).length() < 1e-12);
        // What is in front of the camera lies towards −z.
        assert!((rotation * DVec3::Z).z < -0.9);
    }
}
