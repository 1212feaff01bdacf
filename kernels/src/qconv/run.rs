//! What one run of an int8 convolution reads and writes.

use super::epilogue::Output;
use crate::{Layout, Part};

/// The tensors of one run.
pub(super) struct Run<'a> {
    pub input: *const u8,
    pub in_layout: &'a Layout,
    pub residual: Option<(*const u8, &'a Layout)>,
    pub output: Output,
    pub out_layout: &'a Layout,
    pub part: &'a Part,
}
