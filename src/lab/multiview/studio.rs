//! People of [`synth`](crate::lab::synth) in a hall, seen by cameras all round and told of by a detector as bad as the
//! real one.

use glam::DVec3;

use super::{Cast, Trial};
use crate::joints::EVIDENCE_JOINTS;
use crate::lab::synth::detector::{Detector, Flaws};
use crate::lab::synth::studio::Studio;

/// Pixels across and down.
const SIZE: (u32, u32) = (1280, 800);
/// Frames a second.
const RATE: f32 = 30.0;

/// One person before so many cameras. Equal seeds give equal people and movements whatever the number of cameras.
pub fn studio(seed: u64, views: usize, frames: u64, flaws: Flaws) -> Trial {
    let studio = Studio::new(seed, SIZE, views, 1, frames, RATE);
    let mut detectors: Vec<Detector> = (0..views as u64)
        .map(|v| Detector::new(flaws, RATE, seed.wrapping_mul(64) + v))
        .collect();
    let seen = (0..frames)
        .map(|k| {
            let each = detectors.iter_mut().enumerate();
            each.map(|(v, detector)| {
                let told = detector.observe(&studio.outline(v, k), [SIZE.0, SIZE.1]);
                told.people().to_vec()
            })
            .collect()
        })
        .collect();
    let world: Vec<_> = (0..frames)
        .map(|k| studio.world(k).people.swap_remove(0))
        .collect();
    Trial {
        views: studio.views(),
        seen,
        joints: world
            .iter()
            .map(|p| {
                let at = |j: usize| DVec3::from(p.joints3d[j].map(f64::from));
                std::array::from_fn::<_, EVIDENCE_JOINTS, _>(at)
            })
            .collect(),
        stature: f64::from(world.first().map_or(0.0, |p| p.stature)),
        betas: None,
        rate: RATE.into(),
        cast: Cast::Studio(Box::new(studio)),
    }
}
