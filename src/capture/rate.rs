//! How many pictures a second a source has, for who asks before the source knows.

use std::sync::{Arc, OnceLock};

/// A rate that may become known later, at the latest with the first picture.
#[derive(Debug, Clone, Default)]
pub struct Rate {
    known: Arc<OnceLock<f64>>,
    most: Option<f64>,
}

impl Rate {
    /// Pictures a second, where that is known by now.
    pub fn get(&self) -> Option<f64> {
        let known = self.known.get().copied()?;
        Some(self.most.map_or(known, |most| known.min(most)))
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
