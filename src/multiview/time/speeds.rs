//! When who moved how fast: joint speeds of two views go in, the lags at which they are alike come out.

use std::ops::Range;

use super::trails::Trail;
use crate::joints::{EVIDENCE_JOINTS, MIRROR};

/// Seconds between samples of the speeds.
pub const STEP: f64 = 0.02;
/// Least common time of two views, seconds, and as a share of the shorter.
const COMMON: [f64; 2] = [1.0, 0.3];

/// Speeds of joints in one view over time, both sides of the body and all people together. Where nobody is followed
/// they are zeros, which are not kept: clocks may jump by years.
pub struct Speeds {
    /// Time of the first sample, seconds.
    start: f64,
    /// Samples from the first to the last, kept or not.
    count: isize,
    /// Where somebody is followed, rising and apart from each other.
    runs: Vec<Run>,
}

/// Samples that follow each other.
struct Run {
    /// Number of the first.
    first: isize,
    /// Sums of speeds; of a joint and of its mirror image under the lower number.
    samples: Vec<[f64; EVIDENCE_JOINTS]>,
}

impl Run {
    fn end(&self) -> isize {
        self.first + self.samples.len() as isize
    }

    /// The numbers of its samples from one to before another.
    fn within(&self, from: isize, to: isize) -> Range<isize> {
        self.first.max(from)..self.end().min(to)
    }

    fn at(&self, number: isize) -> &[f64; EVIDENCE_JOINTS] {
        &self.samples[(number - self.first) as usize]
    }
}

impl Speeds {
    /// Of everybody whom a view follows from `start` to `end`, seconds.
    pub fn new(trails: &[Trail], start: f64, end: f64) -> Self {
        let count = ((end - start) / STEP).max(0.0) as isize + 1;
        let number = |time: f64| (((time - start) / STEP).ceil().max(0.0) as isize).min(count);
        let mut spans: Vec<[isize; 2]> = trails.iter().map(|t| t.span().map(number)).collect();
        spans.sort_unstable();
        let mut runs: Vec<Run> = Vec::new();
        for [from, to] in spans {
            let end = match runs.last() {
                Some(run) if run.end() >= from => run.end(),
                _ => {
                    runs.push(Run {
                        first: from,
                        samples: Vec::new(),
                    });
                    from
                }
            };
            let more = (to - end).max(0) as usize;
            if let Some(run) = runs.last_mut() {
                let own = run.samples.len();
                run.samples.resize(own + more, [0.0; EVIDENCE_JOINTS]);
            }
        }
        for trail in trails {
            let first = number(trail.times[0]);
            let own = runs.partition_point(|run| run.first <= first) - 1;
            let run = &mut runs[own];
            for (k, pair) in trail.times.windows(2).enumerate() {
                for s in number(pair[0])..number(pair[1]) {
                    let share = (start + s as f64 * STEP - pair[0]) / (pair[1] - pair[0]);
                    let sample = &mut run.samples[(s - run.first) as usize];
                    for j in 0..EVIDENCE_JOINTS {
                        if let (Some(a), Some(b)) = (trail.speeds[k][j], trail.speeds[k + 1][j]) {
                            sample[j.min(MIRROR[j])] += a + share * (b - a);
                        }
                    }
                }
            }
        }
        Self { start, count, runs }
    }

    /// Samples that are kept, from one to before another.
    fn kept(
        &self,
        from: isize,
        to: isize,
    ) -> impl Iterator<Item = (isize, &[f64; EVIDENCE_JOINTS])> {
        let first = self.runs.partition_point(|run| run.end() <= from);
        let runs = self.runs[first..].iter();
        let runs = runs.take_while(move |run| run.first < to);
        runs.flat_map(move |run| run.within(from, to).map(move |s| (s, run.at(s))))
    }

    /// Pearson's correlation of all speeds with another view's, that view's clock being ahead by `lag` samples beyond
    /// the starts; `None` where too little is common.
    fn correlation(&self, other: &Self, lag: isize) -> Option<f64> {
        let (n, m) = (self.count, other.count);
        let (from, to) = ((-lag).max(0), (m - lag).min(n));
        let least = (COMMON[0] / STEP).max(COMMON[1] * n.min(m) as f64);
        if ((to - from) as f64) < least {
            return None;
        }
        // Sums of x, y, x², y² and x·y.
        let [mut a, mut b, mut aa, mut bb, mut ab] = [[0.0; EVIDENCE_JOINTS]; 5];
        for (_, x) in self.kept(from, to) {
            for j in 0..EVIDENCE_JOINTS {
                a[j] += x[j];
                aa[j] += x[j] * x[j];
            }
        }
        for (_, y) in other.kept(from + lag, to + lag) {
            for j in 0..EVIDENCE_JOINTS {
                b[j] += y[j];
                bb[j] += y[j] * y[j];
            }
        }
        for run in &self.runs {
            let own = run.within(from, to);
            if own.is_empty() {
                continue;
            }
            for (s, y) in other.kept(own.start + lag, own.end + lag) {
                let x = run.at(s - lag);
                for j in 0..EVIDENCE_JOINTS {
                    ab[j] += x[j] * y[j];
                }
            }
        }
        let count = (to - from) as f64;
        let (mut both, mut own, mut others) = (0.0, 0.0, 0.0);
        for j in 0..EVIDENCE_JOINTS {
            both += ab[j] - a[j] * b[j] / count;
            own += aa[j] - a[j] * a[j] / count;
            others += bb[j] - b[j] * b[j] / count;
        }
        let scale = (own * others).sqrt();
        (scale > 1e-12).then(|| both / scale)
    }

    /// Offsets of the other view's clock, at most `most` seconds, at which speeds are more alike than just before and
    /// after: the likest first.
    pub fn alike(&self, other: &Self, most: f64) -> Vec<f64> {
        let beyond = ((self.start - other.start) / STEP).round() as isize;
        let reach = (most / STEP) as isize;
        let all: Vec<(f64, Option<f64>)> = (-reach..=reach)
            .map(|lag| {
                let offset = lag as f64 * STEP;
                (offset, self.correlation(other, lag + beyond))
            })
            .collect();
        let mut peaks: Vec<(f64, f64)> = (0..all.len())
            .filter_map(|k| {
                let (offset, own) = (all[k].0, all[k].1?);
                let near = [k.checked_sub(1), Some(k + 1)].into_iter().flatten();
                let is_peak = near
                    .filter_map(|n| all.get(n)?.1)
                    .all(|beside| beside <= own);
                is_peak.then_some((own, offset))
            })
            .collect();
        peaks.sort_by(|a, b| b.0.total_cmp(&a.0));
        peaks.into_iter().map(|(_, offset)| offset).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Somebody who moves faster and slower, seen 30 times a second from `begin` on; the clock is `ahead`, seconds.
    fn trail(begin: f64, ahead: f64) -> Trail {
        let speed = |t: f64| 1.0 + (7.0 * t + 0.4 * t * t).sin();
        let seconds: Vec<f64> = (0..120).map(|k| f64::from(k) / 30.0).collect();
        let mut trail = Trail::still([0.0, 1.0]);
        trail.times = seconds.iter().map(|t| begin + t + ahead).collect();
        trail.joints = vec![[None; EVIDENCE_JOINTS]; seconds.len()];
        let speeds = seconds.iter().map(|t| [Some(speed(*t)); EVIDENCE_JOINTS]);
        trail.speeds = speeds.collect();
        trail
    }

    /// A clock that was set while cameras ran.
    #[test]
    fn years_in_which_nobody_is_followed_cost_nothing() {
        const YEARS: f64 = 1e9;
        let [own, other] = [0.0, 0.3].map(|ahead| {
            let trails = [trail(2.0, ahead), trail(YEARS, ahead)];
            Speeds::new(&trails, 0.0, YEARS + 10.0)
        });
        let kept: usize = own.runs.iter().map(|run| run.samples.len()).sum();
        assert!((390..=410).contains(&kept), "{kept}");
        let lag = own.alike(&other, 5.0)[0];
        assert!((lag - 0.3).abs() < 0.5 * STEP, "{lag}");
    }

    #[test]
    fn people_who_overlap_in_time_are_one_run() {
        let trails = [trail(2.0, 0.0), trail(0.0, 0.0), trail(4.0, 0.0)];
        let speeds = Speeds::new(&trails, 0.0, 20.0);
        let [run] = &speeds.runs[..] else {
            panic!("{} runs", speeds.runs.len());
        };
        assert_eq!((run.first, speeds.count), (0, 1001));
        let lone = Speeds::new(&trails[1..2], 0.0, 20.0);
        let at = |speeds: &Speeds, s: isize| speeds.runs[0].at(s)[0];
        assert_eq!(at(&speeds, 50), at(&lone, 50));
        assert!(at(&speeds, 150) > at(&lone, 150));
    }
}
