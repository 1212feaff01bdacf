//! The stages for the pictures' shape: inputs of several sizes that share weights and threads.

use super::engine_args::EngineArgs;
use super::inputs::fitted;
use crate::commands::pipeline::Pipeline;

/// Shapes of pictures whose stages are kept: each has its buffers.
const SHAPES: usize = 4;

/// The stages by the sizes of their inputs.
pub struct Shapes {
    /// Has the weights and threads that the others share.
    first: Pipeline,
    /// Those used last at the end.
    built: Vec<Shape>,
}

struct Shape {
    sizes: Vec<(usize, usize)>,
    stages: Vec<Pipeline>,
}

impl Shapes {
    /// Loads the model.
    ///
    /// # Errors
    /// As [`Pipeline::new`].
    pub fn new(engine: &EngineArgs) -> anyhow::Result<Self> {
        Ok(Self {
            first: engine.build_near(fitted((16, 10), 0.5))?,
            built: Vec::new(),
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
        let shape = match self.built.iter().position(|s| s.sizes == sizes) {
            Some(k) => self.built.remove(k),
            None => {
                if self.built.len() == SHAPES {
                    self.built.remove(0);
                }
                tracing::debug!(inputs = ?sizes, "stages of another shape");
                let stages = sizes.iter().map(|&(w, h)| self.first.resized(w, h));
                Shape {
                    stages: stages.collect::<Result<_, _>>()?,
                    sizes,
                }
            }
        };
        self.built.push(shape);
        let last = self.built.last_mut().expect("one was pushed");
        Ok(&mut last.stages)
    }

    /// The sizes of the stages used last.
    #[cfg(test)]
    pub fn last(&self) -> Option<&[(usize, usize)]> {
        self.built.last().map(|s| &s.sizes[..])
    }
}
