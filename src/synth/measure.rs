//! A rendered moment goes in, its exact truth comes out.

use glam::Vec3;

use super::raster::{NOBODY, TRIANGLE_BITS};
use super::render::{Picture, SUPERSAMPLE};
use super::scene::{Scene, Stance};
use super::truth::{
    ABSENT, OCCLUDED, SELF_OCCLUDED, TruthCamera, TruthFrame, TruthPerson, VISIBLE,
};
use crate::joints::BODY_JOINTS;

/// How deep a joint may lie under its own visible skin, metres, for a person of 1.70 m.
const OWN_DEPTH: f32 = 0.17;
/// How far another surface must be in front of a joint to hide it, metres.
const HIDING_DEPTH: f32 = 0.04;

fn round(v: f32, digits: f32) -> f32 {
    (v * digits).round() / digits
}

/// Truth about one frame.
pub fn measure(
    scene: &Scene,
    stances: &[Stance],
    picture: &Picture,
    frame: u64,
    time_ns: u64,
) -> TruthFrame {
    let camera = &scene.camera;
    let up = camera.axes * Vec3::Y;
    let people = stances
        .iter()
        .enumerate()
        .filter(|(k, _)| picture.boxes[*k].is_none_or(|b| touches(b, camera.width, camera.height)))
        .map(|(k, stance)| {
            let person = &scene.people[stance.person];
            let joints3d: [[f32; 3]; BODY_JOINTS] = std::array::from_fn(|j| {
                camera
                    .to_camera(picture.posed[k].joints[j])
                    .to_array()
                    .map(|v| round(v, 1e4))
            });
            let joints2d = joints3d.map(|p| camera.lens.project(p).map(|v| round(v, 10.0)));
            let tolerance = OWN_DEPTH * person.shape.stature / 1.70;
            TruthPerson {
                id: person.id,
                stature: round(person.shape.stature, 1e4),
                joints3d,
                joints2d,
                visibility: std::array::from_fn(|j| {
                    visibility(picture, k as u32, joints3d[j][2], joints2d[j], tolerance)
                }),
                bounds: picture.boxes[k].map(|b| b.map(|v| round(v, 10.0))),
                pixels: picture.shown[k] as f32 / (SUPERSAMPLE * SUPERSAMPLE) as f32,
            }
        })
        .collect();
    TruthFrame {
        frame,
        time_ns,
        file: None,
        camera: TruthCamera {
            fx: camera.lens.fx,
            fy: camera.lens.fy,
            cx: camera.lens.cx,
            cy: camera.lens.cy,
            floor: [up.x, up.y, up.z, camera.eye.y],
        },
        people,
    }
}

/// Whether a box reaches into the picture.
fn touches(b: [f32; 4], width: u32, height: u32) -> bool {
    b[0] < width as f32 - 0.5 && b[1] < height as f32 - 0.5 && b[2] > -0.5 && b[3] > -0.5
}

fn visibility(picture: &Picture, person: u32, z: f32, at: [f32; 2], tolerance: f32) -> u8 {
    let s = &picture.samples;
    let scale = SUPERSAMPLE as f32;
    let (x, y) = (
        ((at[0] + 0.5) * scale).floor(),
        ((at[1] + 0.5) * scale).floor(),
    );
    if z <= 0.1 || x < 0.0 || y < 0.0 || x >= s.width as f32 || y >= s.height as f32 {
        return ABSENT;
    }
    let i = y as usize * s.width + x as usize;
    let surface = s.z[i];
    let own = s.who[i] != NOBODY && s.who[i] >> TRIANGLE_BITS == person;
    if own {
        if surface > z - tolerance {
            VISIBLE
        } else {
            SELF_OCCLUDED
        }
    } else if surface > z - HIDING_DEPTH {
        VISIBLE
    } else {
        OCCLUDED
    }
}
