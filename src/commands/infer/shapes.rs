//! The stages for the pictures' shape: inputs of several sizes that share weights and threads.

use super::engine_args::EngineArgs;
use crate::commands::pipeline::Pipeline;
use crate::lru::Lru;
use crate::schedule::inputs::fitted;

/// Shapes of pictures whose stages are kept: each has its buffers.
const SHAPES: usize = 4;

/// The stages by the sizes of their inputs.
pub struct Shapes {
    /// Has the weights and threads that the others share.
    first: Pipeline,
    built: Lru<Vec<(usize, usize)>, Vec<Pipeline>>,
}

impl Shapes {
    /// Loads the model.
    ///
    /// # Errors
    /// As [`Pipeline::new`].
    pub fn new(engine: &EngineArgs) -> anyhow::Result<Self> {
        Ok(Self {
            first: engine.build_near(fitted((16, 10), 0.5))?,
            built: Lru::new(SHAPES),
        })
    }

    /// Any of the stages: what does not depend on the input's size.
    pub fn any(&self) -> &Pipeline {
        &self.first
    }

    /// The stages for inputs of these `sizes`, pixels across and down: those there are, or new ones in place of those
    /// not used for longest.
    ///
    /// # Errors
    /// As [`Pipeline::resized`].
    pub fn of(&mut self, sizes: Vec<(usize, usize)>) -> anyhow::Result<&mut [Pipeline]> {
        let first = &self.first;
        let stages = self.built.of(sizes, |sizes| {
            tracing::debug!(inputs = ?sizes, "stages of another shape");
            let stages = sizes.iter().map(|&(w, h)| first.resized(w, h));
            stages.collect::<Result<Vec<_>, _>>()
        })?;
        Ok(stages)
    }

    /// For how many shapes there are stages.
    #[cfg(test)]
    pub fn count(&self) -> usize {
        self.built.count()
    }

    /// The sizes of the stages used last.
    #[cfg(test)]
    pub fn last(&self) -> Option<&[(usize, usize)]> {
        self.built.last().map(|(sizes, _)| &sizes[..])
    }
}
