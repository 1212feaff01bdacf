//! When the next picture is looked at, and how. Times and what was seen go in, plans come out; no clock of its own.
//!
//! ```text
//! Full ──nobody at any size for 2.5 s──▶ Idle: a glance three times a second; the network only where something changed
//!   ▲                                     │
//!   └───────────somebody──────────────────┘
//! ```

use super::due::Due;

/// How long nobody must have been seen, at every size of the input in its turn, nanoseconds.
const EMPTY_NS: u64 = 2_500_000_000;
/// From one glance to the next. With a camera's picture to wait for, and the look itself, somebody who enters is seen
/// within 400 ms.
const GLANCE_NS: u64 = 300_000_000;
/// How often the largest input is looked at where things move and nobody is there.
const LARGE_NS: u64 = 950_000_000;
/// How often an empty place is looked at although nothing has changed.
const ANYWAY_NS: u64 = 10_000_000_000;

/// How fast pictures may come, and whether an empty place has fewer of them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Limits {
    /// Least time between two pictures, nanoseconds.
    pub interval_ns: u64,
    /// Whether every picture is looked at, even while nobody is in view.
    pub never_idle: bool,
}

/// How the next picture is looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Plan {
    /// Pictures taken before this are left out.
    pub from_ns: u64,
    /// What is wanted of it.
    pub wanted: Wanted,
}

/// What is wanted of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wanted {
    /// Its colours.
    Colours,
    /// Its brightness, to compare others with, and its colours.
    Both,
    /// Both, but only if something has changed.
    BothIfChanged,
}

/// Which inputs an idle look takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Look {
    /// The largest as well, where the smallest shows nobody.
    pub large: bool,
}

/// The state machine.
#[derive(Debug)]
pub struct Pace {
    limits: Limits,
    state: State,
    /// The next picture, by the limit of pictures per second.
    due: Due,
}

#[derive(Debug, Clone, Copy)]
enum State {
    Full {
        /// Since when nobody has been seen.
        empty_since: Option<u64>,
    },
    Idle {
        /// The last glance or look.
        last: u64,
        /// The last look with the largest input.
        large: u64,
        /// The last look.
        looked: u64,
    },
}

impl Pace {
    /// Of a camera that starts now.
    pub fn new(limits: Limits) -> Self {
        Self {
            due: Due::new(limits.interval_ns),
            limits,
            state: State::Full { empty_since: None },
        }
    }

    /// Whether nobody has been in view for a while.
    pub fn is_idle(&self) -> bool {
        matches!(self.state, State::Idle { .. })
    }

    /// What comes after a picture taken at `now`.
    pub fn plan(&mut self, now: u64) -> Plan {
        self.due.done(now);
        match self.state {
            State::Full { .. } => Plan {
                from_ns: self.due.at_ns(),
                wanted: Wanted::Colours,
            },
            State::Idle { last, looked, .. } => Plan {
                from_ns: last.saturating_add(GLANCE_NS).max(self.due.at_ns()),
                wanted: if last - looked < ANYWAY_NS {
                    Wanted::BothIfChanged
                } else {
                    Wanted::Both
                },
            },
        }
    }

    /// A picture taken at `now` showed so many people, at full rate.
    pub fn seen(&mut self, now: u64, people: usize) {
        let State::Full { empty_since } = &mut self.state else {
            return;
        };
        if people > 0 || self.limits.never_idle {
            *empty_since = None;
            return;
        }
        // A clock that went backwards is another camera's.
        let since = *empty_since.get_or_insert(now);
        if since > now {
            *empty_since = Some(now);
        } else if now - since >= EMPTY_NS {
            self.state = State::Idle {
                last: now,
                large: 0,
                looked: now,
            };
        }
    }

    /// A glance at `now` showed nothing new.
    pub fn unchanged(&mut self, now: u64) {
        if let State::Idle { last, .. } = &mut self.state {
            *last = now;
        }
    }

    /// Something has changed in a picture taken at `now`: how it is looked at.
    pub fn look(&self, now: u64) -> Look {
        match self.state {
            State::Idle { large, .. } => Look {
                large: now.saturating_sub(large) >= LARGE_NS,
            },
            State::Full { .. } => Look { large: true },
        }
    }

    /// That look showed so many people. Returns whether the picture is known to be empty: whatever equals it is, too.
    pub fn looked(&mut self, now: u64, with: Look, people: usize) -> bool {
        let State::Idle {
            last,
            large,
            looked,
        } = &mut self.state
        else {
            return false;
        };
        if people > 0 {
            self.state = State::Full { empty_since: None };
            return false;
        }
        (*last, *looked) = (now, now);
        if with.large {
            *large = now;
        }
        with.large
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: u64 = 33_333_333;
    const SECOND: u64 = 1_000_000_000;

    /// A camera of 30 pictures a second, and how the pace looked at it.
    struct Film {
        pace: Pace,
        next: u64,
        plan: Plan,
        /// Times of the pictures that were looked at, and whether the network was run.
        looks: Vec<(u64, bool)>,
    }

    impl Film {
        fn new(limits: Limits) -> Self {
            let mut pace = Pace::new(limits);
            Self {
                plan: pace.plan(0),
                pace,
                next: FRAME,
                looks: Vec::new(),
            }
        }

        /// Plays until `end`; `people` in view, who are seen, and `change` against an empty picture.
        fn play(&mut self, end: u64, people: usize, change: bool) {
            while self.next < end {
                let now = self.next;
                self.next += FRAME;
                if now < self.plan.from_ns {
                    continue;
                }
                let idle = self.pace.is_idle();
                let network = self.plan.wanted != Wanted::BothIfChanged || change;
                self.looks.push((now, network));
                match (idle, network) {
                    (false, _) => self.pace.seen(now, people),
                    (true, true) => {
                        let look = self.pace.look(now);
                        self.pace.looked(now, look, people);
                    }
                    (true, false) => self.pace.unchanged(now),
                }
                self.plan = self.pace.plan(now);
            }
        }

        fn between(&self, from: u64, to: u64) -> (usize, usize) {
            let within = self.looks.iter().filter(|l| (from..to).contains(&l.0));
            (within.clone().count(), within.filter(|l| l.1).count())
        }
    }

    #[test]
    fn with_somebody_in_view_every_picture_is_looked_at() {
        let mut film = Film::new(Limits::default());
        film.play(60 * SECOND, 1, true);
        assert_eq!(film.looks.len(), 1800);
    }

    #[test]
    fn an_empty_place_is_glanced_at_three_times_a_second() {
        let mut film = Film::new(Limits::default());
        film.play(60 * SECOND, 0, false);
        assert!(film.pace.is_idle());
        let (glances, networks) = film.between(10 * SECOND, 60 * SECOND);
        assert!((145..=155).contains(&glances), "{glances} in 50 s");
        assert!((4..=5).contains(&networks), "{networks} in 50 s");
    }

    #[test]
    fn whoever_enters_is_looked_at_at_full_rate_within_400_ms() {
        for phase in 0..20 {
            let mut film = Film::new(Limits::default());
            let enters = 10 * SECOND + phase * SECOND / 50;
            film.play(enters, 0, false);
            assert!(film.pace.is_idle());
            film.play(enters + SECOND * 2 / 5, 1, true);
            assert!(!film.pace.is_idle());
            let n = film.looks.len();
            film.play(enters + SECOND * 2 / 5 + SECOND, 1, true);
            assert_eq!(film.looks.len() - n, 30);
        }
    }

    #[test]
    fn what_moves_and_is_nobody_costs_three_looks_a_second_and_one_large_one() {
        let mut film = Film::new(Limits::default());
        film.play(10 * SECOND, 0, false);
        let mut larges = 0;
        for k in 0..30 {
            let now = 10 * SECOND + k * 10 * FRAME;
            let look = film.pace.look(now);
            larges += u32::from(look.large);
            // Known to be empty only if everybody would have been seen.
            assert_eq!(film.pace.looked(now, look, 0), look.large);
        }
        assert_eq!(larges, 10);
        assert!(film.pace.is_idle());
    }

    #[test]
    fn a_moment_without_anybody_changes_nothing() {
        let mut film = Film::new(Limits::default());
        for k in 1..20 {
            film.play(k * 2 * SECOND, 0, true);
            film.play(k * 2 * SECOND + SECOND / 10, 1, true);
        }
        assert_eq!(film.looks.len() as u64, (38 * SECOND + SECOND / 10) / FRAME);
    }

    #[test]
    fn no_more_pictures_than_wanted_and_hardly_fewer() {
        for fps in [1, 5, 10, 12, 15, 25, 30, 60] {
            let mut film = Film::new(Limits {
                interval_ns: SECOND / fps,
                never_idle: false,
            });
            film.play(60 * SECOND, 1, true);
            let expected = 60 * fps.min(30);
            let found = film.looks.len() as u64;
            assert!(
                found <= expected + 1 && found * 20 >= expected * 19,
                "{found} for {expected}"
            );
        }
    }

    #[test]
    fn who_wants_every_picture_gets_every_picture() {
        let mut film = Film::new(Limits {
            never_idle: true,
            ..Limits::default()
        });
        film.play(20 * SECOND, 0, false);
        assert_eq!(film.looks.len(), 600);
    }
}
