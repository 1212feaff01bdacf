//! How many threads share a picture, by what pictures take with more and with fewer. Times go in, numbers come out, one
//! for every input: a small one has less to share.
//!
//! All cores are the fastest on an idle machine whose cores are alike. Where two of them are one core's hyper-threads,
//! some are slow, or other programs and other cameras use them, half as many may be faster: a picture waits for its
//! slowest thread.

use super::zoom::SHARES;

/// Pictures before the first trial: caches, clocks and the input's size settle.
const FIRST: u32 = 30;
/// Pictures that a trial gives to each number of threads, in turn.
const ROUNDS: usize = 9;
/// Pictures after which a number of threads may be given up.
const ENOUGH: usize = 2;
/// If the fastest of them took so many times what the best number takes: the others would show the same.
const HOPELESS: f32 = 1.5;
/// From the end of one trial to the next.
const EVERY_NS: u64 = 300_000_000_000;
/// Another number of threads must take less than this part of the time.
const GAIN: f32 = 0.93;

/// The choices, and the trials that may change them.
#[derive(Debug)]
pub struct Crew {
    /// Numbers of threads, from all of them down.
    sizes: Vec<usize>,
    /// Counted as [`SHARES`]: times of different inputs cannot be compared.
    levels: [Level; SHARES.len()],
}

/// The choice for an input. A trial goes on with the next picture of that input, whatever came between.
#[derive(Debug, Default)]
struct Level {
    /// Counted as [`Crew::sizes`].
    chosen: usize,
    pictures: u32,
    /// By number of threads; they take turns.
    trial: Option<Vec<Candidate>>,
    /// When the last trial ended, nanoseconds.
    tried: Option<u64>,
}

/// A number of threads in a trial.
#[derive(Debug, Clone, Default)]
struct Candidate {
    /// What each of its pictures took.
    seconds: Vec<f32>,
    is_given_up: bool,
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
            levels: Default::default(),
        }
    }

    /// Threads for the next picture of the input `level`.
    pub fn threads(&self, level: usize) -> usize {
        self.sizes[self.levels[level].next()]
    }

    /// Threads for a picture of the input `level` that no trial counts.
    pub fn usual(&self, level: usize) -> usize {
        self.sizes[self.levels[level].chosen]
    }

    /// Whether the next picture of the input `level` is one of a trial, with other threads than usual.
    pub fn is_trying(&self, level: usize) -> bool {
        self.levels[level].next() != self.levels[level].chosen
    }

    /// A picture of the input `level` took so many seconds with [`threads`](Self::threads), and was ready at `now`
    /// nanoseconds. Says so when another number of threads is faster.
    pub fn took(&mut self, now: u64, level: usize, seconds: f32) -> Option<Change> {
        if self.sizes.len() == 1 {
            return None;
        }
        let level = &mut self.levels[level];
        let Some(trial) = &mut level.trial else {
            level.pictures = level.pictures.saturating_add(1);
            let is_due = level
                .tried
                .is_none_or(|t| now.saturating_sub(t) >= EVERY_NS);
            if is_due && level.pictures >= FIRST {
                level.trial = Some(vec![Candidate::default(); self.sizes.len()]);
            }
            return None;
        };
        if let Some(k) = turn(trial) {
            trial[k].seconds.push(seconds);
        }
        give_up(trial, level.chosen);
        if turn(trial).is_some() {
            return None;
        }
        let taken: Vec<f32> = trial.iter_mut().map(Candidate::takes).collect();
        (level.trial, level.tried) = (None, Some(now));
        let best = (0..taken.len()).min_by(|&a, &b| taken[a].total_cmp(&taken[b]))?;
        if taken[best] >= GAIN * taken[level.chosen] {
            return None;
        }
        let from = std::mem::replace(&mut level.chosen, best);
        Some(Change {
            threads: [self.sizes[from], self.sizes[best]],
            seconds: [taken[from], taken[best]],
        })
    }
}

impl Level {
    /// The number of threads for the next picture, counted as [`Crew::sizes`].
    fn next(&self) -> usize {
        let turn = self.trial.as_deref().and_then(turn);
        turn.unwrap_or(self.chosen)
    }
}

/// Whose turn it is in a trial; nobody's once it has all pictures.
fn turn(trial: &[Candidate]) -> Option<usize> {
    let waits = |k: &usize| !trial[*k].is_given_up && trial[*k].seconds.len() < ROUNDS;
    let waiting = (0..trial.len()).filter(waits);
    waiting.min_by_key(|k| trial[*k].seconds.len())
}

/// Gives up the numbers of threads that cannot become the best one. The chosen one costs nothing and stays.
fn give_up(trial: &mut [Candidate], chosen: usize) {
    let best = trial.iter_mut().map(Candidate::takes);
    let best = best.fold(f32::INFINITY, f32::min);
    for (k, candidate) in trial.iter_mut().enumerate() {
        let fastest = candidate.seconds.iter().copied();
        let fastest = fastest.fold(f32::INFINITY, f32::min);
        let is_hopeless = candidate.seconds.len() >= ENOUGH && fastest >= HOPELESS * best;
        candidate.is_given_up |= is_hopeless && k != chosen;
    }
}

impl Candidate {
    /// Seconds a picture; infinitely many until enough of them are known.
    fn takes(&mut self) -> f32 {
        match self.seconds.len() {
            ENOUGH.. => median(&mut self.seconds),
            _ => f32::INFINITY,
        }
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
            crew.took(*clock, 0, takes(crew.threads(0)))
        });
        each.collect()
    }

    #[test]
    fn the_fastest_number_of_threads_is_taken_and_changes_when_the_machine_does() {
        let (mut crew, mut clock) = (Crew::new(8, false), 0);
        let alike = |n: usize| 0.08 / n as f32;
        assert_eq!(play(&mut crew, &mut clock, 1000, alike), []);
        assert_eq!(crew.threads(0), 8);
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
        let (mut fewer, mut lost) = (0, 0.0);
        play(&mut crew, &mut clock, 30_000, |n| {
            let takes = 0.24 / n as f32;
            fewer += u32::from(n < 4);
            lost += takes - 0.06;
            takes
        });
        // A thousand seconds: 4 trials, which give up each of two smaller numbers after 2 pictures.
        assert_eq!(fewer, 4 * 2 * 2);
        assert!(lost < 4.0 * 0.5, "{lost} s");
    }

    #[test]
    fn a_number_that_may_still_win_gets_all_its_pictures() {
        let (mut crew, mut clock) = (Crew::new(4, false), 0);
        let mut halves = 0;
        let changes = play(&mut crew, &mut clock, 100, |n| {
            halves += u32::from(n == 2);
            // Every other picture on two threads is held up, the first of them too.
            match n {
                4 => 0.06,
                2 if halves % 2 == 1 => 0.1,
                2 => 0.05,
                _ => 0.24,
            }
        });
        assert_eq!((halves, changes), (9, vec![]));
    }

    #[test]
    fn a_fixed_number_stays_and_one_core_has_no_choice() {
        for (threads, is_fixed) in [(4, true), (1, false)] {
            let (mut crew, mut clock) = (Crew::new(threads, is_fixed), 0);
            let changes = play(&mut crew, &mut clock, 2000, |n| n as f32);
            assert_eq!((changes, crew.threads(0)), (vec![], threads));
        }
    }

    #[test]
    fn every_input_finishes_its_trial_and_has_a_number_of_its_own() {
        let (mut crew, mut changes) = (Crew::new(4, false), Vec::new());
        for k in 0..400u64 {
            // The input changes every five pictures.
            let level = if k / 5 % 2 == 0 { 0 } else { 2 };
            let threads = crew.threads(level) as f32;
            let takes = [0.08 / threads, 0.0, 0.004 * threads][level];
            changes.extend(crew.took(k * FRAME, level, takes));
        }
        assert_eq!(changes.len(), 1);
        assert_eq!(changes[0].threads, [4, 1]);
        for (level, threads) in [(0, 4), (2, 1)] {
            assert!(!crew.is_trying(level));
            assert_eq!([crew.threads(level), crew.usual(level)], [threads; 2]);
        }
    }

    #[test]
    fn times_of_two_inputs_are_not_compared() {
        let mut crew = Crew::new(2, false);
        for k in 0..400u64 {
            // The smaller input comes with one thread by chance.
            let level = usize::from(k % 2 == 1);
            let takes = [0.04, 0.01][level];
            assert_eq!(crew.took(k * FRAME, level, takes), None);
        }
        assert_eq!([0, 1].map(|level| crew.threads(level)), [2, 2]);
    }
}
