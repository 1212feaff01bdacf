//! How a fit runs: what it sees besides joints, who hears of its progress, where parts of it are kept.

use super::fitted::Fitted;
use super::kept::{self, Kept, Nothing, Placed};
use super::moment::Moment;
use super::silhouette::Masks;
use crate::body::mesh::MeshBody;

/// What a fit tells of its progress. A step is one frame of one person in one stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// So many steps there are.
    Planned(usize),
    /// So many were done before, and kept.
    Restored(usize),
    /// A body was fitted to the joints of one frame.
    Placed,
    /// Frames of one person were tried again from their neighbours, or with other weights of the views; of the steps
    /// that are planned this is none.
    Settled,
    /// A body was fitted to its outlines as well.
    Outlined,
    /// A body is where stage two wants it.
    Smoothed,
}

/// How a fit runs.
#[derive(Clone, Copy)]
pub struct Run<'a> {
    /// Outlines that count as well as joints.
    pub masks: Option<&'a Masks<'a>>,
    /// Hears of every step.
    pub progress: &'a (dyn Fn(Step) + Sync),
    /// Where computed parts are kept, and found again.
    pub kept: &'a dyn Kept,
}

impl<'a> Run<'a> {
    /// By joints and outlines; nothing is kept.
    pub fn new(masks: Option<&'a Masks<'a>>, progress: &'a (dyn Fn(Step) + Sync)) -> Self {
        Self {
            masks,
            progress,
            kept: &Nothing,
        }
    }

    /// Brings frames into the state that was kept of them, if one was.
    pub(super) fn restore(
        &self,
        part: &str,
        body: &MeshBody,
        moments: &mut [&mut Moment],
    ) -> Option<Vec<Placed>> {
        kept::read(&self.kept.get(part)?, body, moments)
    }

    /// Keeps the state of frames.
    pub(super) fn keep<'b>(
        &self,
        part: &str,
        frames: impl ExactSizeIterator<Item = (&'b Moment, Option<(&'b Fitted, f64)>)>,
    ) {
        self.kept.put(part, &kept::write(frames));
    }
}
