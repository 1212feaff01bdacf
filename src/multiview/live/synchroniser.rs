//! Observations of several cameras, each at its own times, go in; what all of them saw at one instant comes out.
//!
//! Instants are the capture times of the fastest camera. What another saw then is interpolated in the picture between
//! its frames before and after: joints of one person go along a straight line, other values are those of the nearer
//! frame. Where its next frame does not come in time, the last one counts if it is no more than 25 ms older.
//!
//! In time is 100 ms after that frame is due, by the interval and the latency that the camera has had. A camera that
//! has been silent for 100 ms, or for twice its own interval where that is longer, is not waited for; it counts again
//! with its next frame. Nor is one that sees nobody. One whose frames come 0.9 s later than usual among cameras that
//! see somebody gives no instants while these come.
//!
//! Pure: times come from frames and from the caller.

use std::collections::VecDeque;

use crate::camera::RESTART_NS;
use crate::message::{
    FLAG_END_OF_STREAM, FLAG_FILE_TIME, Observation, ObservationFrame, StageTimes,
};
use crate::multiview::between;

/// A camera without a frame for so long has dropped out, nanoseconds; a file's after [`PATIENCE_FILES`].
const SILENT: u64 = 100_000_000;
/// A frame is waited for until so long after it is due, …
const PATIENCE: u64 = 100_000_000;
/// … where it is due no later than this after the leading camera's came. Bodies of all would be late for its sake.
const LATEST: u64 = 900_000_000;
/// Share of [`LATEST`] by which a camera that does not lead may come late to take the lead: one near the limit would
/// take it and lose it again and again.
const FIT_TO_LEAD: f64 = 0.8;
/// Replays of files start one after the other, and may be slow: their frames are waited for so long.
const PATIENCE_FILES: u64 = 2_000_000_000;
/// Frames nearer than this are of one instant.
const SAME: u64 = 2_000_000;
/// A frame that is so much older than the instant still tells where people are.
const NEAR: u64 = 25_000_000;
/// Longest time between two frames that is interpolated.
const GAP: u64 = 400_000_000;
/// Longer than this between two frames is a pause, which does not tell how fast a camera is.
const PAUSE: u64 = 1_000_000_000;
/// Frames of a camera that are kept.
const KEPT: usize = 512;
/// Frames that wait for other cameras at most; so many more than these may come at once that none is lost.
const WAITING: usize = 384;
/// A camera takes the lead where its interval is a smaller share of the leading one's than this.
const FASTER: f64 = 0.9;

/// Why what a camera sees is in no instant, though its frames come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LeftOut {
    /// Seconds between its frames, too many to interpolate.
    Slow(f64),
    /// Seconds by which its frames come later than the leading camera's, more than are waited for.
    Late(f64),
}

impl LeftOut {
    /// Seconds between two frames that are interpolated at most.
    pub const MOST_APART: f64 = 1e-9 * GAP as f64;
    /// Seconds after the leading camera's that a frame is waited for at most.
    pub const LATEST: f64 = 1e-9 * LATEST as f64;
}

/// What all cameras saw at one instant.
#[derive(Debug, Clone)]
pub struct FrameSet {
    /// The instant, nanoseconds on the cameras' clock.
    pub capture_ns: u64,
    /// Whether that clock is a file's.
    pub file_time: bool,
    /// How long the stages of `infer` took for the leading camera's picture.
    pub stage_times: StageTimes,
    /// By camera who was seen; `None` where it has dropped out.
    pub views: Vec<Option<Vec<Observation>>>,
}

#[derive(Debug, Clone)]
struct Seen {
    capture_ns: u64,
    /// On the caller's clock.
    arrived: u64,
    file_time: bool,
    stage_times: StageTimes,
    people: Vec<Observation>,
}

impl Seen {
    /// From capture to arrival, nanoseconds. The two clocks of a replay have nothing to do with each other: only
    /// differences between cameras mean something.
    fn latency(&self) -> f64 {
        self.arrived as f64 - self.capture_ns as f64
    }
}

#[derive(Debug, Clone, Default)]
struct Stream {
    /// By rising time.
    frames: VecDeque<Seen>,
    arrived: Option<u64>,
    /// Between frames, nanoseconds.
    interval: Option<f64>,
    /// From capture to arrival, nanoseconds.
    latency: Option<f64>,
    /// Whether it has shown an instant, so that its times go with those of the others.
    joined: bool,
    ended: bool,
}

impl Stream {
    fn is_live(&self, now: u64) -> bool {
        // The interval of a file is that of its own clock, and replays may be slower.
        let silent = match self.is_file() {
            true => PATIENCE_FILES,
            false => SILENT,
        };
        let limit = silent.max(self.interval.map_or(0, |i| 2 * i as u64));
        !self.ended && self.arrived.is_some_and(|a| now.saturating_sub(a) <= limit)
    }

    fn is_file(&self) -> bool {
        self.frames.back().is_some_and(|f| f.file_time)
    }

    fn newest(&self) -> Option<u64> {
        self.frames.back().map(|f| f.capture_ns)
    }

    /// How long after the leading camera's frame came one of this camera is waited for, nanoseconds.
    fn patience(&self, pending: &Seen) -> u64 {
        if pending.file_time {
            return PATIENCE_FILES;
        }
        let late = self.late_after(pending.latency()).unwrap_or(0.0);
        let late = late.max(0.0) as u64;
        if late > LATEST {
            PATIENCE
        } else {
            PATIENCE + late
        }
    }

    /// How long after a frame of such latency came the next one of this camera is due, nanoseconds.
    fn late_after(&self, latency: f64) -> Option<f64> {
        // Of what is between frames farther apart the next one tells nothing.
        let step = self.interval.filter(|i| *i <= GAP as f64).unwrap_or(0.0);
        self.latency.map(|own| own + step - latency)
    }

    /// Takes in a frame, which is newer than the others, and how fast and how late the camera is.
    fn push(&mut self, seen: Seen) {
        if let Some(newest) = self.newest() {
            let step = (seen.capture_ns - newest).min(PAUSE);
            smooth(&mut self.interval, step as f64);
        }
        smooth(&mut self.latency, seen.latency());
        self.ended = false;
        self.arrived = Some(seen.arrived);
        if self.frames.len() == KEPT {
            self.frames.pop_front();
        }
        self.frames.push_back(seen);
    }

    /// Leaves out what no later instant needs.
    fn forget(&mut self, instant: u64) {
        // One before the instant stays, to interpolate from.
        while self.frames.len() > 1 && self.frames[1].capture_ns <= instant {
            self.frames.pop_front();
        }
    }

    /// The first frame after an instant.
    fn pending(&self, after: Option<u64>) -> Option<&Seen> {
        self.frames
            .iter()
            .find(|f| after.is_none_or(|a| f.capture_ns > a))
    }

    /// Frames after an instant.
    fn waiting(&self, after: Option<u64>) -> usize {
        let is_before = |f: &Seen| after.is_some_and(|a| f.capture_ns <= a);
        self.frames.len() - self.frames.partition_point(is_before)
    }

    /// Who was seen at an instant; `None` where that is not known.
    fn at(&self, instant: u64) -> Option<Vec<Observation>> {
        let next = self.frames.partition_point(|f| f.capture_ns <= instant);
        let before = next.checked_sub(1).map(|k| &self.frames[k]);
        let after = self.frames.get(next);
        let off = |f: &Seen| f.capture_ns.abs_diff(instant);
        let nearest = [before, after]
            .into_iter()
            .flatten()
            .min_by_key(|f| off(f))?;
        if off(nearest) <= SAME {
            return Some(nearest.people.clone());
        }
        match (before, after) {
            (Some(b), Some(a)) if a.capture_ns - b.capture_ns <= GAP => {
                let apart = (a.capture_ns - b.capture_ns) as f64;
                let (share, seconds) = (off(b) as f64 / apart, 1e-9 * apart);
                Some(if share < 0.5 {
                    between(&b.people, &a.people, share, seconds)
                } else {
                    between(&a.people, &b.people, 1.0 - share, seconds)
                })
            }
            _ => (off(nearest) <= NEAR).then(|| nearest.people.clone()),
        }
    }
}

/// Lets a new value count a tenth.
fn smooth(usual: &mut Option<f64>, value: f64) {
    let usual = usual.get_or_insert(value);
    *usual += 0.1 * (value - *usual);
}

/// Brings the observations of several cameras to common instants.
#[derive(Debug, Clone)]
pub struct Synchroniser {
    streams: Vec<Stream>,
    lead: usize,
    /// The newest instant that was given out.
    last: Option<u64>,
    /// Whether that was of a file's clock.
    of_file: bool,
}

impl Synchroniser {
    /// For so many cameras.
    pub fn new(cameras: usize) -> Self {
        Self {
            streams: vec![Stream::default(); cameras],
            lead: 0,
            last: None,
            of_file: false,
        }
    }

    /// Takes in a frame that came at `now`, nanoseconds. One that is not newer than the camera's last is left out;
    /// times that go back by more than half a second start the camera over.
    pub fn push(&mut self, camera: usize, frame: &ObservationFrame, now: u64) {
        let is_lead = camera == self.lead;
        let stream = &mut self.streams[camera];
        if frame.flags & FLAG_END_OF_STREAM != 0 {
            stream.ended = true;
            return;
        }
        if let Some(newest) = stream.newest() {
            if frame.capture_ns.saturating_add(RESTART_NS) < newest {
                *stream = Stream::default();
                if is_lead {
                    self.last = None;
                }
            } else if frame.capture_ns <= newest {
                return;
            }
        }
        stream.push(Seen {
            capture_ns: frame.capture_ns,
            arrived: now,
            file_time: frame.flags & FLAG_FILE_TIME != 0,
            stage_times: frame.stage_times,
            people: frame.people().to_vec(),
        });
    }

    /// Whether every camera has come and has ended.
    pub fn has_ended(&self) -> bool {
        self.streams.iter().all(|s| s.ended)
    }

    /// Why a camera is in none of the next instants though it comes and sees somebody; `None` where it may be in them,
    /// or is the one that leads.
    pub fn left_out(&self, camera: usize, now: u64) -> Option<LeftOut> {
        let (own, lead) = (&self.streams[camera], &self.streams[self.lead]);
        let newest = own.frames.back().filter(|f| !f.people.is_empty())?;
        if camera == self.lead || newest.file_time || !own.is_live(now) {
            return None;
        }
        let interval = own.interval?;
        if interval > GAP as f64 {
            return Some(LeftOut::Slow(1e-9 * interval));
        }
        let late = own.late_after(lead.latency?)?;
        (late > LATEST as f64).then_some(LeftOut::Late(1e-9 * late))
    }

    /// Whether an instant is known that some camera has not shown yet.
    pub fn is_waiting(&self) -> bool {
        self.streams[self.lead].pending(self.last).is_some()
    }

    /// The next instant, once what was seen then is known of all cameras that count; call it until there is none.
    pub fn next(&mut self, now: u64) -> Option<FrameSet> {
        self.choose_lead(now);
        self.start_over();
        let lead = &self.streams[self.lead];
        let pending = lead.pending(self.last)?;
        let instant = pending.capture_ns;
        let waited = now.saturating_sub(pending.arrived);
        // Who sees nobody looks less often, and will hardly see somebody all at once.
        let is_awaited = |s: &Stream| {
            let newest = s.frames.back().filter(|f| !f.people.is_empty());
            newest.is_some_and(|f| f.capture_ns.saturating_add(SAME) < instant)
                && s.is_live(now)
                && waited < s.patience(pending)
                && lead.waiting(self.last) < WAITING
        };
        if self.streams.iter().any(is_awaited) {
            return None;
        }
        let set = FrameSet {
            capture_ns: instant,
            file_time: pending.file_time,
            stage_times: pending.stage_times,
            views: self.streams.iter().map(|s| s.at(instant)).collect(),
        };
        (self.last, self.of_file) = (Some(instant), set.file_time);
        for (stream, view) in self.streams.iter_mut().zip(&set.views) {
            stream.joined |= view.is_some();
            stream.forget(instant);
        }
        Some(set)
    }

    /// Times begin anew where the leading camera's are those of another recording than the last instant's: not from
    /// frame to frame of the machine's clock, which goes on. One that has shown instants is only late.
    fn start_over(&mut self) {
        let lead = &self.streams[self.lead];
        let may_be_another = |f: &&Seen| !lead.joined && (f.file_time || self.of_file);
        let newest = lead.frames.back().filter(may_be_another);
        let is_over = |last| newest.is_some_and(|n| n.capture_ns.saturating_add(RESTART_NS) < last);
        if self.last.is_some_and(is_over) {
            self.last = None;
        }
    }

    /// Whether a camera's frames come no more than [`LATEST`] after the usual ones of those that come and show
    /// somebody: else all bodies would be late for its sake. One that is to take the lead has to be clearly in time.
    fn is_in_time(&self, camera: usize, now: u64) -> bool {
        let own = &self.streams[camera];
        // Of replays, which start one after the other, latencies tell nothing.
        let live = self
            .streams
            .iter()
            .filter(|s| !s.is_file() && s.is_live(now));
        let seeing = live.filter(|s| s.frames.back().is_some_and(|f| !f.people.is_empty()));
        let mut latencies: Vec<f64> = seeing.filter_map(|s| s.latency).collect();
        latencies.sort_by(f64::total_cmp);
        // The lower middle one: one early camera, or one whose clock is ahead, does not make all others late.
        let usual = latencies.get(latencies.len().saturating_sub(1) / 2);
        let late = own
            .latency
            .zip(usual)
            .map_or(0.0, |(own, usual)| own - usual);
        let share = match camera == self.lead {
            true => 1.0,
            false => FIT_TO_LEAD,
        };
        own.is_file() || late <= share * LATEST as f64
    }

    /// The fastest camera that counts and is in time; one that has ended or dropped out while frames of it are left.
    fn choose_lead(&mut self, now: u64) {
        let streams = &self.streams;
        let has_more = |s: &Stream| s.pending(self.last).is_some();
        let interval = |k: usize| streams[k].interval.unwrap_or(f64::INFINITY);
        // Frames that wait for one that shows no new instant would be lost.
        let is_full = streams.iter().any(|s| s.waiting(self.last) >= WAITING);
        let counts = |k: usize| streams[k].is_live(now) && (!is_full || has_more(&streams[k]));
        let fastest = (0..streams.len())
            .filter(|&k| counts(k) && self.is_in_time(k, now))
            .min_by(|a, b| interval(*a).total_cmp(&interval(*b)));
        let own = &streams[self.lead];
        let next = match fastest {
            Some(k) if counts(self.lead) => {
                let is_faster = interval(k) < FASTER * interval(self.lead);
                (is_faster || !self.is_in_time(self.lead, now)).then_some(k)
            }
            _ if has_more(own) => None,
            Some(k) => Some(k),
            None => streams.iter().position(has_more),
        };
        self.lead = next.unwrap_or(self.lead);
    }
}

#[cfg(test)]
mod tests;
