//! A whole record in memory: frames, and everybody's samples.

use std::collections::{BTreeMap, BTreeSet};
use std::io::BufRead;

use super::error::ExportError;
use super::size;
use crate::joints::{L_ANKLE, L_FOOT_TIP, R_ANKLE, R_FOOT_TIP};
use crate::message::{Body, BodyFrame, World};
use crate::record::BodyReader;
use crate::record::clock::{RATE, Stamp, seconds, usual_rate};

/// No camera is faster: shorter steps are a record's mistake, and would make endless files. Frames a second.
const MOST_RATE: f64 = 1e3;
/// People listed in an error.
const MOST_LISTED: usize = 20;
/// Joints of which one is on the ground: the ankles, and the tips of the feet.
const FEET: [usize; 4] = [R_ANKLE, L_ANKLE, R_FOOT_TIP, L_FOOT_TIP];

/// A frame, without its people.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    /// Its number in the input.
    pub sequence: u64,
    /// Since the first frame, seconds.
    pub time: f64,
    /// As it was known then.
    pub world: World,
    /// How far down the lowest foot is of all who are in it, also of those who are not held: y of the camera's axes,
    /// metres. `None` where nobody is.
    pub lowest_foot: Option<f32>,
}

/// Somebody in a frame.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    /// Index of the frame.
    pub frame: usize,
    /// The body.
    pub body: Body,
}

/// A record.
#[derive(Debug, Clone, Default)]
pub struct Take {
    /// What the record is called.
    pub name: String,
    /// By rising time.
    pub frames: Vec<Frame>,
    /// Everybody's samples by id, by rising time. Ids of bodies whose publisher was started again meanwhile, and which
    /// begin at 1 again with it, go on after the highest before.
    pub people: BTreeMap<u32, Vec<Sample>>,
    /// Whether the file ended inside a frame, which was left out.
    pub was_cut: bool,
}

impl Take {
    /// Reads a record of bodies in either format; `name` is what errors call it.
    ///
    /// # Errors
    /// What is wrong with the record, such as two people of one id in a frame; [`ExportError::Empty`] where nobody is
    /// in it, [`ExportError::Cut`] where no whole frame is, [`ExportError::Format`] where there are too many to be
    /// held.
    pub fn read(input: impl BufRead, name: &str) -> Result<Self, ExportError> {
        Self::read_of(input, name, None)
    }

    /// The same of one person, of whom a record of days can be held; `None`: of everybody. Frames are the same: alone
    /// somebody is where and when they are among all.
    ///
    /// # Errors
    /// As [`read`](Self::read); [`ExportError::NoPerson`], [`ExportError::NoTime`].
    pub fn read_of(
        input: impl BufRead,
        name: &str,
        person: Option<u32>,
    ) -> Result<Self, ExportError> {
        let mut frames = BodyReader::new(input, name);
        let mut take = Self {
            name: name.to_owned(),
            ..Self::default()
        };
        let mut stamps: Vec<Stamp> = Vec::new();
        let (mut ids, mut held) = (BTreeSet::new(), 0_u64);
        while let Some(message) = frames.read()? {
            if let Some(id) = doubled(&message) {
                let id = frames.recorded(id);
                return Err(frames.bad(format!("two people with the id {id}")).into());
            }
            let index = take.frames.len();
            stamps.push((message.sequence, message.pose_ns));
            take.frames.push(Frame {
                sequence: message.sequence,
                time: 0.0,
                world: message.world,
                lowest_foot: lowest_foot(message.bodies()),
            });
            for body in message.bodies() {
                let id = body.id;
                ids.insert(id);
                if person.is_some_and(|wanted| wanted != id) {
                    continue;
                }
                held += 1;
                take.people.entry(id).or_default().push(Sample {
                    frame: index,
                    body: *body,
                });
            }
            let bytes = held as f64 * size_of::<Sample>() as f64;
            size::expect(bytes, || format!("the bodies of {} frames", index + 1))?;
        }
        take.was_cut = frames.was_cut();
        take.keep(&seconds(&stamps));
        match person {
            Some(id) if take.people.is_empty() && ids.contains(&id) => Err(ExportError::NoTime {
                name: name.to_owned(),
                id,
            }),
            Some(id) if take.people.is_empty() && !ids.is_empty() => Err(no_person(name, id, &ids)),
            _ if stamps.is_empty() && take.was_cut => Err(ExportError::Cut {
                name: name.to_owned(),
            }),
            _ if take.people.is_empty() => Err(ExportError::Empty {
                name: name.to_owned(),
                frames: stamps.len() as u64,
            }),
            _ => Ok(take),
        }
    }

    /// Gives the frames their times, and leaves those out that have none.
    fn keep(&mut self, times: &[Option<f64>]) {
        let mut kept = 0..;
        let places: Vec<Option<usize>> = times
            .iter()
            .map(|time| time.and_then(|_| kept.next()))
            .collect();
        let timed = self.frames.iter().zip(times);
        self.frames = timed
            .filter_map(|(frame, time)| {
                Some(Frame {
                    time: (*time)?,
                    ..*frame
                })
            })
            .collect();
        for samples in self.people.values_mut() {
            samples.retain_mut(|sample| {
                let place = places[sample.frame];
                sample.frame = place.unwrap_or_default();
                place.is_some()
            });
        }
        self.people.retain(|_, samples| !samples.is_empty());
    }

    /// When the first of its people is first there, seconds: where files begin.
    pub fn start(&self) -> f64 {
        let firsts = self.people.values().filter_map(|s| s.first());
        let first = firsts.map(|s| s.frame).min();
        first.map_or(0.0, |frame| self.frames[frame].time)
    }

    /// Frames a second while somebody is in view.
    pub fn rate(&self) -> f64 {
        let steps = self.frames.windows(2).map(|pair| {
            let is_inhabited = pair.iter().all(|frame| frame.lowest_foot.is_some());
            (pair[1].time - pair[0].time, is_inhabited)
        });
        usual_rate(steps).map_or(RATE, |rate| rate.min(MOST_RATE))
    }

    /// The floor of the last frame that knows one.
    pub fn floor(&self) -> Option<World> {
        let known = self.frames.iter().rev().find(|f| f.world.is_known());
        known.map(|f| f.world)
    }
}

/// How far down the lowest foot of these people is, metres; `None` where there are none.
pub(super) fn lowest_foot(bodies: &[Body]) -> Option<f32> {
    let feet = bodies
        .iter()
        .flat_map(|body| FEET.map(|joint| body.joints3d[joint][1]));
    feet.reduce(f32::max)
}

/// The id that two of a frame's bodies have, if any do: no format could tell them apart.
fn doubled(frame: &BodyFrame) -> Option<u32> {
    let bodies = frame.bodies();
    let is_known = |k: usize| bodies[..k].iter().any(|other| other.id == bodies[k].id);
    (0..bodies.len())
        .find(|k| is_known(*k))
        .map(|k| bodies[k].id)
}

fn no_person(name: &str, id: u32, ids: &BTreeSet<u32>) -> ExportError {
    let mut there: Vec<String> = ids.iter().take(MOST_LISTED).map(u32::to_string).collect();
    if ids.len() > MOST_LISTED {
        there.push(format!("… {} in all", ids.len()));
    }
    ExportError::NoPerson {
        name: name.to_owned(),
        id,
        there: there.join(", "),
    }
}
