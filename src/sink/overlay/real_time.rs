//! Lets a film last as long as what it shows, though pictures were left out, or come at uneven times.

/// A longer pause of a camera is shortened to this, nanoseconds, or to twice its usual interval where that is longer: a
/// film of one that was unplugged is not one of its absence.
const LONGEST_AWAY: u64 = 1_000_000_000;
/// The same within a file, whose times may be wrong.
const LONGEST_STILL: u64 = 10_000_000_000;
/// Pictures that are further apart are those of a camera that was away, nanoseconds.
const SLOWEST: u64 = 60_000_000_000;

/// Where a film has to be when a picture comes.
#[derive(Debug, Clone, Default)]
pub struct RealTime {
    last: Option<u64>,
    /// Between the last two pictures, nanoseconds.
    interval: Option<u64>,
    /// Nanoseconds since the first picture, without what was left out of pauses.
    elapsed: u64,
}

/// When a picture was taken, nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Taken {
    /// By a running camera.
    Live(u64),
    /// In a file's time.
    File(u64),
}

impl RealTime {
    /// How often the picture before is to be shown once more, before one that was `taken` then; the film shows `rate`
    /// pictures a second and holds so many. `None`: the film is ahead, and does without this one. Pictures of one time,
    /// as photos, are all shown.
    pub fn missing(&mut self, taken: Taken, rate: f64, held: u64) -> Option<u64> {
        let (Taken::Live(at) | Taken::File(at)) = taken;
        let since = at.saturating_sub(self.last.unwrap_or(at));
        let longest = match taken {
            // One pause makes no slow camera.
            Taken::Live(_) => {
                LONGEST_AWAY.max(2 * self.interval.unwrap_or(0).min(since).min(SLOWEST))
            }
            Taken::File(_) => LONGEST_STILL,
        };
        if self.last.replace(at).is_some() {
            self.interval = Some(since);
        }
        self.elapsed += since.min(longest);
        // Without a time of its own, or by a clock that began anew, a picture follows the film as it is.
        if since == 0 {
            self.elapsed = self.elapsed.max((held as f64 / rate * 1e9) as u64);
        }
        let behind = self.elapsed as f64 * 1e-9 * rate - held as f64;
        // Less is jitter.
        match since > 0 && behind < -1.0 {
            true => None,
            false if behind > 1.0 => Some(behind.round() as u64),
            false => Some(0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pictures of a film at 30 a second, of those that were taken at these milliseconds.
    fn held(taken: impl Iterator<Item = u64>) -> u64 {
        held_of(taken.map(|ms| Taken::Live(ms * 1_000_000)))
    }

    fn held_of(taken: impl Iterator<Item = Taken>) -> u64 {
        let mut time = RealTime::default();
        taken.fold(0, |held, taken| {
            let missing = time.missing(taken, 30.0, held);
            held + missing.map_or(0, |missing| missing + 1)
        })
    }

    #[test]
    fn ten_seconds_are_ten_seconds() {
        for interval in [33, 34, 50, 100, 900] {
            let last = (10_000 / interval) * interval;
            let film = held((0..=last).step_by(interval as usize)) as f64 / 30.0;
            let off = film - last as f64 / 1000.0;
            assert!(off.abs() < 0.15, "every {interval} ms: {off} s off");
        }
    }

    #[test]
    fn pictures_that_come_faster_than_the_film_shows_them_are_left_out() {
        // A film whose mean rate is lower than that of its beginning.
        let uneven = (0..60).map(|k| k * 1000 / 60);
        let uneven = uneven.chain((0..=90).map(|k| 1000 + k * 100));
        let of_file = uneven.clone().map(|ms| Taken::File(ms * 1_000_000));
        for held in [held(uneven), held_of(of_file)] {
            assert!(held.abs_diff(300) <= 2, "{held}");
        }
        // A camera that is faster than it says.
        let held = held((0..600).map(|k| k * 1000 / 60));
        assert!(held.abs_diff(300) <= 2, "{held}");
    }

    #[test]
    fn a_camera_with_a_picture_every_three_seconds_is_not_away_between_them() {
        let film = held((0..=20).map(|k| 3000 * k)) as f64 / 30.0;
        // The first interval may be a pause.
        assert!((58.0..60.2).contains(&film), "{film} s");
    }

    #[test]
    fn jitter_repeats_nothing_and_a_pause_is_shortened() {
        let jittering = (0..300).map(|k| k * 100 / 3 + if k % 2 == 1 { 14 } else { 0 });
        assert_eq!(held(jittering), 300);
        assert_eq!(held([0, 3_600_000].into_iter()), 1 + 30);
        // The camera's clock began anew.
        assert_eq!(held([5000, 0, 33].into_iter()), 3);
    }

    #[test]
    fn pictures_of_a_file_that_were_left_out_are_made_good_for_and_photos_have_no_times() {
        let number = |k: u64| Taken::File(k * 1_000_000_000 / 30);
        assert_eq!(held_of((0..300).map(number)), 300);
        let damaged = |k: &u64| !(100..103).contains(k) && *k != 200;
        let left = held_of((0..300).filter(damaged).map(number));
        assert!((299..=300).contains(&left), "{left}");
        // A still of five seconds; times that are wrong.
        assert_eq!(held_of([0, 150].map(number).into_iter()), 151);
        assert_eq!(held_of([0, 1_000_000].map(number).into_iter()), 301);
        assert_eq!(held_of([number(0); 5].into_iter()), 5);
    }
}
