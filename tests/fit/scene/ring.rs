//! Calibrated cameras round the place where people are, and what each of them sees. World axes are the scene's: x
//! right, y down, z away.

use edgecap::camera::{Brown, View};
use edgecap::joints::{
    BODY_JOINTS, ELBOWS, MIRRORED, MIRRORED_EVIDENCE, PELVIS, SHOULDERS, WRISTS,
};
use edgecap::message::{Observation, ObservationFrame};
use glam::{DMat3, DVec2, DVec3};
use rand::Rng;
use rand::rngs::SmallRng;

use super::gauss;
use super::people::Person;

/// So many cameras, two to four, 5 m from the middle and 2.4 m above the floor.
pub fn views(count: usize) -> Vec<View> {
    [20.0, 110.0, 205.0, 290.0f64][..count]
        .iter()
        .enumerate()
        .map(|(k, degrees)| {
            let a = degrees.to_radians();
            let middle = DVec3::new(0.0, 0.5, 4.2);
            let position = middle + DVec3::new(5.0 * a.sin(), -1.5, -5.0 * a.cos());
            let z = (middle - position).normalize();
            let x = DVec3::Y.cross(z).normalize();
            View {
                name: format!("cam{k}"),
                size: [1280, 720],
                focal: DVec2::splat(720.0),
                centre: DVec2::new(639.5, 359.5),
                distortion: Brown {
                    radial: [-0.05, 0.02, 0.0],
                    tangential: [0.0005, -0.0003],
                },
                rotation: DMat3::from_cols(x, z.cross(x), z).transpose(),
                position,
            }
        })
        .collect()
}

/// What goes wrong in a view.
#[derive(Debug, Clone, Copy, Default)]
pub struct Spoil {
    /// Error of the 2D, pixels per axis.
    pub pixels: f64,
    /// Error of Stage II's joints, metres per axis.
    pub space: f64,
    /// Part of joints that are not seen.
    pub unseen: f64,
    /// Part of joints that are anywhere near.
    pub outliers: f64,
    /// Arms and legs are called by the other side's name.
    pub exchanged: bool,
    /// Arms alone are.
    pub arms_exchanged: bool,
    /// Seeds of the people's clothes do not tell them apart.
    pub colourless: bool,
}

/// Everybody whom a camera sees at time `t` (seconds), in no order.
pub fn observe(
    view: &View,
    people: &[Person],
    t: f64,
    spoil: Spoil,
    rng: &mut SmallRng,
) -> ObservationFrame {
    let mut frame = ObservationFrame {
        capture_ns: 1_000_000_000 + (t * 1e9).round() as u64,
        width: view.size[0],
        height: view.size[1],
        intrinsics: view.intrinsics(),
        ..ObservationFrame::default()
    };
    let mut seen: Vec<Observation> = people
        .iter()
        .filter_map(|person| one(view, person, t, spoil, rng))
        .collect();
    if seen.len() > 1 {
        let by = rng.random_range(0..seen.len());
        seen.rotate_left(by);
    }
    frame.count = seen.len() as u32;
    frame.people[..seen.len()].copy_from_slice(&seen);
    frame
}

fn one(
    view: &View,
    person: &Person,
    t: f64,
    spoil: Spoil,
    rng: &mut SmallRng,
) -> Option<Observation> {
    let (_, joints) = person.at(t);
    let mut seen = Observation {
        score: 0.98,
        ..Observation::default()
    };
    let inside = |p: DVec2| {
        (0.0..f64::from(view.size[0])).contains(&p.x)
            && (0.0..f64::from(view.size[1])).contains(&p.y)
    };
    for (out, joint) in seen.joints2d.iter_mut().zip(joints) {
        let Some(p) = view.project(joint).filter(|p| inside(*p)) else {
            continue;
        };
        let mut p = p + spoil.pixels * DVec2::new(gauss(rng), gauss(rng));
        if rng.random_bool(spoil.outliers) {
            p += DVec2::new(rng.random_range(-90.0..90.0), rng.random_range(-90.0..90.0));
        }
        if !rng.random_bool(spoil.unseen) {
            *out = [p.x as f32, p.y as f32, 0.8];
        }
    }
    if seen.joints2d.iter().filter(|j| j[2] > 0.0).count() < 4 {
        return None;
    }
    for (out, joint) in seen.joints3d.iter_mut().zip(joints) {
        let off = spoil.space * DVec3::new(gauss(rng), gauss(rng), gauss(rng));
        let p = view.rotation * (joint - joints[PELVIS]) + off;
        *out = (p * (1.70 / person.height)).as_vec3().to_array();
    }
    if spoil.arms_exchanged {
        for [r, l] in [SHOULDERS, ELBOWS, WRISTS] {
            seen.joints2d.swap(r, l);
            seen.joints3d.swap(r, l);
        }
    }
    if spoil.exchanged {
        for &[r, l] in &MIRRORED[..MIRRORED_EVIDENCE] {
            seen.joints2d.swap(r, l);
        }
        for [r, l] in MIRRORED {
            seen.joints3d.swap(r, l);
        }
    }
    if !spoil.colourless {
        let [hue, saturation] = person.clothes.map(|bins| bins.map(|b| b as f32));
        (seen.hue, seen.saturation) = (hue, saturation);
    }
    Some(seen)
}

/// Mean distance of a body's evidence joints from the truth, metres.
pub fn error(found: &[[f32; 3]; BODY_JOINTS], person: &Person, t: f64) -> f64 {
    let (_, truth) = person.at(t);
    let each = found.iter().zip(truth).take(14);
    let sum: f64 = each
        .map(|(p, q)| DVec3::from(p.map(f64::from)).distance(q))
        .sum();
    sum / 14.0
}
