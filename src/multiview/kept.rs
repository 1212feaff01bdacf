//! What a fit had computed before it was broken off: states of fitted frames, as bytes that somebody keeps.
//!
//! A part is some frames of one person after one stage. What is read back is what was written, bit by bit, so that a
//! fit that goes on ends where one that was never broken off does.

use super::fitted::Fitted;
use super::moment::Moment;
use crate::body::mesh::{JOINTS, MeshBody, MeshPose};

/// Keeps parts of a fit for another try. Names are unique within a fit.
pub trait Kept: Sync {
    /// The bytes that were kept under a name; `None` where there are none, or they are not what was kept.
    fn get(&self, part: &str) -> Option<Vec<u8>>;
    /// Keeps bytes. That they cannot be kept is no reason to end.
    fn put(&self, part: &str, bytes: &[u8]);
}

/// Keeps nothing.
#[derive(Debug, Clone, Copy)]
pub struct Nothing;

impl Kept for Nothing {
    fn get(&self, _: &str) -> Option<Vec<u8>> {
        None
    }

    fn put(&self, _: &str, _: &[u8]) {}
}

/// A body and its cost; `None` where there was no place to start.
pub(super) type Placed = Option<(Fitted, f64)>;

/// What fitting has made of frames: bodies, and which limbs of which views were exchanged.
pub(super) fn write<'a>(
    frames: impl ExactSizeIterator<Item = (&'a Moment, Option<(&'a Fitted, f64)>)>,
) -> Vec<u8> {
    let mut out = Vec::new();
    out.extend((frames.len() as u64).to_le_bytes());
    for (moment, placed) in frames {
        out.extend((moment.healed as u64).to_le_bytes());
        for sight in &moment.sights {
            out.push(sight.as_ref().map_or(0, |s| s.swapped));
        }
        out.push(u8::from(placed.is_some()));
        let Some((fitted, cost)) = placed else {
            continue;
        };
        let betas = fitted.person.betas();
        out.extend((betas.len() as u16).to_le_bytes());
        let pose = &fitted.pose;
        let turns = pose.rotations.iter().flat_map(|q| q.to_array());
        let numbers = [cost].into_iter().chain(pose.pelvis.to_array());
        for number in numbers.chain(turns).chain(betas.iter().copied()) {
            out.extend(number.to_le_bytes());
        }
    }
    out
}

/// Brings frames into the state that was written of them. `None`, and they are as they were, where that is not of these
/// frames.
pub(super) fn read(
    bytes: &[u8],
    body: &MeshBody,
    moments: &mut [&mut Moment],
) -> Option<Vec<Placed>> {
    let mut from = Bytes(bytes);
    if from.u64()? != moments.len() as u64 {
        return None;
    }
    let (mut changes, mut all) = (Vec::new(), Vec::new());
    for moment in moments.iter() {
        let healed = usize::try_from(from.u64()?).ok()?;
        changes.push((healed, from.take(moment.sights.len())?));
        all.push(match from.take(1)? {
            [0] => None,
            _ => Some(placed(&mut from, body)?),
        });
    }
    if !from.0.is_empty() {
        return None;
    }
    for (moment, (healed, swapped)) in moments.iter_mut().zip(changes) {
        moment.healed = healed;
        for (sight, swapped) in moment.sights.iter_mut().zip(swapped) {
            if let Some(sight) = sight {
                sight.swap_as(*swapped);
            }
        }
    }
    Some(all)
}

fn placed(from: &mut Bytes<'_>, body: &MeshBody) -> Option<(Fitted, f64)> {
    let count = usize::from(u16::from_le_bytes(from.array()?));
    if count > body.components() {
        return None;
    }
    let cost = from.f64()?;
    let mut pose = MeshPose {
        pelvis: [from.f64()?, from.f64()?, from.f64()?].into(),
        rotations: [glam::DQuat::IDENTITY; JOINTS],
    };
    for turn in &mut pose.rotations {
        *turn = glam::DQuat::from_array([from.f64()?, from.f64()?, from.f64()?, from.f64()?]);
    }
    let betas = (0..count)
        .map(|_| from.f64())
        .collect::<Option<Vec<f64>>>()?;
    Some((Fitted::new(body, pose, &betas), cost))
}

/// What is left to read.
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, left) = self.0.split_at_checked(count)?;
        self.0 = left;
        Some(taken)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    fn f64(&mut self) -> Option<f64> {
        self.array().map(f64::from_le_bytes)
    }
}
