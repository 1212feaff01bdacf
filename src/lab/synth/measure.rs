//! A moment goes in, its exact truth comes out: all of it when it was rendered, else where the joints are.

use glam::Vec3;

use super::camera::Camera;
use super::pose::Posed;
use super::raster::{NOBODY, TRIANGLE_BITS};
use super::scene::{Person, Scene, Stance};
use super::survey::{SUPERSAMPLE, Survey};
use super::truth::{
    ABSENT, OCCLUDED, SELF_OCCLUDED, TruthCamera, TruthFrame, TruthPerson, VISIBLE,
};
use crate::joints::BODY_JOINTS;

/// How deep a joint may lie under its own visible skin, metres, for a person of 1.70 m.
const OWN_DEPTH: f32 = 0.17;
/// Joints nearer than this to the camera are outside the picture, metres.
const NEAREST: f32 = 0.1;
/// How far another surface must be in front of a joint to hide it, metres.
const HIDING_DEPTH: f32 = 0.04;

fn round(v: f32, digits: f32) -> f32 {
    (v * digits).round() / digits
}

/// Truth about one frame of which is known who is where.
pub fn measure(
    scene: &Scene,
    stances: &[Stance],
    survey: &Survey,
    frame: u64,
    time_ns: u64,
) -> TruthFrame {
    let camera = &scene.camera;
    let people = stances
        .iter()
        .enumerate()
        .filter(|(k, _)| survey.boxes[*k].is_none_or(|b| touches(b, camera.width, camera.height)))
        .map(|(k, stance)| {
            let person = &scene.people[stance.person];
            let tolerance = OWN_DEPTH * person.shape.stature / 1.70;
            TruthPerson {
                bounds: survey.boxes[k].map(|b| b.map(|v| round(v, 10.0))),
                pixels: survey.shown[k] as f32 / (SUPERSAMPLE * SUPERSAMPLE) as f32,
                ..placed(camera, person, &survey.posed[k], |z, at| {
                    visibility(survey, k as u32, z, at, tolerance)
                })
            }
        })
        .collect();
    moment(camera, people, frame, time_ns)
}

/// Truth about one frame that nobody rendered, as `camera` sees the scene: joints inside the picture count as visible,
/// boxes and areas are unknown (absent, 0). People of whom no joint is inside are left out.
pub fn outline(
    scene: &Scene,
    camera: &Camera,
    stances: &[Stance],
    frame: u64,
    time_ns: u64,
) -> TruthFrame {
    let inside = |z: f32, at: [f32; 2]| {
        let pixel = at.map(|v| (v + 0.5).floor());
        let within = pixel[0] >= 0.0
            && pixel[1] >= 0.0
            && pixel[0] < camera.width as f32
            && pixel[1] < camera.height as f32;
        if z > NEAREST && within {
            VISIBLE
        } else {
            ABSENT
        }
    };
    let people = stances
        .iter()
        .map(|stance| {
            let person = &scene.people[stance.person];
            placed(camera, person, &person.posed(stance), inside)
        })
        .filter(|p| p.visibility.contains(&VISIBLE))
        .collect();
    moment(camera, people, frame, time_ns)
}

/// Where somebody's joints are; no box and no area. `visible` judges a joint by its depth and pixel.
fn placed(
    camera: &Camera,
    person: &Person,
    posed: &Posed,
    visible: impl Fn(f32, [f32; 2]) -> u8,
) -> TruthPerson {
    let joints3d: [[f32; 3]; BODY_JOINTS] = std::array::from_fn(|j| {
        camera
            .to_camera(posed.joints[j])
            .to_array()
            .map(|v| round(v, 1e4))
    });
    let joints2d = joints3d.map(|p| camera.lens.project(p).map(|v| round(v, 10.0)));
    TruthPerson {
        id: person.id,
        stature: round(person.shape.stature, 1e4),
        joints3d,
        joints2d,
        visibility: std::array::from_fn(|j| visible(joints3d[j][2], joints2d[j])),
        bounds: None,
        pixels: 0.0,
    }
}

fn moment(camera: &Camera, people: Vec<TruthPerson>, frame: u64, time_ns: u64) -> TruthFrame {
    let up = camera.axes * Vec3::Y;
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

fn visibility(survey: &Survey, person: u32, z: f32, at: [f32; 2], tolerance: f32) -> u8 {
    let s = &survey.samples;
    let scale = SUPERSAMPLE as f32;
    let (x, y) = (
        ((at[0] + 0.5) * scale).floor(),
        ((at[1] + 0.5) * scale).floor(),
    );
    if z <= NEAREST || x < 0.0 || y < 0.0 || x >= s.width as f32 || y >= s.height as f32 {
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
