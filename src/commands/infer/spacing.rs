//! How far apart looks are where a camera takes more pictures than the network has time for: people are followed into
//! those between. Times go in, an interval comes out.

use super::mean::Mean;
use super::wish::{FAST_NS, SLOW_NS, Wish};
use crate::capture::Frame;

/// Looks per second that are enough; fewer lose quick movements.
pub const ENOUGH: f32 = 15.0;
/// Looks that take longer than this are too far apart for people to be followed from one to the next, seconds; those
/// that take no more than [`ROOM`] of it are near enough to begin with.
const LONGEST: f32 = 0.125;
/// Part of the time from picture to picture that a look may then take.
const ROOM: f32 = 0.8;
/// Cameras that take hardly more pictures than are enough, as share of those, have none between looks.
const MORE: f32 = 1.1;
/// Part of the time from look to look that the pictures between may need.
const BETWEEN: f32 = 0.2;
/// Pictures farther apart than this say nothing of the camera's rate, nanoseconds.
const PAUSE_NS: u64 = 1_000_000_000;

/// What looks take, and how fast the pictures come.
#[derive(Debug, Clone)]
pub struct Spacing {
    /// Pictures that come faster are not wanted, seconds.
    shortest: f32,
    /// From one picture that the camera took to the next, seconds.
    period: Mean,
    /// A look, seconds.
    look: Mean,
    /// Time and number of the last picture.
    last: Option<(u64, u64)>,
    /// Whether people are followed into the pictures between looks.
    follows: bool,
    wish: Wish<bool>,
}

impl Spacing {
    /// For pictures that are wanted no more often than every `interval` nanoseconds.
    pub fn new(interval: u64) -> Self {
        Self {
            shortest: interval as f32 * 1e-9,
            period: Mean::default(),
            look: Mean::default(),
            last: None,
            follows: false,
            wish: Wish::default(),
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

    /// Takes in that a look at the picture taken at `now` nanoseconds took so many seconds. Whether people are followed
    /// from now on, or no longer are, where that has changed.
    pub fn looked(&mut self, now: u64, seconds: f32) -> Option<bool> {
        self.look.take(seconds);
        let (look, period) = (self.look.value, self.period());
        // What holds stays until there is more to say against it.
        let (room, longest) = match self.follows {
            true => (ROOM, LONGEST),
            false => (1.0, ROOM * LONGEST),
        };
        let is_fast = self.period.count > 0 && period * MORE * ENOUGH < 1.0;
        let wanted = is_fast && (room * period..longest).contains(&look);
        if wanted == self.follows {
            self.wish.forget();
            return None;
        }
        let patience = if wanted { SLOW_NS } else { FAST_NS };
        let lasts = self.wish.lasts(now, wanted, patience);
        lasts.then(|| {
            self.follows = wanted;
            wanted
        })
    }

    /// Nanoseconds from look to look; `None` where every picture is looked at.
    pub fn apart(&self) -> Option<u64> {
        let every_other = (2.0 * self.period()).min(ENOUGH.recip());
        let seconds = every_other.max(self.look.value / (1.0 - BETWEEN));
        self.follows.then_some((seconds * 1e9) as u64)
    }

    /// A line for the log.
    pub fn line(&self) -> String {
        let [look, period] = [self.look.value, self.period()].map(|s| 1e3 * s);
        match self.apart() {
            Some(apart) => format!(
                "a look takes {look:.0} ms, and pictures come every {period:.0} ms: {:.0} a second are looked at, and \
                 people are followed into the others",
                1e9 / apart as f32
            ),
            None => format!(
                "a look takes {look:.0} ms, and pictures come every {period:.0} ms: people are no longer followed \
                 between looks"
            ),
        }
    }

    /// From one picture that is wanted to the next, seconds.
    fn period(&self) -> f32 {
        self.period.value.max(self.shortest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
            let spacing = Spacing::new(interval);
            Self {
                spacing,
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
