//! Whether this machine keeps up, by what pictures take it: the largest input that does, and a word when it becomes
//! slower than it was. Times go in, verdicts come out.

use super::mean::{Mean, bounded};
use super::wish::{FAST_NS, SLOW_NS, Wish};
use super::zoom::SHARES;

/// Part of the time that a larger input may need by what the present one takes.
const ROOM: f32 = 0.8;
/// What a picture counts as at most where none has taken long before, as share of what it may take.
const STALL: f32 = 2.0;
/// Where no picture came for so long, or for two that are on time, what held before it is forgotten.
const PAUSE: f32 = 1.0;
/// So many pictures tell how fast this machine is when it is cold and has nothing else to do.
const FIRST: u32 = 100;
/// So many times as slow as at first is worth a word.
const SLOWER: f32 = 1.5;
/// If it stays so for this long.
const SLOWER_NS: u64 = 30_000_000_000;

/// What a picture takes at every size.
#[derive(Debug, Clone)]
pub struct Speed {
    /// What a picture may take, seconds; `None` where nobody waits for it.
    target: Option<f32>,
    levels: [Level; SHARES.len()],
    /// The largest input that keeps up.
    limit: usize,
    /// Another limit that would be right.
    wish: Wish<usize>,
    /// When the last picture was ready, nanoseconds.
    last: Option<u64>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Level {
    /// Seconds a picture, looked at whole or in part.
    all: Mean,
    /// Seconds a picture that was looked at whole: those of parts change with what is in view.
    whole: Mean,
    /// The same after the first hundred of them, or since if it became less.
    at_first: f32,
    slower_since: Option<u64>,
    /// When the last picture of this size was ready.
    last: Option<u64>,
    told: bool,
}

/// A machine that has become slower.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slower {
    /// Seconds a picture at first.
    pub at_first: f32,
    /// Seconds a picture now.
    pub now: f32,
}

impl Speed {
    /// For pictures that may take `target` seconds each.
    pub fn new(target: Option<f32>) -> Self {
        Self {
            target,
            levels: Default::default(),
            limit: 0,
            wish: Wish::default(),
            last: None,
        }
    }

    /// The largest input that keeps up, counted as [`SHARES`].
    pub fn limit(&self) -> usize {
        self.limit
    }

    /// Whether it has said of any input that the machine has become slower.
    #[cfg(test)]
    pub fn has_told(&self) -> bool {
        self.levels.iter().any(|level| level.told)
    }

    /// A picture of the input `level` took so many seconds, looked at `whole` or in part, and was ready at `now`
    /// nanoseconds. Says when the machine has become slower, once until it has recovered.
    pub fn took(&mut self, now: u64, level: usize, seconds: f32, whole: bool) -> Option<Slower> {
        let target = self.target?;
        let longest = PAUSE.max(2.0 * target);
        // What it took is none of the pause.
        let came_late = |last: Option<u64>| {
            last.is_some_and(|l| now.saturating_sub(l) as f32 * 1e-9 - seconds > longest)
        };
        let entry = &mut self.levels[level];
        if came_late(self.last.replace(now)) {
            self.wish.forget();
        }
        if came_late(entry.last.replace(now)) {
            entry.slower_since = None;
        }
        let usual = STALL * target;
        entry.all.take(bounded(seconds, entry.all.value, usual));
        let takes = entry.all.value;
        let told = match whole {
            true => entry.became_slower(now, seconds),
            false => None,
        };
        self.choose(now, level, takes, target);
        told
    }

    /// Takes another limit where the present one has been wrong for long enough.
    fn choose(&mut self, now: u64, level: usize, takes: f32, target: f32) {
        let pixels = |l: usize| SHARES[l].powi(2);
        let wanted = if takes > target && level >= self.limit {
            (level + 1).min(SHARES.len() - 1)
        } else if self.limit > 0 && takes * pixels(self.limit - 1) / pixels(level) < ROOM * target {
            self.limit - 1
        } else {
            self.limit
        };
        if wanted == self.limit {
            self.wish.forget();
            return;
        }
        let patience = if wanted > self.limit {
            SLOW_NS
        } else {
            FAST_NS
        };
        if self.wish.lasts(now, wanted, patience) {
            self.limit = wanted;
        }
    }
}

impl Level {
    fn became_slower(&mut self, now: u64, seconds: f32) -> Option<Slower> {
        // One stall is no slower machine, however much time there is for a picture.
        let usual = if self.whole.count < FIRST {
            seconds
        } else {
            0.0
        };
        self.whole.take(bounded(seconds, self.whole.value, usual));
        let takes = self.whole.value;
        if self.whole.count <= FIRST {
            self.at_first = takes;
            return None;
        }
        self.at_first = self.at_first.min(takes);
        if takes < SLOWER * self.at_first {
            self.slower_since = None;
            self.told = false;
            return None;
        }
        let since = *self.slower_since.get_or_insert(now);
        if self.told || now.saturating_sub(since) < SLOWER_NS {
            return None;
        }
        self.told = true;
        Some(Slower {
            at_first: self.at_first,
            now: takes,
        })
    }
}

impl Slower {
    /// A line for the log, with how often the processor was `throttled` for heat, as far as it says.
    pub fn line(&self, throttled: Option<u64>) -> String {
        let heat = match throttled {
            Some(0) => {
                "the processor has not been throttled for heat: something else uses it".into()
            }
            Some(n) => format!(
                "the processor was throttled for heat {n} times since it was started: cool it"
            ),
            None => {
                "the processor does not say whether it is hot, or something else uses it".to_owned()
            }
        };
        format!(
            "a picture takes {:.0} ms, {:.1} times what it took at first ({:.0} ms); {heat}",
            1e3 * self.now,
            self.now / self.at_first,
            1e3 * self.at_first
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: u64 = 66_666_667;
    const TARGET: f32 = 1.0 / 15.0;

    /// Plays pictures on a machine that takes `seconds` for one of the largest input; returns the limit.
    fn play(speed: &mut Speed, clock: &mut u64, seconds: f32, for_ns: u64) -> Vec<Slower> {
        let end = *clock + for_ns;
        let mut told = Vec::new();
        while *clock < end {
            let level = speed.limit();
            let share = SHARES[level].powi(2);
            let takes = seconds * share;
            *clock += FRAME.max((takes * 1e9) as u64);
            told.extend(speed.took(*clock, level, takes, true));
        }
        told
    }

    #[test]
    fn the_largest_input_that_keeps_up_is_taken() {
        // 384x240 takes 56 % of the time, 256x160 a quarter.
        for (seconds, limit) in [(0.02, 0), (0.06, 0), (0.1, 1), (0.2, 2), (2.0, 2)] {
            let (mut speed, mut clock) = (Speed::new(Some(TARGET)), 0);
            play(&mut speed, &mut clock, seconds, 60_000_000_000);
            assert_eq!(speed.limit(), limit, "{seconds}");
        }
    }

    #[test]
    fn a_machine_that_has_time_again_gets_the_larger_input_back_and_does_not_swing() {
        let (mut speed, mut clock) = (Speed::new(Some(TARGET)), 0);
        play(&mut speed, &mut clock, 0.1, 20_000_000_000);
        assert_eq!(speed.limit(), 1);
        // 512x320 would be ready in time, but barely.
        play(&mut speed, &mut clock, 0.06, 60_000_000_000);
        assert_eq!(speed.limit(), 1);
        play(&mut speed, &mut clock, 0.03, 60_000_000_000);
        assert_eq!(speed.limit(), 0);
    }

    #[test]
    fn a_hiccup_changes_nothing() {
        let (mut speed, mut clock) = (Speed::new(Some(TARGET)), 0);
        play(&mut speed, &mut clock, 0.03, 20_000_000_000);
        play(&mut speed, &mut clock, 0.3, 1_000_000_000);
        play(&mut speed, &mut clock, 0.03, 1_000_000_000);
        assert_eq!(speed.limit(), 0);
    }

    #[test]
    fn one_long_stall_changes_nothing_where_looks_are_few() {
        let (mut speed, mut clock) = (Speed::new(Some(TARGET)), 0);
        let mut look = |times: u32, seconds: f32| {
            for _ in 0..times {
                clock += 200_000_000 + (seconds * 1e9) as u64;
                speed.took(clock, speed.limit(), seconds, true);
            }
            speed.limit()
        };
        look(100, 0.03);
        look(1, 9.0);
        assert_eq!(look(50, 0.03), 0);
        assert_ne!(look(50, 0.1), 0);
    }

    #[test]
    fn one_long_stall_is_no_slower_machine() {
        for target in [TARGET, 1.0] {
            let (mut speed, mut clock) = (Speed::new(Some(target)), 0);
            let mut told = |looks: u32, seconds: f32| {
                let looks = (0..looks).filter_map(|_| {
                    clock += 950_000_000 + (seconds * 1e9) as u64;
                    speed.took(clock, 0, seconds, true)
                });
                looks.count()
            };
            assert_eq!(told(FIRST + 50, 0.01), 0);
            assert_eq!(told(1, 9.0) + told(100, 0.01), 0, "{target}");
            assert_eq!(told(100, 0.02), 1, "{target}");
        }
    }

    #[test]
    fn a_file_has_time() {
        let (mut speed, mut clock) = (Speed::new(None), 0);
        let minute = 60_000_000_000;
        play(&mut speed, &mut clock, 0.03, minute);
        let told = play(&mut speed, &mut clock, 0.3, minute);
        assert_eq!((speed.limit(), told), (0, vec![]));
    }

    #[test]
    fn pictures_before_a_pause_say_nothing_of_those_after_it() {
        let hour = 3600 * 1_000_000_000;
        let (mut speed, mut clock) = (Speed::new(Some(TARGET)), 0);
        play(&mut speed, &mut clock, 0.02, 20_000_000_000);
        play(&mut speed, &mut clock, 0.1, SLOW_NS / 2);
        let told = play(&mut speed, &mut clock, 0.1, SLOW_NS / 4);
        assert_eq!((speed.limit(), told), (0, vec![]));
        assert_ne!(speed.wish, Wish::default());
        assert!(speed.levels[0].slower_since.is_some());
        clock += hour;
        assert_eq!(play(&mut speed, &mut clock, 0.1, FRAME), []);
        assert_eq!(speed.limit(), 0);
        play(&mut speed, &mut clock, 0.1, SLOW_NS + FRAME);
        assert_eq!(speed.limit(), 1);
    }

    #[test]
    fn a_machine_that_becomes_slower_is_told_once_until_it_recovers() {
        let (mut speed, mut clock) = (Speed::new(Some(1.0)), 0);
        let minute = 60_000_000_000;
        assert_eq!(play(&mut speed, &mut clock, 0.02, minute), []);
        let told = play(&mut speed, &mut clock, 0.04, 5 * minute);
        assert_eq!(told.len(), 1);
        assert!(
            (told[0].now / told[0].at_first - 2.0).abs() < 0.1,
            "{told:?}"
        );
        let line = told[0].line(Some(3));
        assert!(
            line.contains("40 ms, 2.0 times what it took at first (20 ms)"),
            "{line}"
        );
        assert!(line.contains("throttled for heat 3 times"), "{line}");
        assert_eq!(play(&mut speed, &mut clock, 0.02, minute), []);
        assert_eq!(play(&mut speed, &mut clock, 0.04, minute).len(), 1);
    }

    #[test]
    fn parts_of_pictures_count_for_the_time_there_is_and_not_for_the_machine() {
        let (mut speed, mut clock) = (Speed::new(Some(TARGET)), 0);
        // One picture of ten is looked at whole, or later all of them: whoever is there has spread out.
        let mut play = |seconds: u64, part: f32| {
            let mut told = Vec::new();
            for k in 0..seconds * 15 {
                clock += FRAME;
                let (takes, whole) = if k % 10 == 0 {
                    (0.08, true)
                } else {
                    (part, false)
                };
                told.extend(speed.took(clock, 0, takes, whole));
            }
            (speed.limit(), told)
        };
        assert_eq!(play(120, 0.03), (0, vec![]));
        assert_eq!(play(60, 0.06), (0, vec![]));
        assert_eq!(play(10, 0.07), (1, vec![]));
    }
}
