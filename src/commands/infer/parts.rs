//! The stages for parts of inputs: they share weights and threads with those for the whole.

use crate::commands::pipeline::Pipeline;

/// Sizes that are kept: each has its buffers.
const SIZES: usize = 6;

/// The stages by the size of the part.
#[derive(Default)]
pub struct Parts {
    /// Those used last at the end.
    built: Vec<Built>,
}

struct Built {
    /// Of the whole input and of the part, pixels across and down.
    sizes: [(usize, usize); 2],
    stages: Pipeline,
}

impl Parts {
    /// The stages for parts of this size (pixels across and down) of the input of `whole`: those there are, or new ones
    /// in place of those not used for longest.
    ///
    /// # Errors
    /// As [`Pipeline::resized`].
    pub fn of(&mut self, whole: &Pipeline, size: (usize, usize)) -> anyhow::Result<&mut Pipeline> {
        let sizes = [whole.size(), size];
        let built = match self.built.iter().position(|b| b.sizes == sizes) {
            Some(k) => self.built.remove(k),
            None => {
                if self.built.len() == SIZES {
                    self.built.remove(0);
                }
                let stages = whole.for_parts(size.0, size.1)?;
                Built { sizes, stages }
            }
        };
        self.built.push(built);
        let last = self.built.last_mut().expect("one was pushed");
        Ok(&mut last.stages)
    }

    /// Sizes there are stages for.
    #[cfg(test)]
    pub fn count(&self) -> usize {
        self.built.len()
    }
}
