//! When a child is taken for hung, and when it is started again. Instants go in, verdicts come out.

use std::time::{Duration, Instant};

const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LONGEST_PAUSE: Duration = Duration::from_secs(10);
/// A process that ran this long has recovered: its next crash is a first one again.
const STABLE: Duration = Duration::from_secs(30);
/// How long a child may take from its start to its first beat: it loads its model meanwhile.
const START: Duration = Duration::from_secs(10);
/// How long a child may be silent after that, unless it has been slower before.
const SILENCE: Duration = Duration::from_secs(2);
/// So many times its longest pause between beats.
const SLOWNESS: u32 = 8;
/// Longer than this between two looks: the supervisor itself was stopped, and its children perhaps with it.
const OWN_STOP: Duration = Duration::from_millis(500);

/// What to do now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Nothing.
    Wait,
    /// Start it.
    Start,
    /// End it by force: it hangs.
    Kill,
}

/// The state of one child.
#[derive(Debug)]
pub struct Policy {
    pause: Duration,
    state: State,
    looked: Instant,
}

#[derive(Debug)]
enum State {
    Running {
        since: Instant,
        /// Of the last beat, if there was one.
        beat: Option<Instant>,
        longest: Duration,
    },
    Waiting {
        until: Instant,
    },
    Ended,
}

impl Policy {
    /// Of a child that is to be started.
    pub fn new(now: Instant) -> Self {
        Self {
            pause: FIRST_PAUSE,
            state: State::Waiting { until: now },
            looked: now,
        }
    }

    /// It has been started.
    pub fn started(&mut self, now: Instant) {
        self.state = State::Running {
            since: now,
            beat: None,
            longest: Duration::ZERO,
        };
    }

    /// It has shown that it lives.
    pub fn beat(&mut self, now: Instant) {
        if let State::Running { beat, longest, .. } = &mut self.state {
            if let Some(last) = *beat {
                *longest = (*longest).max(now - last);
            }
            *beat = Some(now);
        }
    }

    /// It has ended, and is to be started again after a pause that doubles from crash to crash.
    pub fn restart(&mut self, now: Instant) {
        if let State::Running { since, .. } = self.state
            && now - since > STABLE
        {
            self.pause = FIRST_PAUSE;
        }
        self.state = State::Waiting {
            until: now + self.pause,
        };
        self.pause = (self.pause * 2).min(LONGEST_PAUSE);
    }

    /// It has ended for good.
    pub fn ended(&mut self) {
        self.state = State::Ended;
    }

    /// What to do now; ask several times a second.
    pub fn look(&mut self, now: Instant) -> Verdict {
        let stopped = now - self.looked > OWN_STOP;
        self.looked = now;
        match &mut self.state {
            State::Running { since, beat, .. } if stopped => {
                *since = now;
                *beat = beat.map(|_| now);
                Verdict::Wait
            }
            State::Running {
                since,
                beat,
                longest,
            } => {
                let silent = match beat {
                    Some(beat) => now - *beat > SILENCE.max(*longest * SLOWNESS),
                    None => now - *since > START,
                };
                if silent { Verdict::Kill } else { Verdict::Wait }
            }
            State::Waiting { until } if now >= *until => Verdict::Start,
            State::Waiting { .. } | State::Ended => Verdict::Wait,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(n: u64) -> Duration {
        Duration::from_millis(n)
    }

    /// Looks every 100 ms for `time`, beating every `beat`; the first verdict that is not to wait, and when.
    fn watch(
        policy: &mut Policy,
        from: Instant,
        time: u64,
        beat: Option<u64>,
    ) -> Option<(Verdict, u64)> {
        for t in (0..=time).step_by(100) {
            let now = from + ms(t);
            if beat.is_some_and(|b| t % b == 0) {
                policy.beat(now);
            }
            match policy.look(now) {
                Verdict::Wait => {}
                verdict => return Some((verdict, t)),
            }
        }
        None
    }

    #[test]
    fn who_beats_lives_and_who_falls_silent_is_killed() {
        let now = Instant::now();
        let mut policy = Policy::new(now);
        assert_eq!(policy.look(now), Verdict::Start);
        policy.started(now);
        assert_eq!(watch(&mut policy, now, 60_000, Some(100)), None);
        let silent = watch(&mut policy, now + ms(60_000), 60_000, None);
        assert_eq!(silent, Some((Verdict::Kill, 2100)));
    }

    #[test]
    fn a_slow_start_and_slow_steps_are_no_hang() {
        let now = Instant::now();
        let mut policy = Policy::new(now);
        policy.started(now);
        assert_eq!(watch(&mut policy, now, 9_900, None), None);
        assert_eq!(
            watch(&mut policy, now + ms(10_000), 60_000, Some(900)),
            None
        );
        let silent = watch(&mut policy, now + ms(70_100), 60_000, None);
        assert!(
            matches!(silent, Some((Verdict::Kill, 6_000..9_000))),
            "{silent:?}"
        );
    }

    #[test]
    fn pauses_double_until_it_has_recovered() {
        let mut now = Instant::now();
        let mut policy = Policy::new(now);
        let mut pauses = Vec::new();
        for _ in 0..9 {
            policy.started(now);
            policy.restart(now);
            let (verdict, pause) = watch(&mut policy, now, 20_000, None).unwrap();
            assert_eq!(verdict, Verdict::Start);
            pauses.push(pause);
            now += ms(pause);
        }
        assert_eq!(
            pauses,
            [100, 200, 400, 800, 1600, 3200, 6400, 10_000, 10_000]
        );
        policy.started(now);
        policy.restart(now + ms(31_000));
        let again = watch(&mut policy, now + ms(31_000), 20_000, None);
        assert_eq!(again, Some((Verdict::Start, 100)));
    }

    #[test]
    fn after_a_stop_of_its_own_the_supervisor_waits_anew() {
        let now = Instant::now();
        let mut policy = Policy::new(now);
        policy.started(now);
        policy.beat(now);
        assert_eq!(policy.look(now + ms(60_000)), Verdict::Wait);
        assert_eq!(watch(&mut policy, now + ms(60_000), 1_900, None), None);
    }

    #[test]
    fn who_ended_for_good_stays_away() {
        let now = Instant::now();
        let mut policy = Policy::new(now);
        policy.started(now);
        policy.ended();
        assert_eq!(watch(&mut policy, now, 20_000, None), None);
    }
}
