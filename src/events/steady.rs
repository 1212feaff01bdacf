//! A state that changes only when it has been another one for a while.

/// A state and what it may become.
#[derive(Debug, Clone, Copy)]
pub struct Steady<T> {
    now: T,
    since: f64,
    next: Option<(T, f64)>,
}

impl<T: Copy + PartialEq> Steady<T> {
    /// A state from the time `since` on, seconds.
    pub fn new(now: T, since: f64) -> Self {
        Self {
            now,
            since,
            next: None,
        }
    }

    /// The state.
    pub fn get(&self) -> T {
        self.now
    }

    /// Since when it holds, seconds.
    pub fn since(&self) -> f64 {
        self.since
    }

    /// Looks at it at a time; the new state where it has changed now, having been `seen` for `hold` seconds.
    pub fn look(&mut self, seen: T, time: f64, hold: f64) -> Option<T> {
        if seen == self.now {
            self.next = None;
            return None;
        }
        let began = match self.next {
            Some((next, began)) if next == seen => began,
            _ => time,
        };
        self.next = Some((seen, began));
        if time - began < hold {
            return None;
        }
        *self = Self::new(seen, began);
        Some(seen)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flicker_changes_nothing_and_what_holds_counts_from_its_beginning() {
        let mut state = Steady::new(false, 0.0);
        for step in 0..21 {
            let time = f64::from(step) * 0.1;
            assert_eq!(state.look(step % 2 == 1, time, 0.3), None);
        }
        assert_eq!(state.look(true, 2.1, 0.3), None);
        assert_eq!(state.look(true, 2.3, 0.3), None);
        assert_eq!(state.look(true, 2.5, 0.3), Some(true));
        assert_eq!(state.look(true, 2.6, 0.3), None);
        assert!(state.get());
        assert_eq!(state.since(), 2.1);
    }
}
