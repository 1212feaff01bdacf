//! From a seed to a picture and its truth, frame by frame; every frame can be made alone, in any order, on any thread.

use super::clip::{Clip, clip};
use super::measure::{measure, outline};
use super::noise::Dice;
use super::render::{Backdrop, Picture, render};
use super::scene::{Scene, Stance};
use super::sensor::{develop, mean_level};
use super::stills::still;
use super::truth::TruthFrame;
use crate::capture::Frame;

/// A picture with everything that is known about it.
#[derive(Debug, Clone)]
pub struct Shot {
    /// The picture.
    pub frame: Frame,
    /// The truth.
    pub truth: TruthFrame,
    /// Depth, identities, joints in the world.
    pub picture: Picture,
    /// JPEG quality of the camera it imitates.
    pub quality: u8,
}

fn shoot(
    scene: &Scene,
    backdrop: &Backdrop,
    stances: &[Stance],
    level: Option<f32>,
    index: u64,
    time_ns: u64,
) -> Shot {
    let picture = render(scene, backdrop, stances);
    let truth = measure(scene, stances, &picture, index, time_ns);
    let level = level.unwrap_or_else(|| mean_level(&picture.light));
    let size = (scene.camera.width, scene.camera.height);
    let mut frame = develop(
        &picture.light,
        size,
        &scene.sensor,
        level,
        &mut Dice::new(scene.seed, index),
    );
    frame.time_ns = time_ns;
    frame.sequence = index;
    Shot {
        frame,
        truth,
        picture,
        quality: scene.sensor.quality,
    }
}

/// Picture number `index` of a set of stills with at most `people` people.
pub fn shoot_still(seed: u64, index: u64, size: (u32, u32), people: usize) -> Shot {
    let (scene, stances) = still(seed, index, size, people);
    shoot(&scene, &Backdrop::new(&scene), &stances, None, index, 0)
}

/// What is known about picture number `index` of a set of stills without rendering it.
pub fn outline_still(seed: u64, index: u64, size: (u32, u32), people: usize) -> TruthFrame {
    let (scene, stances) = still(seed, index, size, people);
    outline(&scene, &stances, index, 0)
}

/// A clip ready to be rendered.
#[derive(Debug, Clone)]
pub struct Reel {
    clip: Clip,
    backdrop: Backdrop,
    level: f32,
}

impl Reel {
    /// Prepares a clip.
    pub fn new(seed: u64, size: (u32, u32), people: usize, frames: u64, fps: f32) -> Self {
        let clip = clip(seed, size, people, frames, fps);
        let backdrop = Backdrop::new(&clip.scene);
        let first = clip.stances.first().map_or(&[][..], Vec::as_slice);
        // The exposure stays as it was in the first frame.
        let level = mean_level(&render(&clip.scene, &backdrop, first).light);
        Self {
            clip,
            backdrop,
            level,
        }
    }

    /// Number of frames.
    pub fn len(&self) -> u64 {
        self.clip.stances.len() as u64
    }

    /// No frames at all.
    pub fn is_empty(&self) -> bool {
        self.clip.stances.is_empty()
    }

    /// Frame number `index`, below [`len`](Self::len).
    pub fn shot(&self, index: u64) -> Shot {
        let time_ns = (index as f64 * 1e9 / f64::from(self.clip.fps)).round() as u64;
        let stances = &self.clip.stances[index as usize];
        shoot(
            &self.clip.scene,
            &self.backdrop,
            stances,
            Some(self.level),
            index,
            time_ns,
        )
    }
}
