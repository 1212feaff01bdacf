//! Whether bodies come of what is seen: processes may live and yet not reach each other.

use std::time::{Duration, Instant};

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
    /// When `infer` was last seen to publish.
    published: Option<Instant>,
    /// What was done about it in vain.
    attempts: u32,
}

impl Flow {
    /// Looks whether bodies were `received` and observations `published` since the last call.
    pub fn look(&mut self, now: Instant, received: bool, published: bool) -> Remedy {
        if received {
            *self = Self::default();
            return Remedy::Wait;
        }
        if !published {
            return Remedy::Wait;
        }
        let before = self.published.replace(now);
        if before.is_some_and(|b| now - b > DRY) {
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
            (t / 10, flow.look(now, received, published))
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
        let mut look = |seconds: u64| flow.look(start + Duration::from_secs(seconds), false, true);
        assert_eq!(look(0), Remedy::Wait);
        assert_eq!(look(3600), Remedy::Wait);
        assert_eq!(look(3603), Remedy::Wait);
        assert_eq!(look(3605), Remedy::Fit);
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
