//! Somebody's motion at even steps: what formats with a fixed rate hold.

use glam::{DQuat, DVec3};

use super::error::ExportError;
use super::size;
use super::take::{Sample, Take};
use crate::body::skeleton::{BoneLengths, RIG_BONES, Skeleton, TPose, rig_rotations};
use crate::joints::{BODY_JOINTS, PELVIS};
use crate::message::Body;

/// Seconds for which whoever is in two frames that follow each other is taken to be there in between: bodies are held
/// for as long while no picture comes.
const HELD: f64 = 1.0;

/// Steps around a sample in which somebody is taken to be there.
const NEAR: f64 = 1.5;
/// Bytes of a step's numbers in a `.bvh`.
const BVH_ROW: usize = size_of::<[f64; 3 + 3 * RIG_BONES]>();
/// One of so many frames may have a foot below the ground: what was fitted wrong must not lift everybody.
const ONE_BELOW: usize = 100;

/// One moment of a [`Motion`].
#[derive(Debug, Clone, Copy)]
pub struct Moment {
    /// Where the hips are, metres.
    pub position: DVec3,
    /// Local rotations from the T-pose; of the hips in the axes of the export.
    pub rotations: [DQuat; RIG_BONES],
    /// Joints as they were published, metres.
    pub joints: [DVec3; BODY_JOINTS],
    /// Whether there is a sample within a step and a half, or no frame between the samples before and after.
    pub is_there: bool,
}

/// Somebody's motion from the first to the last appearance.
#[derive(Debug, Clone)]
pub struct Motion {
    /// Who.
    pub id: u32,
    /// Steps a second.
    pub rate: f64,
    /// The first moment, seconds after the record's first frame.
    pub start: f64,
    /// One a step.
    pub moments: Vec<Moment>,
    /// Medians over time, metres.
    pub lengths: BoneLengths,
    /// The rest pose with these lengths.
    pub rest: TPose,
}

impl Motion {
    /// Those of everybody in a record, by rising id, in the axes of the export.
    ///
    /// # Errors
    /// [`ExportError::Format`] where steps are too many to be held.
    pub fn all(take: &Take) -> Result<impl Iterator<Item = Self>, ExportError> {
        let rate = take.rate();
        Self::expect(take, rate, 0.0)?;
        // They take a look at every frame: not again for each.
        let axes = Axes::of(take);
        let ids = take.people.keys();
        Ok(ids.map(move |&id| Self::of(take, id, rate, &axes)))
    }

    /// Refuses motions at `rate` steps a second whose numbers are too many, with so many rows of a `.bvh` before them.
    ///
    /// # Errors
    /// [`ExportError::Format`].
    pub(super) fn expect(take: &Take, rate: f64, held: f64) -> Result<(), ExportError> {
        let steps: f64 = take.people.values().map(|s| steps(take, s, rate)).sum();
        let bytes = steps * size_of::<Moment>() as f64 + held * BVH_ROW as f64;
        size::expect(bytes, || {
            format!("{} steps of {:.6} s", steps + held, 1.0 / rate)
        })
    }

    /// That of one who is in the take, at so many steps a second.
    pub(super) fn of(take: &Take, id: u32, rate: f64, axes: &Axes) -> Self {
        let samples = &take.people[&id];
        let time = |s: &Sample| take.frames[s.frame].time;
        let lengths = std::array::from_fn(|j| {
            median(samples.iter().map(|s| f64::from(s.body.bone_lengths[j])))
        });
        let start = samples.first().map_or(0.0, time);
        let steps = steps(take, samples, rate) as usize;
        let mut next = 0;
        let moments = (0..steps).map(|step| {
            let now = start + step as f64 / rate;
            while next + 1 < samples.len() && time(&samples[next + 1]) <= now {
                next += 1;
            }
            let (before, after) = (&samples[next], samples.get(next + 1));
            let from = axes.moment(&before.body);
            let Some(after) = after else {
                return from;
            };
            let gap = time(after) - time(before);
            let share = ((now - time(before)) / gap).clamp(0.0, 1.0);
            let is_near = gap * share.min(1.0 - share) * rate <= NEAR;
            let is_there = is_near || is_held(before, after, gap);
            Moment {
                is_there,
                ..from.towards(&axes.moment(&after.body), share)
            }
        });
        Self {
            id,
            rate,
            start,
            moments: moments.collect(),
            lengths,
            rest: TPose::new(Skeleton::builtin(), &lengths),
        }
    }
}

/// Whether somebody is there all the time between two samples that follow each other, `gap` seconds apart, in a take of
/// so many frames a second.
pub fn is_there_between(before: &Sample, after: &Sample, gap: f64, rate: f64) -> bool {
    gap * rate <= 2.0 * NEAR || is_held(before, after, gap)
}

fn is_held(before: &Sample, after: &Sample, gap: f64) -> bool {
    after.frame == before.frame + 1 && gap <= HELD
}

/// Steps from somebody's first frame to the last.
fn steps(take: &Take, samples: &[Sample], rate: f64) -> f64 {
    let (Some(first), Some(last)) = (samples.first(), samples.last()) else {
        return 0.0;
    };
    let seconds = take.frames[last.frame].time - take.frames[first.frame].time;
    (seconds * rate + 1.0).round()
}

impl Moment {
    fn towards(&self, other: &Self, share: f64) -> Self {
        Self {
            position: self.position.lerp(other.position, share),
            rotations: std::array::from_fn(|b| {
                self.rotations[b]
                    .slerp(other.rotations[b], share)
                    .normalize()
            }),
            joints: std::array::from_fn(|j| self.joints[j].lerp(other.joints[j], share)),
            is_there: true,
        }
    }
}

/// From camera axes to those of the export; the same ones to begin with.
#[derive(Debug, Clone, Copy, Default)]
pub struct Axes {
    turn: DQuat,
    origin: DVec3,
}

impl Axes {
    /// Of a take: the same for one of its people as for all.
    pub fn of(take: &Take) -> Self {
        if let Some(world) = take.floor() {
            return Self {
                turn: DQuat::from_array(world.rotation.map(f64::from)).normalize(),
                origin: DVec3::from_array(world.translation.map(f64::from)),
            };
        }
        let upright = Self {
            turn: DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0),
            origin: DVec3::ZERO,
        };
        // Upright it is y that is turned over.
        let feet = take.frames.iter().filter_map(|frame| frame.lowest_foot);
        let heights = feet.map(|down| -f64::from(down));
        let mut lowest: Vec<f64> = heights.filter(|height| height.is_finite()).collect();
        lowest.sort_unstable_by(f64::total_cmp);
        let ground = lowest.get(lowest.len() / ONE_BELOW).copied();
        Self {
            origin: DVec3::new(0.0, -ground.unwrap_or_default(), 0.0),
            ..upright
        }
    }

    /// A point, metres.
    pub fn point(&self, p: [f32; 3]) -> DVec3 {
        self.placed(DVec3::from_array(p.map(f64::from)))
    }

    /// A point, metres.
    pub fn placed(&self, p: DVec3) -> DVec3 {
        self.turn * p + self.origin
    }

    /// A rotation of something in them.
    pub fn turned(&self, q: DQuat) -> DQuat {
        self.turn * q
    }

    fn moment(&self, body: &Body) -> Moment {
        let quaternion = |q: [f32; 4]| DQuat::from_array(q.map(f64::from)).normalize();
        let mut rotations = body.bone_rotations.map(quaternion);
        rotations[0] = self.turn * quaternion(body.orientation);
        let joints = body.joints3d.map(|j| self.point(j));
        Moment {
            position: joints[PELVIS],
            rotations: rig_rotations(Skeleton::builtin(), &rotations),
            joints,
            is_there: true,
        }
    }
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut all: Vec<f64> = values.collect();
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).copied().unwrap_or(0.0)
}
