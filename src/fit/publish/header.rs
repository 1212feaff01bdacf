//! In: an observation frame. Out: what the body frames made of it repeat: times, size, camera.

use glam::Vec3;

use crate::fit::track::Track;
use crate::joints::{NECK, PELVIS};
use crate::message::{BodyFrame, Intrinsics, ObservationFrame, StageTimes};

/// What a body frame repeats of the newest observation frame.
#[derive(Debug, Clone, Copy)]
pub struct Header {
    pub sequence: u64,
    pub capture_ns: u64,
    pub width: u32,
    pub height: u32,
    pub intrinsics: Intrinsics,
    pub stage_times: StageTimes,
    pub flags: u32,
    pub frame_total: u32,
}

impl Header {
    /// Of a frame, with a plausible camera where its numbers make no sense.
    pub fn of(frame: &ObservationFrame) -> Self {
        Self {
            sequence: frame.sequence,
            capture_ns: frame.capture_ns,
            width: frame.width,
            height: frame.height,
            intrinsics: usable_camera(frame),
            stage_times: frame.stage_times,
            flags: frame.flags,
            frame_total: frame.frame_total,
        }
    }

    /// Writes what every body frame says of the input, its bodies being given for `pose_ns`.
    pub fn write(&self, pose_ns: u64, out: &mut BodyFrame) {
        out.sequence = self.sequence;
        out.capture_ns = self.capture_ns;
        out.pose_ns = pose_ns;
        out.publish_ns = 0;
        out.width = self.width;
        out.height = self.height;
        out.intrinsics = self.intrinsics;
        out.stage_times = self.stage_times;
        out.fit_us = 0;
        out.flags = self.flags;
        out.frame_total = self.frame_total;
    }

    /// Not seen, and expected with neck and pelvis beyond the picture's edge: nothing will confirm or correct that
    /// prediction.
    pub fn has_left(&self, track: &Track) -> bool {
        let beyond = |joint: usize| {
            let pixel = pixel(&self.intrinsics, track.posed.joints[joint].as_vec3());
            let is_inside = |[u, v]: [f32; 2]| {
                (-0.5..self.width as f32 - 0.5).contains(&u)
                    && (-0.5..self.height as f32 - 0.5).contains(&v)
            };
            !pixel.is_some_and(is_inside)
        };
        track.unseen > 0.0 && [NECK, PELVIS].into_iter().all(beyond)
    }

    /// Whether the picture has the same size and camera.
    pub fn same_camera(&self, other: &Self) -> bool {
        (self.width, self.height, self.intrinsics) == (other.width, other.height, other.intrinsics)
    }
}

/// The frame's camera, or a plausible one where its numbers make no sense.
fn usable_camera(frame: &ObservationFrame) -> Intrinsics {
    let c = frame.intrinsics;
    let focal = |f: f32| f.is_finite() && f > 1e-3 && f < 1e7;
    let point = |p: f32| p.is_finite() && p.abs() < 1e7;
    if focal(c.fx) && focal(c.fy) && point(c.cx) && point(c.cy) {
        c
    } else {
        Intrinsics::from_horizontal_fov(frame.width.max(1), frame.height.max(1), 60.0)
    }
}

/// Where a joint is seen; `None` beside or behind the camera. Of one that nearly is beside it, the nearest depth from
/// which pixels are of use.
pub fn pixel(camera: &Intrinsics, p: Vec3) -> Option<[f32; 2]> {
    (p.z > 0.0).then(|| camera.project([p.x, p.y, p.z.max(0.05)]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_behind_the_camera_has_no_pixel() {
        let camera = Intrinsics::from_horizontal_fov(640, 480, 60.0);
        let seen = pixel(&camera, Vec3::new(0.1, -0.2, 2.0)).unwrap();
        assert_eq!(seen, camera.project([0.1, -0.2, 2.0]));
        assert!(pixel(&camera, Vec3::new(0.1, -0.2, 0.001)).is_some());
        for z in [0.0, -0.001, -2.0] {
            assert_eq!(pixel(&camera, Vec3::new(0.1, -0.2, z)), None, "at {z}");
        }
    }
}
