//! Observations of several cameras, each at its own times, go in; what all of them saw at one instant comes out.
//!
//! Instants are the capture times of the fastest camera. What another saw then is interpolated in the picture between
//! its frames before and after: joints of one person go along a straight line, other values are those of the nearer
//! frame. Where its next frame does not come in time, the last one counts if it is no more than 25 ms older.
//!
//! In time is 100 ms after that frame is due, by the interval and the latency that the camera has had. A camera that
//! has been silent for 100 ms, or for twice its own interval where that is longer, is not waited for; it counts again
//! with its next frame. Nor is one that sees nobody.
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
const KEPT: usize = 256;
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
        let is_file = self.frames.back().is_some_and(|f| f.file_time);
        let silent = if is_file { PATIENCE_FILES } else { SILENT };
        let limit = silent.max(self.interval.map_or(0, |i| 2 * i as u64));
        !self.ended && self.arrived.is_some_and(|a| now.saturating_sub(a) <= limit)
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
                let share = off(b) as f64 / (a.capture_ns - b.capture_ns) as f64;
                Some(if share < 0.5 {
                    between(&b.people, &a.people, share)
                } else {
                    between(&a.people, &b.people, 1.0 - share)
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
}

impl Synchroniser {
    /// For so many cameras.
    pub fn new(cameras: usize) -> Self {
        Self {
            streams: vec![Stream::default(); cameras],
            lead: 0,
            last: None,
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
        self.last = Some(instant);
        for (stream, view) in self.streams.iter_mut().zip(&set.views) {
            stream.joined |= view.is_some();
            stream.forget(instant);
        }
        Some(set)
    }

    /// Times begin anew where the leading camera's are those of another recording than the last instant's. One that has
    /// shown instants is only late.
    fn start_over(&mut self) {
        let lead = &self.streams[self.lead];
        let newest = lead.newest().filter(|_| !lead.joined);
        let is_over = |last: u64| newest.is_some_and(|n| n.saturating_add(RESTART_NS) < last);
        if self.last.is_some_and(is_over) {
            self.last = None;
        }
    }

    /// The fastest camera that counts; one that has ended or dropped out while frames of it are left.
    fn choose_lead(&mut self, now: u64) {
        let streams = &self.streams;
        let has_more = |s: &Stream| s.pending(self.last).is_some();
        let interval = |k: usize| streams[k].interval.unwrap_or(f64::INFINITY);
        let fastest = (0..streams.len())
            .filter(|&k| streams[k].is_live(now))
            .min_by(|a, b| interval(*a).total_cmp(&interval(*b)));
        let own = &streams[self.lead];
        match fastest {
            Some(k) if own.is_live(now) => {
                if interval(k) < FASTER * interval(self.lead) {
                    self.lead = k;
                }
            }
            _ if has_more(own) => {}
            Some(k) => self.lead = k,
            None => {
                if let Some(k) = streams.iter().position(has_more) {
                    self.lead = k;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// A frame of somebody whose joints are at x = 1 pixel a millisecond.
    fn frame(ms: u64) -> ObservationFrame {
        let mut frame = ObservationFrame {
            capture_ns: ms * MS,
            count: 1,
            ..ObservationFrame::default()
        };
        for (j, joint) in frame.people[0].joints2d.iter_mut().enumerate() {
            *joint = [ms as f32, 40.0 * j as f32, 0.9];
        }
        frame
    }

    fn x(set: &FrameSet, view: usize) -> Option<f32> {
        Some(set.views[view].as_ref()?.first()?.joints2d[3][0])
    }

    /// Milliseconds between a camera's frames, from 0 to its first one, and from capture to arrival.
    #[derive(Debug, Clone, Copy)]
    struct Camera(u64, u64, u64);

    /// What comes out of cameras within so many milliseconds, and the one at which it does. `skip` leaves out frames,
    /// by camera and time of capture.
    fn timed(
        cameras: &[Camera],
        ms: u64,
        skip: impl Fn(usize, u64) -> bool,
    ) -> Vec<(u64, FrameSet)> {
        let mut sync = Synchroniser::new(cameras.len());
        let mut out = Vec::new();
        for now in 0..ms {
            for (k, &Camera(interval, offset, latency)) in cameras.iter().enumerate() {
                let taken = now.checked_sub(latency + offset);
                if let Some(t) = taken.filter(|t| t % interval == 0 && !skip(k, t + offset)) {
                    sync.push(k, &frame(t + offset), now * MS);
                }
            }
            while let Some(set) = sync.next(now * MS) {
                out.push((now, set));
            }
        }
        out
    }

    /// The same without when, of intervals and offsets; frames arrive 20 ms after capture.
    fn run(cameras: &[(u64, u64)], ms: u64, skip: impl Fn(usize, u64) -> bool) -> Vec<FrameSet> {
        let cameras: Vec<_> = cameras.iter().map(|&(i, o)| Camera(i, o, 20)).collect();
        let sets = timed(&cameras, ms, skip);
        sets.into_iter().map(|(_, set)| set).collect()
    }

    /// Replays at a tenth of the speed: frames of 33 ms come every 330 ms.
    #[test]
    fn slow_replays_of_files_are_together() {
        let mut sync = Synchroniser::new(2);
        let mut sets = Vec::new();
        for now in 0..6000 {
            for (camera, offset) in [0, 5].into_iter().enumerate() {
                let shown = now / 10;
                if now % 10 == 0 && shown >= offset && (shown - offset) % 33 == 0 {
                    let file = ObservationFrame {
                        flags: FLAG_FILE_TIME,
                        ..frame(shown)
                    };
                    sync.push(camera, &file, now * MS);
                }
            }
            sets.extend(std::iter::from_fn(|| sync.next(now * MS)));
        }
        assert!(sets.len() > 15, "{}", sets.len());
        for set in sets.iter().skip(1) {
            let at = set.capture_ns / MS;
            assert!(set.views.iter().all(Option::is_some), "at {at}");
        }
    }

    /// Once their rates are known, cameras that both see somebody are together in every instant.
    fn assert_together(cameras: [Camera; 2]) {
        let sets = timed(&cameras, 5000, |_, _| false);
        let times = sets.iter().map(|(_, s)| s.capture_ns / MS);
        assert!(times.max() > Some(4000), "{cameras:?}: nothing comes");
        for (_, set) in sets.iter().filter(|(now, _)| *now > 1500) {
            let at = set.capture_ns / MS;
            assert!(set.views.iter().all(Option::is_some), "{cameras:?}: {at}");
        }
    }

    #[test]
    fn instants_are_those_of_the_fastest_and_the_others_are_interpolated() {
        let sets = run(&[(40, 0), (33, 7), (50, 11)], 1500, |_, _| false);
        let late: Vec<_> = sets.iter().skip(5).collect();
        assert!(late.len() > 35, "{}", late.len());
        for pair in late.windows(2) {
            assert_eq!(pair[1].capture_ns - pair[0].capture_ns, 33 * MS);
        }
        for set in late {
            let at = set.capture_ns as f64 / MS as f64;
            for view in 0..3 {
                let x = x(set, view).expect("all are seen");
                // Frames no more than 2 ms apart are of one instant.
                let off = (f64::from(x) - at).abs();
                assert!(off <= 2.0, "view {view}: {x} at {at}");
            }
        }
    }

    #[test]
    fn a_silent_camera_drops_out_after_100_ms_and_returns() {
        let silent = 600..1000;
        let sets = run(&[(33, 0), (33, 5)], 1600, |k, t| {
            k == 1 && silent.contains(&t)
        });
        let times: Vec<u64> = sets.iter().map(|s| s.capture_ns / MS).collect();
        assert!(times.windows(2).all(|w| w[1] - w[0] == 33), "{times:?}");
        assert!(times.last() > Some(&1500), "{times:?}: nothing comes");
        for set in &sets {
            let t = set.capture_ns / MS;
            let seen = set.views[1].is_some();
            if (640..990).contains(&t) {
                assert!(!seen, "silent at {t}");
            }
            if t > 60 && t < 590 || t > 1040 && t < 1500 {
                assert!(seen, "there at {t}");
            }
        }
    }

    #[test]
    fn an_end_is_one_of_all() {
        let mut sync = Synchroniser::new(2);
        let end = ObservationFrame {
            flags: FLAG_END_OF_STREAM,
            ..ObservationFrame::default()
        };
        sync.push(0, &frame(0), 0);
        sync.push(0, &frame(33), 33 * MS);
        sync.push(0, &end, 34 * MS);
        assert!(!sync.has_ended(), "the other has not come yet");
        sync.push(1, &frame(0), 40 * MS);
        sync.push(1, &end, 41 * MS);
        assert!(sync.has_ended());
        // What has come before the end is not lost.
        let left = std::iter::from_fn(|| sync.next(50 * MS)).count();
        assert_eq!(left, 2);
        sync.push(1, &frame(70), 80 * MS);
        assert!(!sync.has_ended(), "one that goes on has not ended");
    }

    #[test]
    fn slow_cameras_are_together_at_any_phase() {
        for [a, b] in [[200, 200], [167, 167], [167, 200], [250, 250], [300, 300]] {
            for phase in (0..b).step_by(10) {
                assert_together([Camera(a, 0, 170), Camera(b, phase, 170)]);
            }
        }
    }

    #[test]
    fn cameras_of_unequal_latencies_are_together() {
        let fast = Camera(33, 0, 40);
        for (interval, latency) in [(167, 170), (167, 250), (67, 200), (33, 400)] {
            for phase in [0, 5, 30] {
                let late = Camera(interval, phase, latency);
                assert_together([fast, late]);
                assert_together([late, fast]);
            }
        }
    }

    #[test]
    fn instants_of_fast_cameras_are_out_as_soon_as_all_have_shown_them() {
        for phase in 3..31 {
            let sets = timed(&[Camera(33, 0, 40), Camera(33, phase, 40)], 3000, |_, _| {
                false
            });
            let late: Vec<_> = sets.iter().filter(|(now, _)| *now > 500).collect();
            assert!(late.len() > 70, "{phase}: {}", late.len());
            for (now, set) in late {
                assert_eq!(now - set.capture_ns / MS, 40 + phase);
            }
        }
    }

    #[test]
    fn a_slow_camera_that_dies_holds_the_others_up_for_once() {
        let cameras = [Camera(33, 0, 40), Camera(167, 0, 250)];
        let sets = timed(&cameras, 5000, |k, t| k == 1 && t > 2500);
        let (mut together, mut alone) = (0, 0);
        for (now, set) in sets.iter().filter(|(now, _)| *now > 1500) {
            let waited = now - set.capture_ns / MS - 40;
            // Its frame after the instant comes no later than one interval and 210 ms after the other's.
            assert!(waited <= 100 + 167 + 210, "{waited} at {now}");
            // Its last frame is of 2338.
            together += usize::from(set.views[1].is_some());
            if *now > 2338 + 250 + 2 * 167 + 1 {
                alone += 1;
                assert_eq!(waited, 0, "at {now}");
            }
        }
        assert!(together > 30 && alone > 50, "{together}, {alone}");
    }

    #[test]
    fn cameras_that_cannot_come_in_time_hold_the_others_up_no_more_than_others() {
        // One is seconds late, frames of the other are too far apart to interpolate.
        for other in [Camera(33, 0, 3000), Camera(600, 500, 40)] {
            let sets = timed(&[Camera(33, 0, 40), other], 9000, |_, _| false);
            let late: Vec<_> = sets.iter().filter(|(now, _)| *now > 6000).collect();
            assert!(late.len() > 80, "{other:?}: {}", late.len());
            for (now, set) in late {
                let waited = now - set.capture_ns / MS - 40;
                assert!(waited <= 100, "{other:?}: {waited} at {now}");
            }
        }
    }

    /// Why the second of two cameras is left out after some seconds.
    fn left_out(other: Camera) -> Option<LeftOut> {
        let mut sync = Synchroniser::new(2);
        for now in 0..9000u64 {
            for (k, Camera(interval, offset, latency)) in
                [Camera(33, 0, 40), other].into_iter().enumerate()
            {
                let taken = now.checked_sub(latency + offset);
                if let Some(t) = taken.filter(|t| t % interval == 0) {
                    sync.push(k, &frame(t + offset), now * MS);
                }
            }
            while sync.next(now * MS).is_some() {}
            assert_eq!(sync.left_out(0, now * MS), None, "the one that leads");
        }
        sync.left_out(1, 9000 * MS)
    }

    #[test]
    fn why_a_camera_is_left_out_is_known() {
        let near = |found: f64, expected: f64| (found - expected).abs() < 0.01;
        for together in [Camera(33, 5, 40), Camera(200, 0, 400), Camera(380, 0, 300)] {
            assert_eq!(left_out(together), None, "{together:?}");
        }
        let slow = left_out(Camera(600, 500, 40));
        assert!(
            matches!(slow, Some(LeftOut::Slow(s)) if near(s, 0.6)),
            "{slow:?}"
        );
        let late = left_out(Camera(33, 0, 3000));
        assert!(
            matches!(late, Some(LeftOut::Late(s)) if near(s, 2.993)),
            "{late:?}"
        );
    }

    /// Replays into a fit that is left running: the one that leads ends, the other starts over, the first ends.
    #[test]
    fn a_camera_that_started_over_is_not_silent_when_it_takes_the_lead() {
        let mut sync = Synchroniser::new(2);
        let end = ObservationFrame {
            flags: FLAG_END_OF_STREAM,
            ..ObservationFrame::default()
        };
        let mut out = Vec::new();
        for k in 0..600 {
            let now = 33 * k;
            match k {
                // Both of a file of a minute, near its end.
                0..200 => sync.push(0, &frame(50_000 + now), now * MS),
                200 => sync.push(0, &end, now * MS),
                // From the beginning.
                300.. => sync.push(0, &frame(33 * (k - 300)), now * MS),
                _ => {}
            }
            match k {
                0..400 => sync.push(1, &frame(50_000 + now), now * MS),
                400 => sync.push(1, &end, now * MS),
                _ => {}
            }
            while let Some(set) = sync.next(now * MS) {
                out.push((k, set.capture_ns / MS));
            }
        }
        let late: Vec<_> = out.iter().filter(|(k, _)| *k > 420).collect();
        assert!(late.len() > 170, "{} instants", late.len());
        for (k, at) in late {
            assert!(*at <= 33 * (k - 300), "{at}");
        }
    }

    #[test]
    fn a_camera_that_looks_seldom_does_not_take_the_times_back() {
        let mut sync = Synchroniser::new(2);
        let mut times = Vec::new();
        for now in 0..4000 {
            // The one that leads falters while the newest frame of the other is 0.8 s old.
            if now % 33 == 0 && !(1700..1900).contains(&now) {
                sync.push(0, &frame(now), now * MS);
            }
            if now % 900 == 0 {
                let mut nobody = frame(now);
                nobody.count = 0;
                sync.push(1, &nobody, now * MS);
            }
            times.extend(std::iter::from_fn(|| sync.next(now * MS)).map(|s| s.capture_ns));
        }
        assert!(times.len() > 100 && times.is_sorted(), "{times:?}");
    }
}
