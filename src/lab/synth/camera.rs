//! The pinhole camera of a scene: world points go in, camera-space points and pixels come out.

use glam::{Mat3, Vec2, Vec3};

use crate::message::Intrinsics;

/// A camera above the floor; world x right, y up, and the camera looks along −z when its angles are 0.
#[derive(Debug, Clone, Copy)]
pub struct Camera {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Square pixels, principal point in the centre.
    pub lens: Intrinsics,
    /// Position, metres.
    pub eye: Vec3,
    /// World to camera axes (x right, y down, z forward).
    pub axes: Mat3,
}

impl Camera {
    /// `fov`: horizontal field of view; `pitch`: downwards; `yaw`: to the left; `roll`: clockwise picture. Degrees.
    pub fn new(size: (u32, u32), fov: f32, eye: Vec3, pitch: f32, yaw: f32, roll: f32) -> Self {
        let flip = Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0));
        let axes = Mat3::from_rotation_z(roll.to_radians())
            * Mat3::from_rotation_x(pitch.to_radians())
            * flip
            * Mat3::from_rotation_y(-yaw.to_radians());
        Self {
            width: size.0,
            height: size.1,
            lens: Intrinsics::from_horizontal_fov(size.0, size.1, fov),
            eye,
            axes,
        }
    }

    /// World point to camera space.
    pub fn to_camera(&self, p: Vec3) -> Vec3 {
        self.axes * (p - self.eye)
    }

    /// Camera-space point to a pixel; meaningless for z ≤ 0.
    pub fn project(&self, p: Vec3) -> Vec2 {
        Vec2::from_array(self.lens.project(p.to_array()))
    }

    /// Direction of a pixel in world axes, scaled so that its camera-space z is 1.
    pub fn ray(&self, u: f32, v: f32) -> Vec3 {
        let d = Vec3::new(
            (u - self.lens.cx) / self.lens.fx,
            (v - self.lens.cy) / self.lens.fy,
            1.0,
        );
        self.axes.transpose() * d
    }
}
