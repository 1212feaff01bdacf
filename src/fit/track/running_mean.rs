//! In: measurements of what hardly changes, look by look. Out: their mean, which forgets slowly.

/// What a look counts as that comes `dt` seconds after the last, where errors last about `correlated` seconds: 1 is a
/// look of its own. So a second tells the same at any rate of frames.
pub fn look_of_its_own(dt: f64, correlated: f64) -> f64 {
    (dt / correlated).min(1.0)
}

/// A mean in the unit of what is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RunningMean {
    /// The mean; before the first look what is expected.
    pub mean: f64,
    /// Looks of their own behind it.
    pub looks: f64,
}

impl RunningMean {
    /// Before the first look.
    pub fn expecting(mean: f64) -> Self {
        Self { mean, looks: 0.0 }
    }

    /// Takes in a measurement that counts as so many looks of its own. No more looks than `memory` are remembered.
    pub fn add(&mut self, measured: f64, look: f64, memory: f64) {
        self.looks = (self.looks + look).min(memory);
        self.mean += (measured - self.mean) * look / self.looks;
    }

    /// The mean beside what is known beforehand, a value of so much weight (an inverse variance). `variance`: of one
    /// look, in units of that weight's inverse.
    pub fn beside(&self, known: f64, weight: f64, variance: f64) -> f64 {
        let seen = self.looks / variance;
        (weight * known + seen * self.mean) / (weight + seen)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_expected_gives_way_to_what_is_measured() {
        let mut length = RunningMean::expecting(5.0);
        assert_eq!(length.beside(5.0, 2.0, 1.0), 5.0);
        length.add(1.0, 1.0, 10.0);
        assert_eq!((length.mean, length.looks), (1.0, 1.0));
        length.add(2.0, 1.0, 10.0);
        assert_eq!((length.mean, length.looks), (1.5, 2.0));
        assert_eq!(length.beside(5.5, 2.0, 1.0), 3.5);
        // Looks of four times the variance count a quarter.
        assert_eq!(length.beside(5.5, 0.5, 4.0), 3.5);
    }

    #[test]
    fn looks_that_come_fast_count_for_less_and_old_ones_are_forgotten() {
        assert_eq!(
            [0.05, 0.2, 9.0].map(|dt| look_of_its_own(dt, 0.2)),
            [0.25, 1.0, 1.0]
        );
        let mut length = RunningMean::expecting(0.0);
        (0..1000).for_each(|_| length.add(1.0, 0.5, 8.0));
        assert_eq!(length.looks, 8.0);
        length.add(9.0, 0.5, 8.0);
        assert_eq!(length.mean, 1.5);
    }
}
