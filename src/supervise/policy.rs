//! When a child is taken for hung, and when it is started again. Instants go in, verdicts come out.
//!
//! | a child that | is ended after |
//! |---|---|
//! | is stopped (SIGSTOP) | 1 s |
//! | works and neither computes nor shows a step (a deadlock) | 1 s |
//! | works, computes and shows no step | 5 s, or 8 times its longest step of the last 5 to 10 minutes |
//! | opens its input, or starts, and computes nothing | 10 s |
//! | opens its input, or starts, and computes | 30 s |
//! | has made no step in these minutes whose length is known, and computes | 30 s |

use std::time::{Duration, Instant};

use super::heartbeat::Beat;

/// Silence below this is not looked into.
const QUIET: Duration = Duration::from_millis(300);
/// So long, silence included, may a child be stopped or, where it has an input, still.
const STILL: Duration = Duration::from_secs(1);
/// So long may a child compute without a step, unless it has been slower before.
const BUSY: Duration = Duration::from_secs(5);
/// So many times its longest step.
const SLOWNESS: u32 = 8;
/// Half of the time for which a step is remembered.
const HALF: Duration = Duration::from_secs(5 * 60);
/// So long may opening an input take: cameras wait for their bus.
const OPENING: Duration = Duration::from_secs(10);
/// So long may a start take that computes: it packs a model's weights, perhaps on a machine that does much else.
pub(super) const STARTING: Duration = Duration::from_secs(30);
/// Longer than this between two looks: the supervisor itself was stopped, and its children perhaps with it.
const OWN_STOP: Duration = Duration::from_millis(500);

/// One death is forgotten for so long a life.
const FORGOTTEN_AFTER: Duration = Duration::from_millis(500);
/// So many deaths at once are no reason to wait, and more are not held against a child that has worked since.
const FREE_DEATHS: f64 = 2.0;
const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LONGEST_PAUSE: Duration = Duration::from_secs(10);

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

/// What a silent child does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activity {
    /// It computes, wants to, or waits for a disk.
    Busy,
    /// It waits for something.
    Still,
    /// Somebody stopped it.
    Stopped,
}

/// The state of one child.
#[derive(Debug)]
pub struct Policy {
    /// Deaths that are not forgotten.
    deaths: f64,
    state: State,
    looked: Instant,
}

#[derive(Debug)]
enum State {
    Running {
        since: Instant,
        /// Of the last beat, or of the start.
        beat: Instant,
        /// It has no input yet, or none at the moment: the next step may open one.
        opening: bool,
        steps: Steps,
        /// What it does instead of beating, and since when.
        silence: Option<(Activity, Instant)>,
    },
    Waiting {
        until: Instant,
    },
    Ended,
}

/// How long steps have taken of late.
#[derive(Debug)]
struct Steps {
    /// The longest since `since`, and of the half before.
    longest: [Option<Duration>; 2],
    since: Instant,
}

impl Steps {
    fn new(now: Instant) -> Self {
        Self {
            longest: [None; 2],
            since: now,
        }
    }

    /// Forgets what was too long ago.
    fn forget(&mut self, now: Instant) {
        let passed = now.saturating_duration_since(self.since);
        if passed >= HALF {
            let before = self.longest[0].filter(|_| passed < 2 * HALF);
            self.longest = [None, before];
            self.since = now;
        }
    }

    fn made(&mut self, step: Duration) {
        self.longest[0] = self.longest[0].max(Some(step));
    }

    /// So long may the next one take. Nobody knows of a first one how slow the machine is.
    fn patience(&self) -> Duration {
        let longest = self.longest[0].max(self.longest[1]);
        longest.map_or(STARTING, |l| BUSY.max(l * SLOWNESS))
    }
}

impl Policy {
    /// Of a child that is to be started.
    pub fn new(now: Instant) -> Self {
        Self {
            deaths: 0.0,
            state: State::Waiting { until: now },
            looked: now,
        }
    }

    /// It has been started.
    pub fn started(&mut self, now: Instant) {
        self.state = State::Running {
            since: now,
            beat: now,
            opening: true,
            steps: Steps::new(now),
            silence: None,
        };
    }

    /// It has shown that it lives.
    pub fn beat(&mut self, now: Instant, kind: Beat) {
        // While the supervisor did not look the child may have beaten all along.
        let was_stopped = now - self.looked > OWN_STOP;
        if let State::Running {
            beat,
            opening,
            steps,
            silence,
            ..
        } = &mut self.state
        {
            steps.forget(now);
            if kind == Beat::Step {
                self.deaths = self.deaths.min(FREE_DEATHS);
                if !*opening && !was_stopped {
                    steps.made(now - *beat);
                }
            }
            *beat = now;
            *opening = matches!(kind, Beat::Waiting | Beat::Away);
            *silence = None;
        }
    }

    /// It has ended, and is to be started again: at once where it lived, after a pause that doubles where it dies again
    /// and again within half a second without any work done, and after the first pause at most where it worked.
    pub fn restart(&mut self, now: Instant) {
        if let State::Running { since, .. } = self.state {
            let lived = (now - since).div_duration_f64(FORGOTTEN_AFTER);
            self.deaths = (self.deaths - lived).max(0.0) + 1.0;
        }
        let beyond = self.deaths - FREE_DEATHS;
        let pause = if beyond <= 0.0 {
            Duration::ZERO
        } else {
            FIRST_PAUSE
                .mul_f64(2f64.powf((beyond.ceil() - 1.0).min(16.0)))
                .min(LONGEST_PAUSE)
        };
        self.state = State::Waiting { until: now + pause };
    }

    /// It has ended for good.
    pub fn ended(&mut self) {
        self.state = State::Ended;
    }

    /// What to do now; ask several times a second. `activity` is asked for where the child has been silent for long.
    pub fn look(&mut self, now: Instant, activity: impl FnOnce() -> Activity) -> Verdict {
        let was_stopped = now - self.looked > OWN_STOP;
        self.looked = now;
        match &mut self.state {
            State::Running { beat, silence, .. } if was_stopped => {
                *beat = now;
                *silence = None;
                Verdict::Wait
            }
            State::Running {
                beat,
                opening,
                steps,
                silence,
                ..
            } => {
                let silent = now - *beat;
                if silent <= QUIET {
                    return Verdict::Wait;
                }
                let doing = activity();
                let since = match *silence {
                    Some((before, since)) if before == doing => since,
                    _ => now,
                };
                *silence = Some((doing, since));
                let still = QUIET + (now - since) >= STILL;
                let hangs = match (doing, *opening) {
                    (Activity::Stopped, _) | (Activity::Still, false) => still,
                    (Activity::Still, true) => silent > OPENING,
                    (Activity::Busy, false) => silent > steps.patience(),
                    (Activity::Busy, true) => silent > STARTING,
                };
                if hangs { Verdict::Kill } else { Verdict::Wait }
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
        beat: Option<(u64, Beat)>,
        activity: Activity,
    ) -> Option<(Verdict, u64)> {
        for t in (0..=time).step_by(100) {
            let now = from + ms(t);
            if let Some((_, kind)) = beat.filter(|(every, _)| t % every == 0) {
                policy.beat(now, kind);
            }
            match policy.look(now, || activity) {
                Verdict::Wait => {}
                verdict => return Some((verdict, t)),
            }
        }
        None
    }

    fn running() -> (Policy, Instant) {
        let now = Instant::now();
        let mut policy = Policy::new(now);
        assert_eq!(policy.look(now, || Activity::Busy), Verdict::Start);
        policy.started(now);
        (policy, now)
    }

    /// A child that has worked for a second, and then.
    fn silent(last: Beat, activity: Activity) -> Option<(Verdict, u64)> {
        let (mut policy, now) = running();
        let worked = watch(&mut policy, now, 1_000, Some((100, last)), Activity::Busy);
        assert_eq!(worked, None);
        watch(&mut policy, now + ms(1_000), 120_000, None, activity)
    }

    fn killed(range: std::ops::RangeInclusive<u64>, verdict: Option<(Verdict, u64)>) {
        assert!(
            matches!(verdict, Some((Verdict::Kill, t)) if range.contains(&t)),
            "{verdict:?}"
        );
    }

    #[test]
    fn a_stopped_or_deadlocked_child_is_ended_within_a_second() {
        killed(900..=1_200, silent(Beat::Step, Activity::Stopped));
        killed(900..=1_200, silent(Beat::Step, Activity::Still));
        killed(900..=1_200, silent(Beat::Idle, Activity::Still));
    }

    #[test]
    fn one_that_is_stopped_in_its_start_is_too() {
        let (mut policy, now) = running();
        killed(
            900..=1_200,
            watch(&mut policy, now, 5_000, None, Activity::Stopped),
        );
    }

    #[test]
    fn one_that_computes_is_given_time() {
        killed(5_000..=5_300, silent(Beat::Step, Activity::Busy));
    }

    #[test]
    fn one_that_opens_a_camera_is_given_time() {
        for kind in [Beat::Waiting, Beat::Away] {
            killed(10_000..=10_300, silent(kind, Activity::Still));
            killed(900..=1_200, silent(kind, Activity::Stopped));
        }
        let (mut policy, now) = running();
        killed(
            10_000..=10_300,
            watch(&mut policy, now, 60_000, None, Activity::Still),
        );
    }

    #[test]
    fn who_beats_lives() {
        let (mut policy, now) = running();
        for kind in [Beat::Step, Beat::Idle, Beat::Waiting, Beat::Away] {
            let beats = Some((100, kind));
            assert_eq!(
                watch(&mut policy, now, 60_000, beats, Activity::Still),
                None
            );
        }
    }

    #[test]
    fn a_slow_start_and_slow_steps_are_no_hang() {
        let (mut policy, now) = running();
        let started = watch(&mut policy, now, 29_900, None, Activity::Busy);
        assert_eq!(started, None);
        let slow = Some((4_000, Beat::Step));
        let from = now + ms(29_900);
        assert_eq!(watch(&mut policy, from, 60_000, slow, Activity::Busy), None);
        let silent = watch(&mut policy, from + ms(60_000), 60_000, None, Activity::Busy);
        killed(30_000..=33_000, silent);
    }

    #[test]
    fn one_whose_every_picture_takes_long_works_on() {
        let (mut policy, now) = running();
        let slow = Some((8_000, Beat::Step));
        assert_eq!(watch(&mut policy, now, 120_000, slow, Activity::Busy), None);
        // Its camera was away for longer than steps are remembered.
        let away = Some((100, Beat::Away));
        let from = now + ms(120_000);
        let waited = watch(&mut policy, from, 3_600_000, away, Activity::Still);
        assert_eq!(waited, None);
        let back = from + ms(3_600_000);
        assert_eq!(watch(&mut policy, back, 60_000, slow, Activity::Busy), None);
    }

    #[test]
    fn a_long_step_is_forgotten() {
        let quick = Some((100, Beat::Step));
        for (quick_for, patience) in [(200_000, 39_200..=39_500), (3_600_000, 5_000..=5_300)] {
            let (mut policy, now) = running();
            policy.beat(now, Beat::Step);
            assert_eq!(watch(&mut policy, now, 4_800, None, Activity::Busy), None);
            let from = now + ms(4_900);
            let worked = watch(&mut policy, from, quick_for, quick, Activity::Busy);
            assert_eq!(worked, None);
            let from = from + ms(quick_for);
            let silent = watch(&mut policy, from, 60_000, None, Activity::Busy);
            killed(patience, silent);
        }
    }

    #[test]
    fn a_child_that_is_still_for_a_moment_now_and_then_computes() {
        let (mut policy, now) = running();
        policy.beat(now, Beat::Step);
        for t in 0..49 {
            let doing = [Activity::Still, Activity::Busy][usize::from(t % 3 == 0)];
            assert_eq!(policy.look(now + ms(t * 100), || doing), Verdict::Wait);
        }
    }

    #[test]
    fn pauses_double_for_one_that_dies_at_once_and_there_is_none_for_one_that_has_lived() {
        let mut now = Instant::now();
        let mut policy = Policy::new(now);
        let mut pauses = Vec::new();
        for _ in 0..11 {
            policy.started(now);
            policy.restart(now);
            let (verdict, pause) = watch(&mut policy, now, 20_000, None, Activity::Busy).unwrap();
            assert_eq!(verdict, Verdict::Start);
            pauses.push(pause);
            now += ms(pause);
        }
        assert_eq!(
            pauses,
            [0, 0, 100, 200, 400, 800, 1600, 3200, 6400, 10_000, 10_000]
        );
        for lived in [10_000, 500, 500, 500, 500, 500] {
            policy.started(now);
            now += ms(lived);
            policy.restart(now);
            let again = watch(&mut policy, now, 20_000, None, Activity::Busy);
            assert_eq!(again, Some((Verdict::Start, 0)));
        }
    }

    #[test]
    fn who_works_for_a_moment_and_dies_again_and_again_is_back_at_once() {
        let mut now = Instant::now();
        let mut policy = Policy::new(now);
        for _ in 0..100 {
            for (lived, works) in [(250, true), (50, false)] {
                policy.started(now);
                now += ms(lived);
                if works {
                    policy.beat(now, Beat::Step);
                }
                policy.restart(now);
                let (verdict, pause) =
                    watch(&mut policy, now, 20_000, None, Activity::Busy).unwrap();
                assert_eq!(verdict, Verdict::Start);
                assert!(pause <= 200, "{pause} ms");
                now += ms(pause);
            }
        }
    }

    #[test]
    fn after_a_stop_of_its_own_the_supervisor_waits_anew() {
        let (mut policy, now) = running();
        policy.beat(now, Beat::Step);
        let woken = now + ms(60_000);
        assert_eq!(policy.look(woken, || Activity::Stopped), Verdict::Wait);
        assert_eq!(
            watch(&mut policy, woken, 900, None, Activity::Stopped),
            None
        );
    }

    #[test]
    fn a_stop_of_the_supervisor_is_no_long_step_of_its_child() {
        let (mut policy, now) = running();
        let beats = Some((100, Beat::Step));
        assert_eq!(watch(&mut policy, now, 1_000, beats, Activity::Busy), None);
        // As in its own loop: what has come meanwhile is read first.
        let woken = now + ms(61_000);
        assert_eq!(watch(&mut policy, woken, 100, beats, Activity::Busy), None);
        let silent = watch(&mut policy, woken + ms(100), 120_000, None, Activity::Busy);
        killed(5_000..=5_300, silent);
    }

    #[test]
    fn who_ended_for_good_stays_away() {
        let (mut policy, now) = running();
        policy.ended();
        assert_eq!(
            watch(&mut policy, now, 20_000, None, Activity::Stopped),
            None
        );
    }
}
