//! When a record's frames were, made of times that stand still, go back or say nothing.

use crate::camera::RESTART_NS;

/// Frames a second of a record whose times say nothing, such as one of photos.
pub const RATE: f64 = 30.0;
/// A time between frames counts as one without a frame missing, in usual ones.
const USUAL: f64 = 1.75;

/// A message's number and time, nanoseconds.
pub type Stamp = (u64, u64);

/// Seconds after the first frame, rising; `None` for a frame that is to be left out, as it is no later than the last.
///
/// Times that go back far belong to another recording, which goes on where the one before has ended. Where most frames
/// are no later than the one before, they are evenly spaced, [`RATE`] a second.
pub fn seconds(stamps: &[Stamp]) -> Vec<Option<f64>> {
    let Some(usual) = usual_step(stamps) else {
        let numbers = 0..stamps.len();
        return numbers.map(|k| Some(k as f64 / RATE)).collect();
    };
    let mut clock = Clock::default();
    let times = stamps.iter().map(|&(_, time)| {
        let now = clock.look(time, usual)?;
        Some((now - stamps[0].1) as f64 * 1e-9)
    });
    times.collect()
}

/// The median of the times between frames, nanoseconds; `None` where most frames are no later than the one before.
pub fn usual_step(stamps: &[Stamp]) -> Option<u64> {
    // Bodies that are held while no picture comes are the same message again: they say nothing of the times.
    let steps = stamps.windows(2).filter(|pair| pair[0] != pair[1]);
    let (mut all, mut rising) = (0, Vec::new());
    for pair in steps {
        all += 1;
        rising.extend(pair[1].1.checked_sub(pair[0].1).filter(|step| *step > 0));
    }
    rising.sort_unstable();
    let usual = rising.get(rising.len() / 2).copied();
    usual.filter(|_| 2 * rising.len() >= all)
}

/// Frames a second, by the `steps` between frames that follow each other, seconds: those with somebody in both frames
/// (`true`) where there are any. Steps over frames that are missing do not count.
pub fn usual_rate(steps: impl Iterator<Item = (f64, bool)>) -> Option<f64> {
    let steps = inhabited_steps(steps);
    let median = *steps.get(steps.len() / 2)?;
    // The median alone would be as coarse as the record's clock, which often counts milliseconds.
    let usual = steps.partition_point(|step| *step <= USUAL * median);
    let sum: f64 = steps[..usual].iter().sum();
    Some(usual as f64 / sum)
}

/// Steps between frames that follow each other, seconds, sorted: those with somebody in both frames (`true`), as live
/// cameras look at empty places less often; all of them where there are none.
fn inhabited_steps(steps: impl Iterator<Item = (f64, bool)>) -> Vec<f64> {
    let (inhabited, others): (Vec<_>, Vec<_>) = steps.partition(|(_, inhabited)| *inhabited);
    let chosen = match inhabited.is_empty() {
        true => others,
        false => inhabited,
    };
    let mut steps: Vec<f64> = chosen.into_iter().map(|(step, _)| step).collect();
    steps.sort_by(f64::total_cmp);
    steps
}

/// The clock of the first of several recordings, on which the others follow it. All in nanoseconds.
#[derive(Debug, Default)]
pub struct Clock {
    /// The recording's first time on its own clock, and on this one.
    origin: u64,
    began: u64,
    newest: Option<u64>,
}

impl Clock {
    /// The time of a frame that is later than all before; one that begins another recording comes `usual` after them.
    pub fn look(&mut self, time: u64, usual: u64) -> Option<u64> {
        if let Some(newest) = self.newest {
            let known = self.origin.saturating_add(newest - self.began);
            if time.saturating_add(RESTART_NS) < known {
                (self.origin, self.began) = (time, newest.saturating_add(usual));
            }
        }
        let now = self.began.saturating_add(time.saturating_sub(self.origin));
        if self.newest.is_some_and(|newest| now <= newest) {
            return None;
        }
        self.newest = Some(now);
        Some(now)
    }
}
