//! Smoothed means.

/// Share of a new value.
const SMOOTH: f32 = 0.1;

/// Follows what changes slowly; the mean of all until there are ten.
#[derive(Debug, Clone, Copy, Default)]
pub struct Mean {
    /// How many values there were.
    pub count: u32,
    /// Their mean; 0 before the first.
    pub value: f32,
}

impl Mean {
    /// Takes in one more.
    pub fn take(&mut self, value: f32) {
        self.count = self.count.saturating_add(1);
        self.value += (value - self.value) * SMOOTH.max(1.0 / self.count as f32);
    }
}

/// `value` as it counts for what takes `mean` so far: no more than `usual`, or than twice the mean. One stall, however
/// long, says little of what comes after it; where all becomes slow the mean follows all the same.
pub fn bounded(value: f32, mean: f32, usual: f32) -> f32 {
    value.min(usual.max(2.0 * mean))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_stall_counts_for_little_and_what_lasts_for_all_of_it() {
        let mut mean = Mean::default();
        let mut take = |value, n| {
            for _ in 0..n {
                mean.take(bounded(value, mean.value, 0.25));
            }
            mean.value
        };
        assert!((take(0.04, 50) - 0.04).abs() < 1e-4);
        assert!(take(9.0, 1) < 0.07);
        assert!((take(0.04, 50) - 0.04).abs() < 1e-3);
        assert!((take(9.0, 200) - 9.0).abs() < 1e-2);
    }
}
