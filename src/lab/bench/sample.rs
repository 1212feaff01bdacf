//! Something to run goes in, the distribution of its times comes out.

use std::time::{Duration, Instant};

use super::Timing;

/// Times of single runs and how busy the processor was meanwhile.
#[derive(Debug, Clone, Default)]
pub(super) struct Samples {
    ms: Vec<f64>,
    wall: Duration,
    processor: Duration,
}

impl Samples {
    /// Runs `f` again and again for `time`, at least `least` times, and adds every run's time.
    pub fn add(&mut self, time: Duration, least: usize, mut f: impl FnMut()) {
        let (start, before) = (Instant::now(), processor_time());
        let mut runs = 0;
        while runs < least || start.elapsed() < time {
            let t = Instant::now();
            f();
            self.ms.push(t.elapsed().as_secs_f64() * 1e3);
            runs += 1;
        }
        self.wall += start.elapsed();
        self.processor += processor_time().saturating_sub(before);
    }

    /// Mean processor time of a run, all threads together, milliseconds.
    pub fn processor_ms(&self) -> f64 {
        self.processor.as_secs_f64() * 1e3 / self.ms.len().max(1) as f64
    }

    /// Median and 99th percentile.
    pub fn timing(&self) -> Timing {
        let mut sorted = self.ms.clone();
        sorted.sort_by(f64::total_cmp);
        Timing {
            median_ms: quantile(&sorted, 0.5),
            p99_ms: quantile(&sorted, 0.99),
            runs: sorted.len(),
        }
    }

    /// Processor time over wall time of `threads` threads.
    pub fn busy(&self, threads: usize) -> f64 {
        self.processor.as_secs_f64() / (self.wall.as_secs_f64() * threads as f64).max(1e-12)
    }
}

/// The smallest sample that at least this share of all samples do not exceed; 0 without samples.
pub(super) fn quantile(sorted: &[f64], share: f64) -> f64 {
    let at = (share * sorted.len() as f64).ceil() as usize;
    let at = at.clamp(1, sorted.len().max(1)) - 1;
    sorted.get(at).copied().unwrap_or(0.0)
}

/// Processor time of all threads of this process.
fn processor_time() -> Duration {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Duration::new(t.tv_sec as u64, t.tv_nsec as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_samples() {
        let hundred: Vec<f64> = (1..=100).map(f64::from).collect();
        assert_eq!(quantile(&hundred, 0.5), 50.0);
        assert_eq!(quantile(&hundred, 0.99), 99.0);
        assert_eq!(quantile(&[3.0, 7.0, 8.0], 0.5), 7.0);
        assert_eq!(quantile(&[3.0, 7.0, 8.0], 0.99), 8.0);
        assert_eq!(quantile(&[5.0], 0.5), 5.0);
        assert_eq!(quantile(&[], 0.5), 0.0);
    }

    #[test]
    fn runs_at_least_as_often_as_asked() {
        let (mut samples, mut runs) = (Samples::default(), 0);
        samples.add(Duration::ZERO, 3, || runs += 1);
        assert_eq!((runs, samples.timing().runs), (3, 3));
        assert!(samples.timing().median_ms <= samples.timing().p99_ms);
    }
}
