//! Which observations of a joint are held back: a jump away from its prediction counts once it has lasted.

/// A distance that has lasted for this long, seconds, is no outlier: three frames at 30 a second, none at 6, where the
/// prediction reaches less far than people move.
const LASTS: f64 = 0.12;

/// What to do with an observation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It counts.
    Counts,
    /// It is left out.
    HeldBack,
    /// It counts from now on, and nothing that was there before it does.
    Anew,
}

/// One joint's gate: for how long its observations have been far from their prediction, seconds.
#[derive(Debug, Clone, Copy, Default)]
pub struct Gate(f64);

impl Gate {
    /// An observation `dt` seconds after the last one, `far` from its prediction or not. Once a distance has lasted it
    /// stays accepted: were it doubted again, a fit in a wrong pose would follow one frame of four.
    pub fn look(&mut self, far: bool, dt: f64) -> Verdict {
        if !far {
            self.0 = 0.0;
            Verdict::Counts
        } else if self.0 >= LASTS {
            Verdict::Counts
        } else {
            self.0 += dt;
            if self.0 < LASTS {
                Verdict::HeldBack
            } else {
                Verdict::Anew
            }
        }
    }

    /// Whether the last observation was left out.
    pub fn holds(self) -> bool {
        self.0 > 0.0 && self.0 < LASTS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn looks(far: &[bool], dt: f64) -> Vec<Verdict> {
        let mut gate = Gate::default();
        far.iter().map(|f| gate.look(*f, dt)).collect()
    }

    #[test]
    fn a_jump_is_held_back_and_one_that_lasts_is_followed_from_then_on() {
        use Verdict::{Anew, Counts, HeldBack};
        let dt = 1.0 / 30.0;
        assert_eq!(looks(&[false, true, false], dt), [Counts, HeldBack, Counts]);
        let lasting = looks(&[true; 40], dt);
        assert_eq!(lasting[..4], [HeldBack, HeldBack, HeldBack, Anew]);
        assert!(lasting[4..].iter().all(|v| *v == Counts), "{lasting:?}");
    }

    #[test]
    fn slow_cameras_hold_nothing_back() {
        let slow = looks(&[true, true, false, true], 1.0 / 6.0);
        assert!(!slow.contains(&Verdict::HeldBack), "{slow:?}");
    }

    #[test]
    fn it_says_whether_it_holds() {
        let mut gate = Gate::default();
        assert!(!gate.holds());
        gate.look(true, 0.05);
        assert!(gate.holds());
        gate.look(true, 0.1);
        assert!(!gate.holds());
    }
}
