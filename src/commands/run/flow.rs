//! Whether bodies come of what is seen: processes may live and yet not reach each other.

use std::time::{Duration, Instant};

use crate::sink::Rhythm;
use crate::supervise::Beat;

/// How long bodies may stay away while observations are published.
const DRY: Duration = Duration::from_secs(5);
/// So often processes are started anew before the supervisor gives up.
const MOST_ATTEMPTS: u32 = 3;

/// What to do about it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Remedy {
    /// Nothing.
    Wait,
    /// Replace `fit`.
    Fit,
    /// Replace both.
    Both,
    /// Nothing has helped: end, so that the service manager starts everything anew.
    GiveUp,
}

/// The way from `infer` through `fit` to the supervisor.
#[derive(Debug, Default)]
pub struct Flow {
    /// Since when `infer` publishes and nothing comes out at the other end.
    dry: Option<Instant>,
    /// When `infer` was seen to publish.
    published: Rhythm,
    /// `fit` hears observations and can use none of them: no bodies are to come.
    is_of_no_use: bool,
    /// What was done about it in vain.
    attempts: u32,
}

impl Flow {
    /// Looks whether bodies were `received` and observations `published` since the last call, and which sign of life
    /// `fit` showed.
    pub fn look(
        &mut self,
        now: Instant,
        received: bool,
        published: bool,
        fit: Option<Beat>,
    ) -> Remedy {
        if let Some(beat) = fit {
            self.is_of_no_use = beat == Beat::Away;
        }
        let published = published && !self.is_of_no_use;
        let mut was_pause = false;
        if published {
            was_pause = self.published.is_silent(DRY, now) == Some(true);
            self.published.hear(now);
        }
        if received {
            (self.dry, self.attempts) = (None, 0);
            return Remedy::Wait;
        }
        if !published {
            return Remedy::Wait;
        }
        if was_pause {
            // Of a pause in which nothing was seen, no bodies were to come.
            self.dry = None;
        }
        if now - *self.dry.get_or_insert(now) < DRY {
            return Remedy::Wait;
        }
        self.dry = None;
        self.attempts += 1;
        match self.attempts {
            1 => Remedy::Fit,
            2..=MOST_ATTEMPTS => Remedy::Both,
            _ => Remedy::GiveUp,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Looks every 100 ms for `seconds`; every remedy and when.
    fn watch(flow: &mut Flow, seconds: u64, received: bool, published: bool) -> Vec<(u64, Remedy)> {
        let start = Instant::now();
        let looks = (0..seconds * 10).map(|t| {
            let now = start + Duration::from_millis(100 * t);
            (t / 10, flow.look(now, received, published, None))
        });
        looks.filter(|(_, r)| *r != Remedy::Wait).collect()
    }

    #[test]
    fn what_is_published_and_arrives_nowhere_is_mended_step_by_step() {
        let remedies = watch(&mut Flow::default(), 22, false, true);
        assert_eq!(
            remedies,
            [
                (5, Remedy::Fit),
                (10, Remedy::Both),
                (15, Remedy::Both),
                (20, Remedy::GiveUp)
            ]
        );
    }

    #[test]
    fn a_pause_in_which_nothing_was_published_is_no_drought() {
        let (mut flow, start) = (Flow::default(), Instant::now());
        let mut look = |seconds: u64| {
            let now = start + Duration::from_secs(seconds);
            flow.look(now, false, true, None)
        };
        assert_eq!(look(0), Remedy::Wait);
        assert_eq!(look(3600), Remedy::Wait);
        assert_eq!(look(3603), Remedy::Wait);
        assert_eq!(look(3605), Remedy::Fit);
    }

    #[test]
    fn bodies_of_a_slow_camera_are_missed_too() {
        let (mut flow, start) = (Flow::default(), Instant::now());
        let mut look = |seconds: u64, received| {
            let now = start + Duration::from_secs(seconds);
            flow.look(now, received, !received, None)
        };
        for seconds in (0..30).step_by(10) {
            assert_eq!(look(seconds, false), Remedy::Wait);
            assert_eq!(look(seconds + 1, true), Remedy::Wait, "its bodies");
        }
        assert_eq!(look(30, false), Remedy::Wait);
        assert_eq!(look(40, false), Remedy::Fit);
        assert_eq!(look(50, false), Remedy::Wait);
        assert_eq!(look(60, false), Remedy::Both);
    }

    #[test]
    fn of_observations_that_are_of_no_use_no_bodies_are_missed() {
        let (mut flow, start) = (Flow::default(), Instant::now());
        for t in 0..600 {
            // Signs of life come less often than looks; the first says nothing yet.
            let fit = match t {
                0 => Some(Beat::Idle),
                _ => (t % 2 == 0).then_some(Beat::Away),
            };
            let now = start + Duration::from_millis(50 * t);
            assert_eq!(flow.look(now, false, true, fit), Remedy::Wait, "{t}");
        }
        // Another camera's are.
        let start = start + Duration::from_secs(30);
        let fits = Some(Beat::Idle);
        let mut looks = (0..120).map(|t| {
            let now = start + Duration::from_millis(50 * t);
            flow.look(now, false, true, fits)
        });
        assert!(looks.any(|remedy| remedy == Remedy::Fit));
    }

    #[test]
    fn without_observations_no_bodies_are_missed() {
        assert_eq!(watch(&mut Flow::default(), 60, false, false), []);
        let mut flow = Flow::default();
        watch(&mut flow, 7, false, true);
        assert_eq!(watch(&mut flow, 60, true, true), []);
        let again = watch(&mut flow, 6, false, true);
        assert_eq!(again, [(5, Remedy::Fit)], "what was in vain is forgotten");
    }
}
