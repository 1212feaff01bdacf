//! How far apart looks are where a camera takes more pictures than the network has time for: people are followed into
//! those between. Times go in, an interval comes out.

use super::mean::{Mean, bounded};
use super::wish::{FAST_NS, SLOW_NS, Wish};
use crate::capture::Frame;

/// Looks per second that are enough; fewer lose quick movements.
pub const ENOUGH: f32 = 15.0;
/// Looks at a camera that take longer than this are too far apart for people to be followed from one to the next,
/// seconds.
const LONGEST: f32 = 0.125;
/// Those that take less than this are near enough to begin with, seconds.
pub const NEAR: f32 = ROOM * LONGEST;
/// Part of the time from picture to picture that a look may take where that is to be enough again.
const ROOM: f32 = 0.8;
/// What a look counts as at most where looks have not taken long before, seconds.
const STALL: f32 = 2.0 * LONGEST;
/// Cameras that take hardly more pictures than are enough, as share of those, have none between looks.
const MORE: f32 = 1.1;
/// Part of the time from look to look that the pictures between may need.
const BETWEEN: f32 = 0.2;
/// Pictures farther apart than this say nothing of the camera's rate, nanoseconds.
const PAUSE_NS: u64 = 1_000_000_000;
/// What begins again so soon after its end may make looks short itself, as where cameras share the cores: it is to end
/// later, nanoseconds.
const AGAIN_NS: u64 = 60_000_000_000;
/// How long there must have been time for every picture at most before following ends, nanoseconds.
const MOST_PATIENT_NS: u64 = 32 * FAST_NS;
/// Where nothing has changed for so long, what was before that tells no more, nanoseconds. Longer than
/// [`MOST_PATIENT_NS`].
const QUIET_NS: u64 = 600_000_000_000;

/// What looks take, and how fast the pictures come.
#[derive(Debug, Clone)]
pub struct Spacing {
    /// Pictures that come faster are not wanted, seconds.
    shortest: f32,
    /// From one look to the next, as the user asks for it, nanoseconds.
    asked: Option<u64>,
    /// From one picture that the camera took to the next, seconds.
    period: Mean,
    /// A look, seconds.
    look: Mean,
    /// Time and number of the last picture.
    last: Option<(u64, u64)>,
    /// Whether looks are so far apart that there is time for pictures between, into which people are followed.
    leaves_time: bool,
    wish: Wish<bool>,
    /// When that changed last, nanoseconds.
    changed: Option<u64>,
    /// Whether following ended then because there was time without it, and not because looks had become too long.
    was_needless: bool,
    /// How long there must have been time without that before it ends, nanoseconds.
    patience: u64,
}

impl Spacing {
    /// For pictures that are wanted no more often than every `interval` nanoseconds, and looks that the user asks for
    /// every `asked` nanoseconds.
    pub fn new(interval: u64, asked: Option<u64>) -> Self {
        Self {
            shortest: interval as f32 * 1e-9,
            asked,
            period: Mean::default(),
            look: Mean::default(),
            last: None,
            leaves_time: false,
            wish: Wish::default(),
            changed: None,
            was_needless: false,
            patience: FAST_NS,
        }
    }

    /// Takes in that the camera took this picture.
    pub fn came(&mut self, frame: &Frame) {
        let now = (frame.time_ns, frame.sequence);
        let Some(last) = self.last.replace(now) else {
            return;
        };
        let time = now.0.saturating_sub(last.0);
        let count = now.1.saturating_sub(last.1);
        if time >= PAUSE_NS {
            self.wish.forget();
        } else if time > 0 && count > 0 {
            self.period.take(time as f32 * 1e-9 / count as f32);
        }
    }

    /// Takes in that a look at the picture taken at `now` nanoseconds took so many seconds. Whether there is time for
    /// pictures between looks from now on, or no longer is, where that has changed.
    pub fn looked(&mut self, now: u64, seconds: f32) -> Option<bool> {
        let seconds = bounded(seconds, self.look.value, STALL);
        self.look.take(seconds);
        let (look, period) = (self.look.value, self.period());
        let since = self.changed.map(|then| now.saturating_sub(then));
        if since.is_some_and(|since| since >= QUIET_NS) {
            self.patience = FAST_NS;
        }
        // What holds stays until there is more to say against it.
        let (room, longest) = match self.leaves_time {
            true => (ROOM, LONGEST),
            false => (1.0, NEAR),
        };
        // Looks as often as these are enough, and looks shorter than those leave time by themselves.
        let (enough, short) = match self.asked {
            Some(asked) => (asked as f32 * 1e-9, asked as f32 * 1e-9 * (1.0 - BETWEEN)),
            None => (ENOUGH.recip(), period),
        };
        let is_fast = self.period.count > 0 && period * MORE < enough;
        let wanted = is_fast && (room * short..longest).contains(&look);
        if wanted == self.leaves_time {
            self.wish.forget();
            return None;
        }
        let is_slow = wanted || look >= longest;
        let patience = if is_slow { SLOW_NS } else { self.patience };
        if !self.wish.lasts(now, wanted, patience) {
            return None;
        }
        if wanted && self.was_needless && since.is_some_and(|since| since < AGAIN_NS) {
            self.patience = (2 * self.patience).min(MOST_PATIENT_NS);
        }
        self.was_needless = !wanted && look < longest;
        self.leaves_time = wanted;
        self.changed = Some(now);
        Some(wanted)
    }

    /// Nanoseconds from look to look; `None` where every picture is looked at.
    pub fn apart(&self) -> Option<u64> {
        let usual = (2.0 * self.period()).min(ENOUGH.recip());
        let usual = self.asked.unwrap_or((usual * 1e9) as u64);
        match self.leaves_time {
            true => {
                let look = self.look.value.min(LONGEST) / (1.0 - BETWEEN);
                Some(usual.max((look * 1e9) as u64))
            }
            false => self.asked,
        }
    }

    /// A line for the log.
    pub fn line(&self) -> String {
        let [look, period] = [self.look.value, self.period()].map(|s| 1e3 * s);
        let looks = self.apart().map(|apart| 1e9 / apart as f32);
        let now = match looks {
            Some(looks) if self.leaves_time => {
                format!(
                    "{looks:.0} a second are looked at, and people are followed into the others"
                )
            }
            Some(looks) => {
                format!("up to {looks:.0} a second are looked at again, as was asked for")
            }
            None => "people are no longer followed between looks".to_owned(),
        };
        format!("a look takes {look:.0} ms, and pictures come every {period:.0} ms: {now}")
    }

    /// From one picture that is wanted to the next, seconds.
    fn period(&self) -> f32 {
        self.period.value.max(self.shortest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::schedule::due::Due;

    const SECOND: u64 = 1_000_000_000;

    /// A camera of `fps` pictures a second for a machine whose looks take `look` seconds.
    struct Camera {
        spacing: Spacing,
        fps: u64,
        /// When the machine has time again, and when the next look is due, nanoseconds.
        free: u64,
        due: u64,
        next: u64,
    }

    impl Camera {
        fn new(fps: u64, interval: u64) -> Self {
            Self {
                spacing: Spacing::new(interval, None),
                fps,
                free: 0,
                due: 0,
                next: 0,
            }
        }

        /// Plays so many seconds: pictures that are taken in, and looks, a second; how often it changed.
        fn play(&mut self, seconds: u64, look: f32) -> (f32, f32, u32) {
            let (mut came, mut looks, mut changes) = (0, 0, 0);
            for _ in 0..seconds * self.fps {
                let sequence = self.next;
                self.next += 1;
                let time_ns = sequence * SECOND / self.fps;
                if time_ns < self.free {
                    continue;
                }
                came += 1;
                self.spacing.came(&Frame {
                    time_ns,
                    sequence,
                    ..Frame::default()
                });
                if self.spacing.apart().is_some() && time_ns < self.due {
                    continue;
                }
                looks += 1;
                changes += u32::from(self.spacing.looked(time_ns, look).is_some());
                self.free = time_ns + (look * 1e9) as u64;
                self.due = time_ns + self.spacing.apart().unwrap_or(0);
            }
            let each = |n: u32| n as f32 / seconds as f32;
            (each(came), each(looks), changes)
        }
    }

    #[test]
    fn people_are_followed_where_looks_take_longer_than_pictures() {
        for (fps, look, follows) in [
            (30, 0.025, false),
            (30, 0.032, false),
            (30, 0.04, true),
            (30, 0.06, true),
            (60, 0.01, false),
            (60, 0.02, true),
            // Nobody could be followed for so long.
            (30, 0.15, false),
            // With fifteen a second nothing is won.
            (15, 0.07, false),
            (10, 0.2, false),
        ] {
            let mut camera = Camera::new(fps, 0);
            camera.play(1, look);
            assert_eq!(camera.spacing.apart(), None, "{fps} {look}: at once");
            camera.play(4, look);
            assert_eq!(camera.spacing.apart().is_some(), follows, "{fps} {look}");
            assert_eq!(camera.play(60, look).2, 0, "{fps} {look}");
        }
    }

    #[test]
    fn there_are_as_many_looks_as_there_is_time_for_beside_the_pictures_between() {
        for (fps, look, looks) in [
            (30, 0.04, 15.0),
            (25, 0.045, 15.0),
            (60, 0.02, 30.0),
            (60, 0.045, 17.8),
            (30, 0.06, 13.3),
            (30, 0.09, 8.9),
        ] {
            let mut camera = Camera::new(fps, 0);
            camera.play(5, look);
            let apart = camera.spacing.apart().unwrap();
            let found = 1e9 / apart as f32;
            assert!((found - looks).abs() < 0.3, "{fps} {look}: {found}");
        }
    }

    #[test]
    fn pictures_that_are_not_wanted_do_not_count() {
        for (most, follows) in [(15, false), (20, true)] {
            let mut camera = Camera::new(30, SECOND / most);
            camera.play(5, 0.055);
            assert_eq!(camera.spacing.apart().is_some(), follows, "{most}");
        }
    }

    #[test]
    fn every_picture_is_looked_at_again_where_there_has_been_time_for_long_enough() {
        let mut camera = Camera::new(30, 0);
        assert_eq!(camera.play(5, 0.04).2, 1);
        assert!(camera.spacing.line().contains("40 ms"));
        // It would be ready in time, but barely.
        assert_eq!(camera.play(60, 0.03).2, 0);
        assert_eq!(camera.play(5, 0.02).2, 0, "at once");
        let (_, _, changes) = camera.play(10, 0.02);
        assert_eq!((changes, camera.spacing.apart()), (1, None));
        let (came, looks, _) = camera.play(60, 0.02);
        assert_eq!((came, looks), (30.0, 30.0));
    }

    #[test]
    fn looks_near_the_longest_do_not_swing() {
        let mut camera = Camera::new(30, 0);
        assert_eq!(camera.play(5, 0.095).2, 1);
        assert_eq!(camera.play(60, 0.11).2, 0);
        assert_eq!(camera.play(60, 0.15).2, 1);
        assert_eq!(camera.play(60, 0.11).2, 0);
        assert_eq!(camera.spacing.apart(), None);
    }

    /// Pictures, and of them those that people are followed into, a second, of a camera of `fps` whose looks take
    /// `look` seconds, after the first ten. Of what was taken meanwhile the newest picture is the next.
    fn taken_in(spacing: &mut Spacing, fps: u64, look: f32) -> (f32, f32) {
        const BETWEEN_NS: u64 = 4_000_000;
        let (mut free, mut next, mut pictures, mut followed) = (0, 0, 0, 0);
        let mut due = spacing.apart().map(Due::new);
        while free < 30 * SECOND {
            let sequence = next.max(free * fps / SECOND);
            let time_ns = sequence * SECOND / fps;
            next = sequence + 1;
            spacing.came(&Frame {
                time_ns,
                sequence,
                ..Frame::default()
            });
            let is_followed = due.is_some_and(|due| time_ns < due.at_ns());
            if !is_followed {
                spacing.looked(time_ns, look);
                let apart = spacing.apart();
                due = apart.map(|apart| due.map_or(Due::new(apart), |due| due.every(apart)));
                due.iter_mut().for_each(|due| due.done(time_ns));
            }
            let took = if is_followed {
                BETWEEN_NS
            } else {
                (look * 1e9) as u64
            };
            free = free.max(time_ns) + took;
            if time_ns >= 10 * SECOND {
                pictures += 1;
                followed += u32::from(is_followed);
            }
        }
        [pictures, followed].map(|n| n as f32 / 20.0).into()
    }

    #[test]
    fn looks_that_were_asked_for_leave_time_for_the_pictures_between() {
        let fifteen = SECOND / 15;
        let mut spacing = Spacing::new(0, Some(fifteen));
        assert_eq!(spacing.apart(), Some(fifteen));
        let (pictures, followed) = taken_in(&mut spacing, 30, 0.08);
        assert!(pictures >= 18.0 && followed >= 8.0, "{pictures} {followed}");
        assert!(spacing.line().contains("10 a second are looked at"));
        // There is time for as many as were asked for.
        let mut spacing = Spacing::new(0, Some(fifteen));
        let (pictures, followed) = taken_in(&mut spacing, 30, 0.04);
        assert_eq!(spacing.apart(), Some(fifteen));
        assert!(pictures > 29.0 && followed > 14.0, "{pictures} {followed}");
        for (asked, look) in [
            // Every picture is asked for.
            (SECOND / 1000, 0.08),
            (SECOND / 30, 0.08),
            // Nobody could be followed for so long.
            (fifteen, 0.15),
            // They are far enough apart as they are.
            (SECOND / 5, 0.08),
        ] {
            let mut spacing = Spacing::new(0, Some(asked));
            taken_in(&mut spacing, 30, look);
            assert_eq!(spacing.apart(), Some(asked), "{look}");
        }
    }

    #[test]
    fn looks_are_as_far_apart_as_was_asked_for_again_where_there_is_time() {
        let mut spacing = Spacing::new(0, Some(SECOND / 15));
        taken_in(&mut spacing, 30, 0.08);
        for k in 0..11 * 15 {
            spacing.looked(100 * SECOND + k * SECOND / 15, 0.02);
        }
        assert_eq!(spacing.apart(), Some(SECOND / 15));
        let line = spacing.line();
        assert!(
            line.contains("20 ms")
                && line.ends_with("up to 15 a second are looked at again, as was asked for")
        );
    }

    #[test]
    fn one_long_stall_keeps_nobody_from_being_seen() {
        let mut camera = Camera::new(30, 0);
        camera.play(10, 0.04);
        let stalled = camera.spacing.looked(10 * SECOND, 9.0);
        let apart = camera.spacing.apart().unwrap();
        assert!(stalled.is_none() && apart <= 160_000_000, "{apart} ns");
        // However long looks take for a while.
        let mut spacing = camera.spacing.clone();
        for k in 1..15 {
            spacing.looked(10 * SECOND + k * SECOND / 10, 9.0);
        }
        let apart = spacing.apart().unwrap();
        assert!(apart <= 160_000_000, "{apart} ns");
        assert_eq!(camera.play(10, 0.04).2, 0);
    }

    #[test]
    fn looks_that_become_too_long_end_following_soon() {
        let mut camera = Camera::new(30, 0);
        camera.play(10, 0.04);
        assert_eq!(camera.play(4, 0.3).2, 1);
        assert_eq!(camera.spacing.apart(), None);
    }

    #[test]
    fn following_that_makes_looks_short_itself_does_not_swing() {
        let mut camera = Camera::new(30, 0);
        let ten_minutes = |camera: &mut Camera| {
            let changes = (0..600).map(|_| {
                let is_short = camera.spacing.apart().is_some();
                camera.play(1, if is_short { 0.02 } else { 0.036 }).2
            });
            changes.sum::<u32>()
        };
        let at_first = ten_minutes(&mut camera);
        assert!((2..=12).contains(&at_first), "{at_first} changes");
        for _ in 0..3 {
            let changes = ten_minutes(&mut camera);
            assert!((1..=5).contains(&changes), "{changes} changes");
        }
        // What made looks long is gone: that ends, and what was is forgotten.
        camera.play(930, 0.02);
        assert_eq!(camera.spacing.apart(), None);
        assert_eq!(camera.play(5, 0.036).2, 1);
        assert_eq!(camera.play(12, 0.02).2, 1);
    }

    #[test]
    fn following_that_ended_because_looks_were_too_long_ends_no_later_the_next_time() {
        let mut camera = Camera::new(30, 0);
        for _ in 0..4 {
            assert_eq!(camera.play(6, 0.06).2, 1);
            assert_eq!(camera.play(6, 0.3).2, 1);
        }
        assert_eq!(camera.play(6, 0.06).2, 1);
        assert_eq!(camera.play(15, 0.02).2, 1);
        assert_eq!(camera.spacing.apart(), None);
    }

    #[test]
    fn a_moment_and_a_pause_change_nothing() {
        let mut camera = Camera::new(30, 0);
        camera.play(10, 0.02);
        assert_eq!(camera.play(1, 0.06).2, 0);
        camera.next += 300;
        assert_eq!(camera.play(1, 0.06).2, 0);
        assert_eq!(camera.spacing.apart(), None);
    }
}
