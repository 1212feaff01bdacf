//! One camera of a run: counted by the supervisor as it happens, read by whoever asks.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use edgecap_client::message::{BodyFrame, FLAG_FILE_TIME};
use rustix::time::{ClockId, clock_gettime};
use serde::{Deserialize, Serialize};

use super::histogram::Histogram;
use super::recent::{Came, Recent};

/// The stages, as figures name them, in the order of a frame.
pub const STAGES: [&str; 5] = ["preprocess", "stage1", "association", "stage2", "fit"];
/// Without a frame for so long nothing goes on, …
const SILENT_AFTER: Duration = Duration::from_secs(3);
/// … or for so many times the interval that was asked for, or at which frames come, where that is longer.
const SILENT_INTERVALS: f64 = 2.5;
/// Frames that are further apart are those of a camera that was away.
const SLOWEST: Duration = Duration::from_secs(60);
/// By so much, seconds, the start may shift before it is reported anew: a clock that is slewed would have it jump back
/// and forth by one.
const START_SHIFT: u64 = 2;

/// What has happened to a camera.
#[derive(Debug)]
pub struct Meter {
    name: String,
    input: String,
    /// What frames' times are counted from.
    began: Instant,
    /// Since this machine started, its sleep counted.
    started: Duration,
    silent_after: Duration,
    counts: Mutex<Counts>,
}

#[derive(Debug, Clone, Default)]
struct Counts {
    frames: u64,
    dropped: u64,
    people: u32,
    stages: [Histogram; STAGES.len()],
    latency: Histogram,
    starts: Vec<(&'static str, Starts)>,
    reconnects: u64,
    is_away: bool,
    /// When, since this machine started, and what.
    last_error: Option<(Duration, String)>,
    /// Start of the run as it was reported last, seconds since 1970.
    since: Option<u64>,
    sequence: Option<u64>,
    highest_id: u32,
    /// Frames since the last pause.
    recent: Recent,
    /// Between the last two frames, and between the two before.
    gaps: [Option<Duration>; 2],
    looked: Option<Instant>,
    ended: bool,
}

/// How often a process was started.
#[derive(Debug, Clone, Copy, Default)]
struct Starts {
    /// Before the camera began anew.
    before: u64,
    since: u64,
}

impl Starts {
    /// Once is not again.
    fn again(self) -> u64 {
        (self.before + self.since).saturating_sub(1)
    }
}

/// How a camera is doing at this moment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// Its name.
    pub name: String,
    /// What is opened.
    pub input: String,
    /// Whether bodies come.
    pub healthy: bool,
    /// Seconds since the supervisor last looked after it.
    pub looked_seconds_ago: Option<f64>,
    /// Whether nobody looks after it any more: it has ended for good.
    pub ended: bool,
    /// Start of the run, seconds since 1970.
    pub since: u64,
    /// Pictures whose bodies were published.
    pub frames: u64,
    /// Pictures that the camera took and nobody looked at.
    pub dropped: u64,
    /// Of the last frames, Hz; 0 where none comes.
    pub fps: f64,
    /// People in the newest frame.
    pub people: u32,
    /// From capture to publication, median of the last frames, milliseconds.
    pub latency_ms: Option<f64>,
    /// The same, which one of a hundred exceeds.
    pub latency_p99_ms: Option<f64>,
    /// How often a process was started again, by its verb.
    pub restarts: Vec<(String, u64)>,
    /// How often the camera came back.
    pub reconnects: u64,
    /// What went wrong last.
    pub last_error: Option<String>,
    /// When, seconds since 1970.
    pub last_error_at: Option<u64>,
    /// What stages took, by [`STAGES`]: the fit for every picture, the others for those that the network looked at.
    #[serde(skip)]
    pub stages: [Histogram; STAGES.len()],
    /// From capture to publication, of every picture.
    #[serde(skip)]
    pub latency: Histogram,
}

impl Meter {
    /// Of a camera that starts now; `processes` are those that may be started again.
    pub fn new(name: &str, input: &str, processes: &[&'static str]) -> Self {
        Self {
            name: name.to_owned(),
            input: input.to_owned(),
            began: Instant::now(),
            started: since_boot(),
            silent_after: SILENT_AFTER,
            counts: Mutex::new(Counts {
                starts: processes.iter().map(|p| (*p, Starts::default())).collect(),
                ..Counts::default()
            }),
        }
    }

    /// The same, of a camera of which no more than one picture an `interval` is wanted.
    #[must_use]
    pub fn with_interval(mut self, interval: Duration) -> Self {
        self.silent_after = SILENT_AFTER.max(interval.mul_f64(SILENT_INTERVALS));
        self
    }

    /// The camera's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Bodies were published.
    pub fn published(&self, frame: &BodyFrame) {
        self.published_at(Instant::now(), frame);
    }

    fn published_at(&self, now: Instant, frame: &BodyFrame) {
        let mut counts = self.counts();
        counts.people = frame.count;
        let ids = frame.bodies().iter().map(|body| body.id);
        counts.highest_id = ids.fold(counts.highest_id, u32::max);
        // Between two pictures bodies may be extrapolated.
        let skipped = match counts.sequence {
            Some(last) if frame.sequence == last => return,
            Some(last) if frame.sequence > last => frame.sequence - last - 1,
            // The first one, or the process that counts has been started again.
            _ => 0,
        };
        counts.sequence = Some(frame.sequence);
        counts.frames += 1;
        counts.dropped += skipped;
        let t = frame.stage_times;
        let times = [
            t.preprocess_us,
            t.stage1_us,
            t.association_us,
            t.stage2_us,
            frame.fit_us,
        ];
        // The network has not looked at a picture that shows what the empty one before it showed, nor at one into which
        // joints were followed.
        let first = if t.stage1_us > 0 { 0 } else { STAGES.len() - 1 };
        for (stage, us) in counts.stages.iter_mut().zip(times).skip(first) {
            stage.observe(f64::from(us) * 1e-6);
        }
        let is_live = frame.flags & FLAG_FILE_TIME == 0;
        let age = is_live.then(|| frame.publish_ns.saturating_sub(frame.capture_ns) as f64 * 1e-9);
        if let Some(age) = age {
            counts.latency.observe(age);
        }
        let at = now.saturating_duration_since(self.began);
        if let Some(newest) = counts.recent.newest() {
            let gap = at.saturating_sub(newest);
            counts.gaps = [Some(gap.min(SLOWEST)), counts.gaps[0]];
            // Time without pictures says nothing of the rate at which they come.
            if gap >= self.patience(&counts) {
                counts.recent.forget();
            }
        }
        counts.recent.take(Came {
            at,
            age,
            sequence: frame.sequence,
            capture_ns: frame.capture_ns,
            is_looked_at: t.stage1_us > 0,
        });
    }

    /// The number of the newest bodies, and the highest id of all; zeros before the first.
    pub fn newest(&self) -> (u64, u32) {
        let counts = self.counts();
        (counts.sequence.unwrap_or_default(), counts.highest_id)
    }

    /// A process has been started so often since the camera began.
    pub fn started(&self, process: &str, starts: u64) {
        let mut counts = self.counts();
        if let Some((_, n)) = counts.starts.iter_mut().find(|(p, _)| *p == process) {
            n.since = starts;
        }
    }

    /// How often a process was started, before the camera began anew, too; 0 of one that nobody counts.
    pub fn starts(&self, process: &str) -> u64 {
        let counts = self.counts();
        let counted = counts.starts.iter().find(|(p, _)| *p == process);
        counted.map_or(0, |(_, n)| n.before + n.since)
    }

    /// The camera has ended and begins anew; so do those who count its processes.
    pub fn begins_anew(&self) {
        for (_, n) in &mut self.counts().starts {
            n.before += std::mem::take(&mut n.since);
        }
    }

    /// Whether a picture of the camera was seen, or it is away and looked for. One whose next picture is not due yet,
    /// or was damaged, is neither: say nothing then.
    pub fn camera(&self, is_there: bool) {
        let mut counts = self.counts();
        if is_there && counts.is_away {
            counts.reconnects += 1;
        }
        // At the start nobody has seen it yet.
        counts.is_away = !is_there && counts.frames > 0;
    }

    /// Something went wrong.
    pub fn failed(&self, what: impl Into<String>) {
        self.counts().last_error = Some((since_boot(), what.into()));
    }

    /// The supervisor has looked after it.
    pub fn looked(&self) {
        self.counts().looked = Some(Instant::now());
    }

    /// It has ended for good, and nobody looks after it any more.
    pub fn ended(&self) {
        let mut counts = self.counts();
        (counts.looked, counts.ended) = (None, true);
    }

    /// How it is doing.
    pub fn snapshot(&self) -> Snapshot {
        self.snapshot_at(Instant::now(), since_boot(), SystemTime::now())
    }

    /// At an instant, so long after this machine started, for which the clock on the wall says `wall`. Times since 1970
    /// are counted back from there: a clock that was wrong when this machine started is set meanwhile.
    fn snapshot_at(&self, now: Instant, boot: Duration, wall: SystemTime) -> Snapshot {
        let at = |then| unix(wall).saturating_sub(boot.saturating_sub(then).as_secs());
        let counts = {
            let mut counts = self.counts();
            let since = at(self.started);
            if counts
                .since
                .is_none_or(|told| told.abs_diff(since) >= START_SHIFT)
            {
                counts.since = Some(since);
            }
            counts.clone()
        };
        let since = now.saturating_duration_since(self.began);
        let newest = counts.recent.newest();
        let newest = newest.map(|came| since.saturating_sub(came));
        let healthy = newest.is_some_and(|age| age < self.patience(&counts));
        let age = |part: f64| counts.recent.age(part).map(|s| 1e3 * s);
        Snapshot {
            name: self.name.clone(),
            input: self.input.clone(),
            healthy,
            looked_seconds_ago: counts.looked.map(|t| t.elapsed().as_secs_f64()),
            ended: counts.ended,
            since: counts.since.unwrap_or_default(),
            frames: counts.frames,
            dropped: counts.dropped,
            fps: if healthy { counts.recent.hz() } else { 0.0 },
            people: if healthy { counts.people } else { 0 },
            latency_ms: age(0.5),
            latency_p99_ms: age(0.99),
            restarts: counts
                .starts
                .iter()
                .map(|(process, n)| ((*process).to_owned(), n.again()))
                .collect(),
            reconnects: counts.reconnects,
            last_error: counts.last_error.as_ref().map(|(_, what)| what.clone()),
            last_error_at: counts.last_error.as_ref().map(|(then, _)| at(*then)),
            stages: counts.stages,
            latency: counts.latency,
        }
    }

    /// How long no frame may come. One gap, of a camera that was away or has stalled, makes no slow one.
    fn patience(&self, counts: &Counts) -> Duration {
        match counts.gaps {
            [Some(last), Some(before)] => {
                let slow = last.min(before).mul_f64(SILENT_INTERVALS);
                self.silent_after.max(slow)
            }
            _ => self.silent_after,
        }
    }

    fn counts(&self) -> MutexGuard<'_, Counts> {
        // Counts are whole between any two statements.
        self.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// How long ago this machine started. `Instant` stands still while it sleeps.
fn since_boot() -> Duration {
    let t = clock_gettime(ClockId::Boottime);
    Duration::new(
        u64::try_from(t.tv_sec).unwrap_or(0),
        u32::try_from(t.tv_nsec).unwrap_or(0),
    )
}

fn unix(time: SystemTime) -> u64 {
    time.duration_since(SystemTime::UNIX_EPOCH)
        .map_or(0, |t| t.as_secs())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(sequence: u64, count: u32) -> BodyFrame {
        BodyFrame {
            sequence,
            count,
            capture_ns: 1_000_000_000,
            publish_ns: 1_040_000_000,
            fit_us: 700,
            ..BodyFrame::default()
        }
    }

    impl Meter {
        fn seen_at(&self, now: Instant) -> Snapshot {
            self.snapshot_at(now, since_boot(), SystemTime::now())
        }
    }

    #[test]
    fn only_who_was_away_comes_back() {
        let meter = Meter::new("hall", "camera", &[]);
        meter.camera(false);
        meter.camera(true);
        assert_eq!(meter.snapshot().reconnects, 0, "nobody has seen it yet");
        meter.published(&frame(0, 0));
        for is_there in [true, true, false, false, true, true] {
            meter.camera(is_there);
        }
        assert_eq!(meter.snapshot().reconnects, 1);
    }

    #[test]
    fn restarts_go_on_where_a_camera_begins_anew() {
        let meter = Meter::new("hall", "camera", &["infer"]);
        let told = |starts: u64| {
            meter.started("infer", starts);
            meter.snapshot().restarts[0].1
        };
        assert_eq!([0, 1, 3].map(told), [0, 0, 2]);
        meter.begins_anew();
        assert_eq!([0, 1, 2].map(told), [2, 3, 4]);
        assert_eq!([meter.starts("infer"), meter.starts("fit")], [5, 0]);
    }

    #[test]
    fn the_highest_id_is_that_of_all_who_were_ever_there() {
        let meter = Meter::new("hall", "camera", &[]);
        let mut seen = frame(7, 2);
        (seen.bodies[0].id, seen.bodies[1].id) = (4, 9);
        meter.published(&seen);
        // Extrapolated before the next picture.
        seen.bodies[1].id = 10;
        meter.published(&seen);
        meter.published(&frame(8, 0));
        meter.begins_anew();
        assert_eq!(meter.newest(), (8, 10));
    }

    #[test]
    fn a_picture_that_the_network_did_not_look_at_counts_for_the_fit_alone() {
        let meter = Meter::new("hall", "camera", &[]);
        let mut seen = frame(0, 1);
        seen.stage_times.stage1_us = 9_000;
        meter.published(&seen);
        for sequence in 1..10 {
            meter.published(&frame(sequence, 0));
        }
        let snapshot = meter.snapshot();
        assert_eq!(snapshot.stages.map(|s| s.count()), [1, 1, 1, 1, 10]);
        assert_eq!((snapshot.frames, snapshot.latency.count()), (10, 10));
        assert!((snapshot.stages[1].sum() - 0.009).abs() < 1e-12);
    }

    #[test]
    fn a_camera_is_silent_by_the_rate_that_was_asked_for() {
        let seconds = Duration::from_secs_f64;
        for (interval, healthy_for) in [(0.0, 3.0), (0.1, 3.0), (10.0, 25.0)] {
            let meter = Meter::new("hall", "camera", &[]).with_interval(seconds(interval));
            let start = Instant::now();
            meter.published_at(start, &frame(0, 0));
            let healthy = |after: f64| meter.seen_at(start + seconds(after)).healthy;
            assert!(healthy(healthy_for - 0.1), "{interval}");
            assert!(!healthy(healthy_for + 0.1), "{interval}");
        }
    }

    #[test]
    fn a_slow_camera_is_well_between_its_frames_and_has_a_rate() {
        let meter = Meter::new("hall", "camera", &[]);
        let start = Instant::now();
        let at = |seconds: u64| start + Duration::from_secs(seconds);
        for sequence in 0..5 {
            meter.published_at(at(4 * sequence), &frame(sequence, 0));
        }
        let told = |seconds: u64| {
            let seen = meter.seen_at(at(seconds));
            (seen.healthy, seen.fps)
        };
        assert_eq!(told(16), (true, 0.25));
        assert_eq!((told(25), told(27)), ((true, 0.25), (false, 0.0)));
        // It was away: the time until then is none of its gaps.
        for sequence in 5..7 {
            meter.published_at(at(3_600 + 4 * sequence), &frame(sequence, 0));
        }
        assert_eq!(told(3_624), (true, 0.25));
    }

    #[test]
    fn a_camera_that_stalls_once_at_its_start_is_no_slow_one() {
        let meter = Meter::new("hall", "camera", &[]);
        let start = Instant::now();
        let at = |seconds: f64| start + Duration::from_secs_f64(seconds);
        meter.published_at(at(0.0), &frame(0, 0));
        meter.published_at(at(100.0), &frame(1, 0));
        assert!(meter.seen_at(at(102.9)).healthy);
        assert!(!meter.seen_at(at(103.1)).healthy);
        for k in 1..=10_u32 {
            let now = at(100.0 + f64::from(k) / 30.0);
            meter.published_at(now, &frame(1 + u64::from(k), 0));
        }
        let fps = meter.seen_at(at(100.0 + 10.0 / 30.0)).fps;
        assert!((fps - 30.0).abs() < 0.1, "{fps}");
    }

    #[test]
    fn nobody_looks_after_a_camera_that_has_ended() {
        let meter = Meter::new("hall", "camera", &[]);
        meter.looked();
        let told = || {
            let snapshot = meter.snapshot();
            (snapshot.looked_seconds_ago.is_some(), snapshot.ended)
        };
        assert_eq!(told(), (true, false));
        meter.ended();
        assert_eq!(told(), (false, true));
    }

    #[test]
    fn the_rate_is_that_of_the_pictures_since_the_last_gap() {
        let meter = Meter::new("hall", "camera", &[]);
        let (start, interval) = (Instant::now(), Duration::from_secs_f64(1.0 / 30.0));
        let gap = Duration::from_secs(3600);
        let mut now = start;
        for sequence in 0..138 {
            now += if sequence == 128 { gap } else { interval };
            meter.published_at(now, &frame(sequence, 0));
        }
        let fps = meter.seen_at(now).fps;
        assert!((fps - 30.0).abs() < 0.1, "{fps}");
    }

    #[test]
    fn times_follow_a_clock_that_is_set() {
        let meter = Meter::new("hall", "camera", &[]);
        let started = meter.started;
        meter.counts().last_error = Some((started, "broke".to_owned()));
        let told = |after: u64, wall: f64| {
            let wall = SystemTime::UNIX_EPOCH + Duration::from_secs_f64(wall);
            // The instant stands still, as over a machine's sleep.
            let boot = started + Duration::from_secs(after);
            let snapshot = meter.snapshot_at(Instant::now(), boot, wall);
            (snapshot.since, snapshot.last_error_at)
        };
        let (at_boot, set) = (1_000.0, 1_700_000_000.0);
        assert_eq!(told(10, at_boot), (990, Some(990)));
        assert_eq!(told(20, set), (1_699_999_980, Some(1_699_999_980)));
        // A start that flickers would pass for a new run.
        assert_eq!(told(30, set + 9.4).0, 1_699_999_980);
        assert_eq!(told(40, set + 21.2).0, 1_699_999_980);
    }

    #[test]
    fn pictures_count_once_and_gaps_are_dropped_pictures() {
        let meter = Meter::new("hall", "camera", &["infer", "fit"]);
        assert!(!meter.snapshot().healthy);
        for (sequence, people) in [(4, 1), (4, 1), (5, 2), (9, 3), (0, 1), (1, 1)] {
            meter.published(&frame(sequence, people));
        }
        meter.started("fit", 2);
        for is_there in [false, false, true, true] {
            meter.camera(is_there);
        }
        let snapshot = meter.snapshot();
        assert_eq!((snapshot.frames, snapshot.dropped), (5, 3));
        assert_eq!(snapshot.people, 1);
        assert!(snapshot.healthy);
        assert_eq!(snapshot.latency_ms.map(f64::round), Some(40.0));
        assert_eq!(snapshot.restarts, [("infer".into(), 0), ("fit".into(), 1)]);
        assert_eq!(snapshot.reconnects, 1);
        assert_eq!(snapshot.stages[4].count(), 5);
        assert_eq!(snapshot.latency.count(), 5);
        assert!((snapshot.stages[4].sum() - 5.0 * 0.0007).abs() < 1e-12);
    }
}
