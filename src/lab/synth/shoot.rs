//! From a seed to a picture and its truth, frame by frame; every frame can be made alone, in any order, on any thread.

use std::sync::OnceLock;

use super::clip::{Clip, clip};
use super::measure::{measure, outline};
use super::noise::Dice;
use super::render::{Backdrop, Picture, render};
use super::scene::{Scene, Stance};
use super::sensor::{develop, mean_level};
use super::stills::{Stills, still};
use super::survey::{Survey, survey};
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
    let truth = measure(scene, stances, &picture.survey, index, time_ns);
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

/// Picture number `index` of a set of stills.
pub fn shoot_still(set: &Stills, index: u64) -> Shot {
    let (scene, stances) = still(set, index);
    shoot(&scene, &Backdrop::new(&scene), &stances, None, index, 0)
}

/// What is known about picture number `index` of a set of stills without rendering it.
pub fn outline_still(set: &Stills, index: u64) -> TruthFrame {
    let (scene, stances) = still(set, index);
    outline(&scene, &scene.camera, &stances, index, 0)
}

/// A clip ready to be rendered.
#[derive(Debug, Clone)]
pub struct Reel {
    clip: Clip,
    backdrop: Backdrop,
    /// Found when the first picture is asked for: it takes one.
    level: OnceLock<f32>,
}

impl Reel {
    /// Prepares a clip.
    pub fn new(seed: u64, size: (u32, u32), people: usize, frames: u64, fps: f32) -> Self {
        Self::until(seed, size, people, frames, fps, &|| false)
    }

    /// The same of fewer frames where `is_stopped`, which is asked before each is directed, says so.
    pub fn until(
        seed: u64,
        size: (u32, u32),
        people: usize,
        frames: u64,
        fps: f32,
        is_stopped: &dyn Fn() -> bool,
    ) -> Self {
        Self::of(clip(seed, size, people, frames, fps, is_stopped))
    }

    /// Prepares a clip that is directed already.
    pub fn of(clip: Clip) -> Self {
        let backdrop = Backdrop::new(&clip.scene);
        Self {
            clip,
            backdrop,
            level: OnceLock::new(),
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
        // The exposure stays as it was in the first frame.
        let level = *self.level.get_or_init(|| {
            let first = self.clip.stances.first().map_or(&[][..], Vec::as_slice);
            mean_level(&render(&self.clip.scene, &self.backdrop, first).light)
        });
        shoot(
            &self.clip.scene,
            &self.backdrop,
            &self.clip.stances[index as usize],
            Some(level),
            index,
            self.clip.time_ns(index),
        )
    }

    /// Who is where in frame number `index`, and all that is true about it, without light.
    pub fn survey(&self, index: u64) -> (Survey, TruthFrame) {
        let stances = &self.clip.stances[index as usize];
        let (survey, _) = survey(&self.clip.scene, &self.backdrop.z, stances);
        let time = self.clip.time_ns(index);
        let truth = measure(&self.clip.scene, stances, &survey, index, time);
        (survey, truth)
    }
}
