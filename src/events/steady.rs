//! A state that changes only when it has been another one for a while.

/// A state and what it may become. All times in seconds.
#[derive(Debug, Clone, Copy)]
pub struct Steady<T> {
    now: T,
    since: f64,
    next: Option<Next<T>>,
}

/// What a state may become.
#[derive(Debug, Clone, Copy)]
struct Next<T> {
    state: T,
    began: f64,
    seen: f64,
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

    /// What it is about to become, having been seen for less than it must hold.
    pub fn becomes(&self) -> Option<T> {
        self.next.map(|next| next.state)
    }

    /// Since when it holds, seconds.
    pub fn since(&self) -> f64 {
        self.since
    }

    /// Moves the moment from which it holds by so many seconds.
    pub fn put_off(&mut self, seconds: f64) {
        self.since += seconds;
    }

    /// Forgets what it may become where that has not been seen for longer than `gap`: what lies between was not looked
    /// at, and tells nothing.
    pub fn lapse(&mut self, time: f64, gap: f64) {
        self.next = self.next.filter(|next| time - next.seen <= gap);
    }

    /// Looks at it at a time; the new state where it has changed now, having been `seen` for `hold` seconds.
    pub fn look(&mut self, seen: T, time: f64, hold: f64) -> Option<T> {
        if seen == self.now {
            self.next = None;
            return None;
        }
        let began = match self.next {
            Some(next) if next.state == seen => next.began,
            _ => time,
        };
        self.next = Some(Next {
            state: seen,
            began,
            seen: time,
        });
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

    #[test]
    fn what_was_not_seen_for_a_while_begins_anew() {
        let mut state = Steady::new(false, 0.0);
        assert_eq!(state.look(true, 1.0, 0.3), None);
        state.lapse(1.2, 0.3);
        assert_eq!(state.look(true, 1.2, 0.3), None, "seen just now");
        state.lapse(9.0, 0.3);
        assert_eq!(state.look(true, 9.0, 0.3), None, "seen long ago");
        assert_eq!(state.look(true, 9.4, 0.3), Some(true));
        assert_eq!(state.since(), 9.0);
    }
}
