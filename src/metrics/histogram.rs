//! Durations, counted by size.

/// Upper bounds, seconds: from a fast stage of a small picture to a machine that is far too slow.
pub const BOUNDS: [f64; 15] = [
    0.0001, 0.00025, 0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0,
];

/// How many durations were at most as long as each bound.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Histogram {
    /// Not cumulative; the last is above every bound.
    counts: [u64; BOUNDS.len() + 1],
    sum: f64,
}

impl Histogram {
    /// Takes in a duration, seconds.
    pub fn observe(&mut self, seconds: f64) {
        self.counts[BOUNDS.partition_point(|bound| *bound < seconds)] += 1;
        self.sum += seconds;
    }

    /// Upper bounds with how many were at most that long.
    pub fn cumulative(&self) -> impl Iterator<Item = (f64, u64)> + '_ {
        let bounds = BOUNDS.into_iter().chain([f64::INFINITY]);
        bounds.zip(self.counts.iter().scan(0, |sum, count| {
            *sum += count;
            Some(*sum)
        }))
    }

    /// How many there were.
    pub fn count(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// All of them together, seconds.
    pub fn sum(&self) -> f64 {
        self.sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_count_what_is_at_most_as_long() {
        let mut histogram = Histogram::default();
        for seconds in [0.0, 0.001, 0.0011, 7.0] {
            histogram.observe(seconds);
        }
        let counts: Vec<_> = histogram.cumulative().collect();
        assert_eq!(counts[0], (0.0001, 1));
        assert_eq!(counts[3], (0.001, 2));
        assert_eq!(counts[4], (0.0025, 3));
        assert_eq!(counts[14], (5.0, 3));
        assert_eq!(counts[15], (f64::INFINITY, 4));
        assert_eq!(histogram.count(), 4);
        assert!((histogram.sum() - 7.0021).abs() < 1e-12);
    }
}
