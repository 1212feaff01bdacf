//! How many pictures a second a source has, for who asks before the source knows.

use std::sync::{Arc, OnceLock};

/// A rate that may become known later, at the latest with the first picture.
#[derive(Debug, Clone, Default)]
pub struct Rate {
    known: Arc<OnceLock<f64>>,
    most: Option<f64>,
}

impl Rate {
    /// Pictures a second, where that is known by now, or the highest number that is looked at, where only that is
    /// known.
    pub fn get(&self) -> Option<f64> {
        let known = self.known.get().copied();
        known.into_iter().chain(self.most).reduce(f64::min)
    }

    /// Of an input of which no more pictures a second than these are looked at.
    pub fn at_most(self, most: Option<f64>) -> Self {
        Self { most, ..self }
    }

    /// Makes it known; what was known before stays.
    pub fn tell(&self, rate: Option<f64>) {
        if let Some(rate) = rate {
            self.known.get_or_init(|| rate);
        }
    }
}

impl From<Option<f64>> for Rate {
    fn from(rate: Option<f64>) -> Self {
        let known = Self::default();
        known.tell(rate);
        known
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_an_input_whose_rate_nobody_tells_the_most_that_are_looked_at_are_one() {
        let of = |known: Option<f64>, most: Option<f64>| Rate::from(known).at_most(most).get();
        assert_eq!(of(None, Some(15.0)), Some(15.0));
        assert_eq!(of(Some(30.0), Some(15.0)), Some(15.0));
        assert_eq!(of(Some(10.0), Some(15.0)), Some(10.0));
        assert_eq!((of(Some(30.0), None), of(None, None)), (Some(30.0), None));
    }
}
