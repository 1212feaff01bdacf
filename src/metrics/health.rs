//! How one source is doing, as the process that goes through its pictures sees it: what became of each step goes in,
//! with its time, and messages of its health come out. No clock of its own.

use std::time::Duration;

use edgecap_client::message::{
    BodyFrame, FLAG_FILE_TIME, HealthFrame, HealthPace, HealthState, ObservationFrame,
};

use super::recent::{Came, Recent};

/// How often it is told where nothing changes, nanoseconds.
const EVERY_NS: u64 = 1_000_000_000;
/// Without a picture that was asked for for so long it stalls, nanoseconds, …
const STALLED_NS: u64 = 1_000_000_000;
/// … or for so many times the interval at which pictures come, where that is longer.
const STALLED_INTERVALS: f64 = 2.5;
/// A longer interval, nanoseconds, is no rate at which pictures come.
const SLOWEST_NS: u64 = 60_000_000_000;
/// What is measured for less time, nanoseconds, says nothing of the pace.
const MEASURED_NS: u64 = 1_000_000_000;
/// Share of the pictures that are wanted which keeps up.
const ENOUGH: f64 = 0.9;

/// What is known of a source from the start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct About {
    /// No more than one picture an interval is wanted; zero: as many as come.
    pub interval: Duration,
    /// Whether its pictures' times are a file's, as far as is known before the first.
    pub is_file: bool,
    /// Whether its pictures are numbered and timed by one camera, or one film: neither photos nor a room's are.
    pub is_sequence: bool,
    /// Whether it is played from a record: its pace was that of another time, and says nothing of this machine.
    pub is_replayed: bool,
    /// How often this process was started again.
    pub restarts: u32,
    /// How many cameras there are; 1 but of a room.
    pub cameras: u32,
}

impl Default for About {
    fn default() -> Self {
        Self {
            interval: Duration::ZERO,
            is_file: false,
            is_sequence: true,
            is_replayed: false,
            restarts: 0,
            cameras: 1,
        }
    }
}

/// A picture that was gone through, or an instant of a room.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Seen {
    /// Its number.
    pub sequence: u64,
    /// When it was taken, nanoseconds.
    pub capture_ns: u64,
    /// When it was published who is in it, nanoseconds.
    pub publish_ns: u64,
    /// `FLAG_*` bits.
    pub flags: u32,
    /// How many are in it.
    pub people: u32,
    /// Whether the network looked at it.
    pub is_looked_at: bool,
}

impl From<&ObservationFrame> for Seen {
    fn from(frame: &ObservationFrame) -> Self {
        Self {
            sequence: frame.sequence,
            capture_ns: frame.capture_ns,
            publish_ns: frame.publish_ns,
            flags: frame.flags,
            people: frame.count,
            is_looked_at: frame.stage_times.stage1_us > 0,
        }
    }
}

impl From<&BodyFrame> for Seen {
    fn from(frame: &BodyFrame) -> Self {
        Self {
            sequence: frame.sequence,
            capture_ns: frame.capture_ns,
            publish_ns: frame.publish_ns,
            flags: frame.flags,
            people: frame.count,
            is_looked_at: frame.stage_times.stage1_us > 0,
        }
    }
}

/// What has become of a source so far. All times are nanoseconds of the monotonic clock.
#[derive(Debug)]
pub struct Health {
    about: About,
    /// What is told but for what is worked out then.
    frame: HealthFrame,
    recent: Recent,
    /// Since when a picture is waited for.
    asked: u64,
    /// How long the last picture was waited for, and the one before.
    waited: [Option<u64>; 2],
    /// When it was told last, unless it has changed since.
    told: Option<u64>,
}

impl Health {
    /// Of a source that is opened at `now`.
    pub fn new(about: About, now: u64) -> Self {
        let flags = if about.is_file { FLAG_FILE_TIME } else { 0 };
        Self {
            frame: HealthFrame {
                flags,
                started_ns: now,
                since_ns: now,
                cameras: about.cameras,
                restarts: about.restarts,
                ..HealthFrame::default()
            },
            about,
            recent: Recent::default(),
            asked: now,
            waited: [None; 2],
            told: None,
        }
    }

    /// A picture was gone through; `is_idle` where nobody is in view, nor was lately.
    pub fn observed(&mut self, now: u64, seen: &Seen, is_idle: bool) {
        let is_first = self.frame.observed == 0;
        // Between two instants bodies may be extrapolated.
        if !is_first && seen.sequence == self.frame.sequence && !self.about.is_sequence {
            return;
        }
        let next = self.frame.sequence.saturating_add(1);
        let skipped = seen.sequence.checked_sub(next);
        let flags = seen.flags & FLAG_FILE_TIME;
        // A film's own numbers have gaps where it repeats pictures or some are damaged.
        if self.about.is_sequence && !is_first && flags == 0 {
            self.frame.left_out += skipped.unwrap_or(0);
        }
        match self.frame.state {
            _ if is_first => {}
            HealthState::AWAY => self.frame.reconnects += 1,
            _ => {
                let waited = now.saturating_sub(self.asked).min(SLOWEST_NS);
                self.waited = [Some(waited), self.waited[0]];
            }
        }
        let state = match is_idle {
            true => HealthState::IDLE,
            false => HealthState::LIVE,
        };
        self.becomes(state, now);
        if skipped.is_none() {
            // A film begins anew, or a process that counts.
            self.recent.forget();
        }
        let age = || seen.publish_ns.saturating_sub(seen.capture_ns) as f64 * 1e-9;
        self.recent.take(Came {
            at: Duration::from_nanos(now),
            age: (flags == 0).then(age),
            sequence: seen.sequence,
            capture_ns: seen.capture_ns,
            is_looked_at: seen.is_looked_at,
        });
        let frame = &mut self.frame;
        (frame.sequence, frame.capture_ns) = (seen.sequence, seen.capture_ns);
        (frame.flags, frame.people) = (flags, seen.people);
        frame.observed += 1;
        self.asked = now;
    }

    /// What the network's input for a whole picture is, pixels across and down.
    pub fn looks_at(&mut self, (width, height): (usize, usize)) {
        let pixels = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        (self.frame.input_width, self.frame.input_height) = (pixels(width), pixels(height));
    }

    /// So many of a room's cameras send.
    pub fn come(&mut self, cameras: usize) {
        let cameras = cameras as u32;
        if self.frame.cameras_live != cameras {
            self.frame.cameras_live = cameras;
            self.told = None;
        }
    }

    /// No picture is wanted yet.
    pub fn not_due(&mut self, now: u64) {
        self.asked = now;
    }

    /// A picture is wanted, and none has come that is of use.
    pub fn waits(&mut self, now: u64) {
        let comes = matches!(self.frame.state, HealthState::LIVE | HealthState::IDLE);
        if comes && now.saturating_sub(self.asked) > self.patience() {
            self.becomes(HealthState::STALLED, now);
        }
    }

    /// The source is not there, or what it sends is of no use.
    pub fn is_away(&mut self, now: u64) {
        self.becomes(HealthState::AWAY, now);
    }

    /// What to tell now, if it is time for that: something has changed, or it was told a second ago.
    pub fn tell(&mut self, now: u64) -> Option<HealthFrame> {
        let is_due = |told: u64| now.saturating_sub(told) >= EVERY_NS;
        if !self.told.is_none_or(is_due) {
            return None;
        }
        self.told = Some(now);
        Some(self.as_of(now))
    }

    /// What there is to tell at `now`.
    pub fn as_of(&self, now: u64) -> HealthFrame {
        let mut frame = HealthFrame {
            publish_ns: now,
            ..self.frame
        };
        if !matches!(frame.state, HealthState::LIVE | HealthState::IDLE) {
            frame.people = 0;
            return frame;
        }
        if self.about.is_sequence {
            frame.source_hz = self.recent.source_hz() as f32;
            frame.look_hz = self.recent.look_hz() as f32;
        }
        frame.observed_hz = self.recent.hz() as f32;
        let age = self.recent.age(0.5).unwrap_or(0.0);
        frame.latency_us = (1e6 * age) as u32;
        frame.pace = self.pace(now);
        frame
    }

    fn pace(&self, now: u64) -> HealthPace {
        let (source, interval) = (self.recent.source_hz(), self.about.interval.as_secs_f64());
        let is_file = self.frame.flags & FLAG_FILE_TIME != 0;
        let waits = is_file || self.about.is_replayed;
        let is_told = self.frame.state == HealthState::LIVE && self.about.is_sequence && !waits;
        let lasts = now.saturating_sub(self.frame.since_ns);
        if !is_told || lasts < MEASURED_NS || source <= 0.0 {
            return HealthPace::UNKNOWN;
        }
        // Of no limit the inverse is endless.
        match self.recent.hz() >= ENOUGH * source.min(interval.recip()) {
            true => HealthPace::KEEPS_UP,
            false => HealthPace::BEHIND,
        }
    }

    /// How long no picture may come that is waited for, nanoseconds. One long wait, for a camera that has stalled,
    /// makes no slow one.
    fn patience(&self) -> u64 {
        match self.waited {
            [Some(last), Some(before)] => {
                let slow = STALLED_INTERVALS * last.min(before) as f64;
                STALLED_NS.max(slow as u64)
            }
            _ => STALLED_NS,
        }
    }

    fn becomes(&mut self, state: HealthState, now: u64) {
        if self.frame.state == state {
            return;
        }
        (self.frame.state, self.frame.since_ns) = (state, now);
        self.told = None;
        // What was before says nothing of how many pictures come now.
        self.recent.forget();
        if self.about.cameras == 1 {
            let comes = matches!(state, HealthState::LIVE | HealthState::IDLE);
            self.frame.cameras_live = u32::from(comes);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: u64 = 1_000_000_000;

    /// A camera, of whose pictures every so many are looked at.
    struct Camera {
        health: Health,
        fps: u64,
        every: u64,
        now: u64,
        next: u64,
    }

    impl Camera {
        fn new(fps: u64, every: u64, interval: Duration) -> Self {
            let about = About {
                interval,
                ..About::default()
            };
            Self {
                health: Health::new(about, 0),
                fps,
                every,
                now: 0,
                next: 0,
            }
        }

        /// Plays for so many seconds, each picture 40 ms old when it is published, and tells at the end.
        fn play(&mut self, seconds: u64, is_idle: bool) -> HealthFrame {
            for _ in 0..seconds * self.fps / self.every {
                self.now += SECOND * self.every / self.fps;
                let seen = Seen {
                    sequence: self.next,
                    capture_ns: self.now.saturating_sub(40_000_000),
                    publish_ns: self.now,
                    people: u32::from(!is_idle),
                    is_looked_at: self.next.is_multiple_of(2 * self.every),
                    ..Seen::default()
                };
                self.next += self.every;
                self.health.observed(self.now, &seen, is_idle);
            }
            self.health.as_of(self.now)
        }

        /// Passes time in which no picture comes; when it was told, milliseconds from then on, and what.
        fn waits(&mut self, seconds: u64, step: fn(&mut Health, u64)) -> Vec<(u64, HealthState)> {
            let begin = self.now;
            let mut told = Vec::new();
            while self.now < begin + seconds * SECOND {
                self.now += SECOND / 4;
                step(&mut self.health, self.now);
                let tells = self.health.tell(self.now);
                told.extend(tells.map(|t| ((self.now - begin) / 1_000_000, t.state)));
            }
            told
        }
    }

    #[test]
    fn a_camera_that_is_looked_at_tells_rates_and_latency() {
        let mut camera = Camera::new(30, 1, Duration::ZERO);
        let told = camera.health.tell(0).unwrap();
        assert_eq!((told.state, told.cameras_live), (HealthState::STARTING, 0));
        camera.health.looks_at((512, 320));
        let told = camera.play(10, false);
        assert_eq!(told.state, HealthState::LIVE);
        assert_eq!(
            (told.pace, told.people, told.cameras_live),
            (HealthPace::KEEPS_UP, 1, 1)
        );
        assert_eq!((told.observed, told.left_out, told.sequence), (300, 0, 299));
        assert_eq!((told.input_width, told.input_height), (512, 320));
        for (found, expected) in [
            (told.source_hz, 30.0),
            (told.observed_hz, 30.0),
            (told.look_hz, 15.0),
        ] {
            assert!((found - expected).abs() < 0.2, "{told:?}");
        }
        assert!((39_000..=41_000).contains(&told.latency_us), "{told:?}");
        assert!((told.state_seconds() - 10.0).abs() < 0.1);
    }

    #[test]
    fn who_drops_pictures_is_behind_unless_fewer_are_wanted() {
        for (every, interval, pace) in [
            (1, 0.0, HealthPace::KEEPS_UP),
            (2, 0.0, HealthPace::BEHIND),
            (3, 0.1, HealthPace::KEEPS_UP),
            (6, 0.1, HealthPace::BEHIND),
        ] {
            let mut camera = Camera::new(30, every, Duration::from_secs_f64(interval));
            let told = camera.play(4, false);
            assert_eq!(told.pace, pace, "{every} {interval}");
            assert_eq!(told.left_out, (every - 1) * (told.observed - 1));
            // Of an empty place few pictures are wanted.
            assert_eq!(camera.play(4, true).pace, HealthPace::UNKNOWN);
        }
        let mut camera = Camera::new(30, 2, Duration::ZERO);
        assert_eq!(camera.play(1, false).pace, HealthPace::UNKNOWN, "too early");
    }

    #[test]
    fn a_record_tells_the_latency_of_then_and_no_pace() {
        let mut camera = Camera::new(30, 2, Duration::ZERO);
        camera.health.about.is_replayed = true;
        let told = camera.play(4, false);
        assert_eq!(
            (told.state, told.pace),
            (HealthState::LIVE, HealthPace::UNKNOWN)
        );
        assert!((39_000..=41_000).contains(&told.latency_us), "{told:?}");
        assert_eq!(told.left_out, told.observed - 1);
    }

    #[test]
    fn somebody_who_enters_makes_no_slow_machine() {
        let mut camera = Camera::new(30, 10, Duration::ZERO);
        let told = camera.play(60, true);
        assert_eq!(told.state, HealthState::IDLE);
        assert!((told.observed_hz - 3.0).abs() < 0.1);
        camera.every = 1;
        for _ in 0..5 {
            assert_ne!(camera.play(1, false).pace, HealthPace::BEHIND);
        }
        assert_eq!(camera.play(1, false).pace, HealthPace::KEEPS_UP);
    }

    #[test]
    fn a_camera_that_is_unplugged_stalls_is_away_and_comes_back() {
        let mut camera = Camera::new(30, 1, Duration::ZERO);
        camera.play(5, false);
        camera.health.tell(camera.now);
        let told = camera.waits(3, Health::waits);
        let stalled = HealthState::STALLED;
        assert_eq!(
            told,
            [(1000, HealthState::LIVE), (1250, stalled), (2250, stalled)]
        );
        let since = camera.now + SECOND / 4;
        let told = camera.waits(3, Health::is_away);
        let away = HealthState::AWAY;
        assert_eq!(
            told,
            [(250, away), (1250, away), (2250, away)],
            "once a second"
        );
        // Opened again it has no picture yet.
        let told = camera.waits(2, Health::waits);
        assert!(told.iter().all(|(_, state)| *state == away), "{told:?}");
        let frame = camera.health.as_of(camera.now);
        assert_eq!((frame.since_ns, frame.cameras_live), (since, 0));
        assert_eq!(
            (frame.people, frame.observed_hz, frame.latency_us),
            (0, 0.0, 0)
        );
        let frame = camera.play(3, false);
        assert_eq!((frame.reconnects, frame.state), (1, HealthState::LIVE));
        assert_eq!(frame.observed, 8 * 30);
        // At the start nobody has seen it yet.
        let mut late = Camera::new(30, 1, Duration::ZERO);
        late.waits(3, Health::is_away);
        assert_eq!(late.play(1, false).reconnects, 0);
    }

    #[test]
    fn a_picture_that_is_not_wanted_yet_is_not_missed() {
        let mut camera = Camera::new(30, 30, Duration::from_secs(1));
        camera.play(10, false);
        let told = camera.waits(20, Health::not_due);
        assert!(told.iter().all(|(_, state)| *state == HealthState::LIVE));
        assert_eq!(
            camera.waits(3, Health::waits).last().unwrap().1,
            HealthState::STALLED
        );
    }

    #[test]
    fn a_slow_camera_does_not_stall_between_its_pictures() {
        let mut camera = Camera::new(1, 2, Duration::ZERO);
        camera.play(20, false);
        let told = camera.waits(6, Health::waits);
        let stalled =
            |(ms, state): &(u64, HealthState)| (*state == HealthState::STALLED).then_some(*ms);
        assert_eq!(told.iter().find_map(stalled), Some(5250));
    }

    #[test]
    fn a_slow_camera_stalls_no_more_once_two_intervals_tell_how_slow_it_is() {
        let mut health = Health::new(About::default(), 0);
        let mut stalled = Vec::new();
        for quarter in 1..=80_u64 {
            let now = quarter * SECOND / 4;
            let sequence = quarter / 8;
            if quarter.is_multiple_of(8) {
                let seen = Seen {
                    sequence,
                    capture_ns: now,
                    publish_ns: now,
                    ..Seen::default()
                };
                health.observed(now, &seen, false);
            } else {
                health.waits(now);
            }
            if health.as_of(now).state == HealthState::STALLED {
                stalled.push(sequence);
            }
        }
        stalled.dedup();
        assert_eq!(stalled, [1, 2]);
        let told = health.as_of(20 * SECOND);
        assert_eq!((told.state, told.observed), (HealthState::LIVE, 10));
        assert!((told.source_hz - 0.5).abs() < 0.01, "{told:?}");
    }

    #[test]
    fn a_film_has_no_latency_and_is_never_behind() {
        let about = About {
            is_file: true,
            ..About::default()
        };
        let mut health = Health::new(about, 0);
        for k in 0..100 {
            let seen = Seen {
                sequence: k,
                capture_ns: k * SECOND / 25,
                publish_ns: k * SECOND,
                flags: FLAG_FILE_TIME,
                people: 2,
                is_looked_at: true,
            };
            health.observed(k * SECOND, &seen, false);
        }
        let told = health.tell(99 * SECOND).unwrap();
        assert_eq!((told.latency_us, told.pace), (0, HealthPace::UNKNOWN));
        assert!((told.source_hz - 25.0).abs() < 0.1 && (told.observed_hz - 1.0).abs() < 0.1);
        assert_eq!(
            (told.flags, told.people, told.sequence),
            (FLAG_FILE_TIME, 2, 99)
        );
        // Over and over: the numbers of the second time say nothing of the first.
        let mut again = Health::new(about, 0);
        for (now, sequence) in [(1, 10), (2, 11), (3, 0), (4, 1)] {
            let seen = Seen {
                sequence,
                capture_ns: sequence * SECOND,
                ..Seen::default()
            };
            again.observed(now * SECOND, &seen, false);
        }
        let told = again.tell(4 * SECOND).unwrap();
        assert_eq!((told.left_out, told.source_hz), (0, 1.0));
        // Its numbers have gaps, and yet no picture of it is left out.
        let mut gaps = Health::new(about, 0);
        for sequence in [0, 1, 5] {
            let seen = Seen {
                sequence,
                flags: FLAG_FILE_TIME,
                ..Seen::default()
            };
            gaps.observed(SECOND, &seen, false);
        }
        assert_eq!(gaps.as_of(SECOND).left_out, 0);
    }

    #[test]
    fn a_room_tells_of_its_cameras_and_of_instants() {
        let about = About {
            is_sequence: false,
            cameras: 3,
            ..About::default()
        };
        let mut health = Health::new(about, 0);
        health.come(2);
        for k in 0..60 {
            let seen = Seen {
                sequence: k / 2 * 5,
                capture_ns: k * SECOND / 30,
                publish_ns: k * SECOND / 30 + 50_000_000,
                ..Seen::default()
            };
            health.observed(k * SECOND / 30, &seen, false);
        }
        let told = health.tell(2 * SECOND).unwrap();
        assert_eq!((told.cameras, told.cameras_live, told.observed), (3, 2, 30));
        assert_eq!(
            (told.left_out, told.source_hz, told.pace),
            (0, 0.0, HealthPace::UNKNOWN)
        );
        assert!(
            (told.observed_hz - 15.0).abs() < 0.1,
            "extrapolated ones do not count"
        );
        assert_eq!(health.tell(2 * SECOND), None);
        health.come(3);
        assert_eq!(health.tell(2 * SECOND).unwrap().cameras_live, 3);
        health.waits(4 * SECOND);
        let told = health.tell(4 * SECOND).unwrap();
        assert_eq!((told.state, told.cameras_live), (HealthState::STALLED, 3));
    }
}
