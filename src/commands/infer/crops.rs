//! The stages for parts of inputs: they share weights and threads with those for the whole.

use crate::commands::pipeline::Pipeline;
use crate::lru::Lru;

/// Sizes that are kept: each has its buffers.
const SIZES: usize = 3;

/// The stages by the sizes of the whole input and of the crop, pixels across and down.
pub struct Crops(Lru<[(usize, usize); 2], Pipeline>);

impl Default for Crops {
    fn default() -> Self {
        Self(Lru::new(SIZES))
    }
}

impl Crops {
    /// The stages for crops of this size (pixels across and down) of the input of `whole`: those there are, or new ones
    /// in place of those not used for longest.
    ///
    /// # Errors
    /// As [`Pipeline::for_crops`].
    pub fn of(&mut self, whole: &Pipeline, size: (usize, usize)) -> anyhow::Result<&mut Pipeline> {
        let make = |_: &_| whole.for_crops(size.0, size.1);
        self.0.of([whole.size(), size], make)
    }

    /// Sizes there are stages for.
    #[cfg(test)]
    pub fn count(&self) -> usize {
        self.0.count()
    }
}
