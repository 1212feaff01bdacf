//! How many pictures a second a source has, for who asks before the source knows.

use std::sync::{Arc, OnceLock};

/// A rate that may become known later, at the latest with the first picture.
#[derive(Debug, Clone, Default)]
pub struct Rate(Arc<OnceLock<f64>>);

impl Rate {
    /// Pictures a second, where that is known by now.
    pub fn get(&self) -> Option<f64> {
        self.0.get().copied()
    }

    /// Makes it known; what was known before stays.
    pub fn tell(&self, rate: Option<f64>) {
        if let Some(rate) = rate {
            self.0.get_or_init(|| rate);
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
