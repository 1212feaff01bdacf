//! How many threads share a picture, by what pictures take with more and with fewer. Times go in, numbers come out.
//!
//! All cores are the fastest on an idle machine whose cores are alike. Where two of them are one core's hyper-threads,
//! some are slow, or other programs and other cameras use them, half as many may be faster: a picture waits for its
//! slowest thread.

/// Pictures before the first trial: caches, clocks and the input's size settle.
const FIRST: u32 = 30;
/// Pictures that a trial gives to each number of threads, in turn.
const ROUNDS: usize = 9;
/// From the end of one trial to the next.
const EVERY_NS: u64 = 300_000_000_000;
/// Another number of threads must take less than this part of the time.
const GAIN: f32 = 0.93;

/// The choice, and the trial that may change it.
#[derive(Debug)]
pub struct Crew {
    /// Numbers of threads, from all of them down.
    sizes: Vec<usize>,
    chosen: usize,
    pictures: u32,
    trial: Option<Trial>,
    /// When the last trial ended.
    tried: Option<u64>,
}

#[derive(Debug)]
struct Trial {
    level: usize,
    /// Seconds a picture, by number of threads; they take turns.
    seconds: Vec<Vec<f32>>,
}

/// Another number of threads is faster.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// Threads until now, and from now on.
    pub threads: [usize; 2],
    /// Seconds a picture took with each.
    pub seconds: [f32; 2],
}

impl Crew {
    /// Of a machine that has so many cores to give; a number that the user fixed stays.
    pub fn new(threads: usize, is_fixed: bool) -> Self {
        // A picture is cut into as many parts as there are threads at most: what does not divide them gains nothing.
        let mut sizes = vec![threads.max(1)];
        if !is_fixed {
            sizes.extend([threads.div_ceil(2), 1]);
        }
        sizes.dedup();
        Self {
            sizes,
            chosen: 0,
            pictures: 0,
            trial: None,
            tried: None,
        }
    }

    /// Threads for the next picture.
    pub fn threads(&self) -> usize {
        self.sizes[self.next()]
    }

    /// Whether the next picture is one of a trial, with other threads than usual.
    pub fn is_trying(&self) -> bool {
        self.next() != self.chosen
    }

    fn next(&self) -> usize {
        let turn = |trial: &Trial| trial.seconds.iter().map(Vec::len).sum::<usize>();
        self.trial
            .as_ref()
            .map_or(self.chosen, |trial| turn(trial) % self.sizes.len())
    }

    /// A picture of the input `level` took so many seconds with [`threads`](Self::threads), and was ready at `now`
    /// nanoseconds. Says so when another number of threads is faster.
    pub fn took(&mut self, now: u64, level: usize, seconds: f32) -> Option<Change> {
        if self.sizes.len() == 1 {
            return None;
        }
        let Some(trial) = &mut self.trial else {
            self.pictures = self.pictures.saturating_add(1);
            let is_due = self.tried.is_none_or(|t| now.saturating_sub(t) >= EVERY_NS);
            if is_due && self.pictures >= FIRST {
                self.begin(level);
            }
            return None;
        };
        if trial.level != level {
            // Times of different inputs cannot be compared.
            self.begin(level);
            return None;
        }
        let turn = trial.seconds.iter().map(Vec::len).sum::<usize>() % self.sizes.len();
        trial.seconds[turn].push(seconds);
        if trial.seconds.iter().any(|s| s.len() < ROUNDS) {
            return None;
        }
        let taken: Vec<f32> = trial.seconds.iter_mut().map(|s| median(s)).collect();
        (self.trial, self.tried) = (None, Some(now));
        let best = (0..taken.len()).min_by(|&a, &b| taken[a].total_cmp(&taken[b]))?;
        if taken[best] >= GAIN * taken[self.chosen] {
            return None;
        }
        let from = std::mem::replace(&mut self.chosen, best);
        Some(Change {
            threads: [self.sizes[from], self.sizes[best]],
            seconds: [taken[from], taken[best]],
        })
    }

    fn begin(&mut self, level: usize) {
        self.trial = Some(Trial {
            level,
            seconds: vec![Vec::new(); self.sizes.len()],
        });
    }
}

impl Change {
    /// A line for the log.
    pub fn line(&self) -> String {
        let [from, to] = self.threads;
        let [before, after] = self.seconds.map(|s| 1e3 * s);
        format!(
            "{after:.1} ms a picture with threads: {to}, {before:.1} ms with {from}; {to} from now on (--threads fixes the number)"
        )
    }
}

fn median(values: &mut [f32]) -> f32 {
    values.sort_unstable_by(f32::total_cmp);
    values[values.len() / 2]
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: u64 = 33_333_333;

    /// Plays pictures that take what `takes` says of the number of threads; the changes.
    fn play(
        crew: &mut Crew,
        clock: &mut u64,
        pictures: u32,
        mut takes: impl FnMut(usize) -> f32,
    ) -> Vec<Change> {
        let each = (0..pictures).filter_map(|_| {
            *clock += FRAME;
            crew.took(*clock, 0, takes(crew.threads()))
        });
        each.collect()
    }

    #[test]
    fn the_fastest_number_of_threads_is_taken_and_changes_when_the_machine_does() {
        let (mut crew, mut clock) = (Crew::new(8, false), 0);
        let alike = |n: usize| 0.08 / n as f32;
        assert_eq!(play(&mut crew, &mut clock, 1000, alike), []);
        assert_eq!(crew.threads(), 8);
        // Five minutes later other programs hold half of the cores.
        let shared = |n: usize| 0.08 / n as f32 * if n > 4 { 3.0 } else { 1.0 };
        let changes = play(&mut crew, &mut clock, 10_000, shared);
        assert_eq!(changes.len(), 1);
        assert_eq!(changes[0].threads, [8, 4]);
        assert!(
            changes[0]
                .line()
                .contains("20.0 ms a picture with threads: 4")
        );
        // They go.
        let changes = play(&mut crew, &mut clock, 10_000, alike);
        assert_eq!(changes[0].threads, [4, 8]);
    }

    #[test]
    fn a_hiccup_changes_nothing() {
        let (mut crew, mut clock) = (Crew::new(4, false), 0);
        let mut picture = 0;
        let changes = play(&mut crew, &mut clock, 30_000, |n| {
            picture += 1;
            // Every third picture of all threads is held up.
            0.08 / n as f32
                * if n == 4 && picture % 9 == 0 {
                    10.0
                } else {
                    1.0
                }
        });
        assert_eq!(changes, []);
    }

    #[test]
    fn trials_are_rare_and_short() {
        let (mut crew, mut clock) = (Crew::new(4, false), 0);
        let mut fewer = 0;
        play(&mut crew, &mut clock, 30_000, |n| {
            fewer += u32::from(n < 4);
            0.08 / n as f32
        });
        // A thousand seconds: 4 trials of 9 pictures with each of two smaller numbers.
        assert_eq!(fewer, 4 * 9 * 2);
    }

    #[test]
    fn a_fixed_number_stays_and_one_core_has_no_choice() {
        for (threads, is_fixed) in [(4, true), (1, false)] {
            let (mut crew, mut clock) = (Crew::new(threads, is_fixed), 0);
            let changes = play(&mut crew, &mut clock, 2000, |n| n as f32);
            assert_eq!((changes, crew.threads()), (vec![], threads));
        }
    }

    #[test]
    fn a_trial_of_two_inputs_is_begun_again() {
        let mut crew = Crew::new(2, false);
        for k in 0..400u64 {
            // The smaller input comes with one thread by chance.
            let level = usize::from(k % 2 == 1);
            let takes = [0.04, 0.01][level];
            assert_eq!(crew.took(k * FRAME, level, takes), None);
        }
        assert_eq!(crew.threads(), 2);
    }
}
