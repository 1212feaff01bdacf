//! Lets a film last as long as what it shows, though pictures were left out, or come at uneven times.

/// A longer pause of a camera is shortened to this, nanoseconds: a film of one that was unplugged is not one of its
/// absence.
const LONGEST_AWAY: u64 = 1_000_000_000;
/// The same within a file, whose times may be wrong.
const LONGEST_STILL: u64 = 10_000_000_000;

/// Where a film has to be when a picture comes.
#[derive(Debug, Clone, Default)]
pub struct RealTime {
    last: Option<u64>,
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
    /// pictures a second and holds so many.
    pub fn missing(&mut self, taken: Taken, rate: f64, held: u64) -> u64 {
        let (at, longest) = match taken {
            Taken::Live(at) => (at, LONGEST_AWAY),
            Taken::File(at) => (at, LONGEST_STILL),
        };
        let since = at.saturating_sub(self.last.unwrap_or(at));
        self.last = Some(at);
        self.elapsed += since.min(longest);
        let behind = self.elapsed as f64 * 1e-9 * rate - held as f64;
        // Less is jitter.
        if behind > 1.0 {
            behind.round() as u64
        } else {
            0
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
        taken.fold(0, |held, taken| held + time.missing(taken, 30.0, held) + 1)
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
