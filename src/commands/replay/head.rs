//! What is known of a record before it is played.

use std::path::Path;
use std::time::Instant;

use edgecap_client::Message;
use edgecap_client::message::FLAG_FILE_TIME;

use super::clock::Clock;
use super::records::{bodies, observations, open};
use crate::metrics::About;
use crate::record::clock::{Stamp, usual_step};
use crate::record::{Kind, Times};

/// So many frames at a record's beginning tell whether its times say anything.
const HEAD: usize = 1000;

/// What a record's first frames tell of its times.
#[derive(Debug)]
pub struct Head {
    /// `None` of what is no record.
    pub kind: Option<Kind>,
    /// When the first is due; `None` where there is none.
    pub first: Option<u64>,
    /// Usually between two, nanoseconds; `None` where times do not rise.
    pub step: Option<u64>,
    /// What there is to say of its source.
    pub about: About,
}

impl Head {
    /// Of a record; `keeps_times`: frames are due by their times of capture.
    ///
    /// # Errors
    /// A record that cannot be read, or of which the first frame is damaged.
    pub fn read(record: &Path, keeps_times: bool) -> anyhow::Result<Self> {
        let mut stamps = Vec::new();
        let (mut is_file, mut has_picture) = (keeps_times, true);
        let kind = Kind::of(&mut open(record)?);
        let read = match kind {
            Some(Kind::Bodies) => bodies(record, &mut |frame| {
                is_file |= has_file_time(frame);
                // Several cameras that see the same people have no one picture.
                has_picture &= frame.is_end() || frame.width > 0;
                Ok(Self::takes(&mut stamps, frame, keeps_times))
            }),
            Some(Kind::Observations) => observations(record, &mut |frame| {
                is_file |= has_file_time(frame);
                Ok(Self::takes(&mut stamps, frame, keeps_times))
            }),
            None => Ok(false),
        };
        // What is wrong after frames is said where these have been played.
        if stamps.is_empty() {
            read?;
        }
        let step = usual_step(&stamps);
        Ok(Self {
            kind,
            first: stamps.first().map(|(_, due)| *due),
            step,
            about: About {
                is_file,
                is_sequence: has_picture && step.is_some(),
                is_replayed: true,
                ..About::default()
            },
        })
    }

    /// Whether the record, of which times of capture are kept, has no frame that is due at `time` or later; `false`
    /// where the user stops the look.
    pub fn ends_before(&self, record: &Path, time: u64, is_stopped: impl Fn() -> bool) -> bool {
        let mut clock = Clock::new(1.0, Instant::now(), self.step, None);
        let mut goes_on = false;
        let mut look = |due| {
            goes_on = clock.look(due) >= time || is_stopped();
            Ok(!goes_on)
        };
        let read = match self.kind {
            Some(Kind::Bodies) => bodies(record, &mut |frame| match frame.is_end() {
                true => Ok(true),
                false => look(kept_ns(frame)),
            }),
            Some(Kind::Observations) => observations(record, &mut |frame| look(kept_ns(frame))),
            None => Ok(false),
        };
        // What is wrong after frames is said where these have been played.
        read.is_ok() && !goes_on
    }

    /// Takes another frame's stamp; whether more are wanted. The end of a publisher is no frame, and its time may be
    /// none.
    fn takes<M: Times + Copy>(stamps: &mut Vec<Stamp>, frame: &M, keeps_times: bool) -> bool {
        if frame.is_end() {
            return true;
        }
        let due = match keeps_times {
            true => kept_ns(frame),
            false => frame.due_ns(),
        };
        stamps.push((frame.number(), due));
        stamps.len() < HEAD
    }
}

fn has_file_time(frame: &impl Message) -> bool {
    frame.flags() & FLAG_FILE_TIME != 0
}

/// When a frame is due whose times of capture are kept.
fn kept_ns<M: Times + Copy>(frame: &M) -> u64 {
    let mut frame = Box::new(*frame);
    frame.keep_times();
    frame.due_ns()
}

/// The records that begin when all that began before have ended, as those of two machines' clocks do, and how long
/// after the first of all, seconds. `ends_before` says whether a record has no frame from that time on.
pub fn detached(heads: &[Head], ends_before: impl Fn(usize, u64) -> bool) -> Vec<(usize, f64)> {
    let firsts = heads.iter().enumerate();
    let mut firsts: Vec<(u64, usize)> = firsts
        .filter_map(|(n, head)| Some((head.first?, n)))
        .collect();
    firsts.sort_unstable();
    let mut found = Vec::new();
    for (k, &(first, record)) in firsts.iter().enumerate().skip(1) {
        if firsts[..k].iter().all(|&(_, n)| ends_before(n, first)) {
            found.push((record, (first - firsts[0].0) as f64 / 1e9));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::{BodyFrame, FLAG_END_OF_STREAM};
    use crate::record::{BodiesRow, Format, RecordWriter};

    #[test]
    fn a_record_that_begins_when_those_before_have_ended_is_of_another_clock() {
        const SECOND: u64 = 1_000_000_000;
        let detached = |takes: &[(u64, u64)]| {
            let head = |&(first, _): &(u64, u64)| Head {
                kind: Some(Kind::Bodies),
                first: Some(first * SECOND),
                step: None,
                about: About::default(),
            };
            let heads: Vec<Head> = takes.iter().map(head).collect();
            super::detached(&heads, |n, time| takes[n].1 * SECOND < time)
        };
        assert!(detached(&[(500, 600), (520, 580), (590, 700)]).is_empty());
        let days = 864_000;
        assert_eq!(
            detached(&[(days + 7, days + 90), (7, 90)]),
            [(0, days as f64)]
        );
        let pair = (days, days + 60);
        assert_eq!(
            detached(&[(0, 60), pair, pair]),
            [(1, days as f64)],
            "the third begins with the second"
        );
    }

    #[test]
    fn how_long_a_record_lasts_is_looked_for_up_to_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.record");
        let mut writer = RecordWriter::<BodiesRow>::create(&path, Format::Binary).unwrap();
        // Published an hour after it was captured; another recording follows.
        for (sequence, pose_ns) in [(0, 900), (1, 940), (0, 0), (1, 40)] {
            let frame = BodyFrame {
                sequence,
                pose_ns: pose_ns * 1_000_000,
                publish_ns: 3_600_000_000_000,
                ..BodyFrame::default()
            };
            writer.write(&frame, "").unwrap();
        }
        writer.finish().unwrap();
        let head = Head::read(&path, true).unwrap();
        let lasts = [1_020, 1_021].map(|ms| !head.ends_before(&path, ms * 1_000_000, || false));
        assert_eq!(lasts, [true, false]);
    }

    #[test]
    fn ends_of_publishers_tell_no_times() {
        const MS: u64 = 1_000_000;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.record");
        let mut writer = RecordWriter::<BodiesRow>::create(&path, Format::Binary).unwrap();
        // Of a publisher that published nothing else.
        let end = BodyFrame {
            flags: FLAG_END_OF_STREAM,
            ..BodyFrame::default()
        };
        for (sequence, pose_ns) in [(0, 7_000 * MS), (1, 7_040 * MS)] {
            let frame = BodyFrame {
                sequence,
                pose_ns,
                ..BodyFrame::default()
            };
            writer.write(&end, "").unwrap();
            writer.write(&frame, "").unwrap();
        }
        writer.finish().unwrap();
        let head = Head::read(&path, true).unwrap();
        assert_eq!((head.first, head.step), (Some(7_000 * MS), Some(40 * MS)));
        // Its times are kept; without a picture it is a room's.
        assert!(head.about.is_file && !head.about.is_sequence);
        let lasts = [7_040, 7_041].map(|ms| !head.ends_before(&path, ms * MS, || false));
        assert_eq!(lasts, [true, false]);
    }
}
