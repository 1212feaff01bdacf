//! A whole record in memory: frames, and everybody's samples.

use std::collections::BTreeMap;
use std::io::BufRead;

use super::error::ExportError;
use crate::message::{Body, World};
use crate::record::{BodiesRow, RowReader};

/// Frames a second of a record whose times say nothing, such as one of photos.
const RATE: f64 = 30.0;
/// People listed in an error.
const MOST_LISTED: usize = 20;

/// A frame, without its people.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    /// Its number in the input.
    pub sequence: u64,
    /// Since the first frame, seconds.
    pub time: f64,
    /// As it was known then.
    pub world: World,
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
    /// By rising time.
    pub frames: Vec<Frame>,
    /// Everybody's samples by id, by rising time.
    pub people: BTreeMap<u32, Vec<Sample>>,
    /// Whether the file ended inside a frame, which was left out.
    pub was_cut: bool,
}

impl Take {
    /// Reads a record of bodies in either format; `name` is what errors call it.
    ///
    /// # Errors
    /// What is wrong with the record; [`ExportError::Empty`] where nobody is in it.
    pub fn read(input: impl BufRead, name: &str) -> Result<Self, ExportError> {
        let mut rows = RowReader::<_, BodiesRow>::new(input, name);
        let mut take = Self::default();
        let mut times = Vec::new();
        while let Some(row) = rows.read()? {
            let message = row.message();
            let index = take.frames.len();
            times.push(message.pose_ns);
            take.frames.push(Frame {
                sequence: message.sequence,
                time: 0.0,
                world: message.world,
            });
            for body in message.bodies() {
                let samples = take.people.entry(body.id).or_default();
                // Twice in one frame: the first stays.
                if samples.last().is_none_or(|s| s.frame != index) {
                    samples.push(Sample {
                        frame: index,
                        body: *body,
                    });
                }
            }
        }
        take.was_cut = rows.was_cut();
        if take.people.is_empty() {
            return Err(ExportError::Empty {
                name: name.to_owned(),
                frames: take.frames.len() as u64,
            });
        }
        let rises = times.windows(2).all(|w| w[0] < w[1]);
        for (index, frame) in take.frames.iter_mut().enumerate() {
            frame.time = if rises {
                (times[index] - times[0]) as f64 * 1e-9
            } else {
                index as f64 / RATE
            };
        }
        Ok(take)
    }

    /// Leaves everybody out but one.
    ///
    /// # Errors
    /// [`ExportError::NoPerson`].
    pub fn only(&mut self, id: u32, name: &str) -> Result<(), ExportError> {
        if !self.people.contains_key(&id) {
            let ids = self.people.keys().take(MOST_LISTED);
            let mut there: Vec<String> = ids.map(u32::to_string).collect();
            if self.people.len() > MOST_LISTED {
                there.push(format!("… {} in all", self.people.len()));
            }
            return Err(ExportError::NoPerson {
                name: name.to_owned(),
                id,
                there: there.join(", "),
            });
        }
        self.people.retain(|other, _| *other == id);
        Ok(())
    }

    /// Everybody, by rising id.
    pub fn ids(&self) -> Vec<u32> {
        self.people.keys().copied().collect()
    }

    /// Frames a second: of the median step.
    pub fn rate(&self) -> f64 {
        let steps = self.frames.windows(2).map(|w| w[1].time - w[0].time);
        let mut steps: Vec<f64> = steps.collect();
        steps.sort_by(f64::total_cmp);
        steps.get(steps.len() / 2).map_or(RATE, |step| 1.0 / step)
    }

    /// The floor of the last frame that knows one.
    pub fn floor(&self) -> Option<World> {
        let known = self.frames.iter().rev().find(|f| f.world.is_known());
        known.map(|f| f.world)
    }
}
