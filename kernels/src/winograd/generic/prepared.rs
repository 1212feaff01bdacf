//! A Winograd convolution's weights, and what else its runs share.

use super::super::{IN, POINTS};
use super::{Job, Kind, Plan};
use crate::packed::{Blocking, Packed};
use crate::{ConvDims, ConvShape, Layout, Part, Scratch};

/// Packed weights at 36 points, and what a job needs beside its tensors.
#[derive(Debug, Clone)]
pub(crate) struct Prepared<K: Kind> {
    packed: Packed,
    plan: Plan,
    zeros: Vec<K::Input>,
    padding: usize,
}

impl<K: Kind> Prepared<K> {
    /// Packs the weights of a kernel that wants them cut as `blocking` and scratch divided as `plan` says; `None` where
    /// it cannot run the shape. `weight(i)` gives the little-endian bytes of number i of `[out_channels, in_channels /
    /// groups, 36]`.
    pub fn new<const BYTES: usize>(
        shape: &ConvShape,
        blocking: Blocking,
        plan: fn(usize, usize) -> Plan,
        weight: impl Fn(usize) -> [u8; BYTES],
    ) -> Option<Self> {
        let depth = shape.group_in();
        // The 36 points take the place of kernel elements.
        let points = ConvShape::new(ConvDims {
            kernel: IN,
            ..shape.dims()
        })
        .ok()?;
        let packed = Packed::new(&points, blocking, |oc, ic, tap| {
            weight((oc * depth + ic) * POINTS + tap.ky * IN + tap.kx)
        })?;
        Some(Self {
            packed,
            plan: plan(depth, shape.group_out()),
            zeros: vec![K::Input::default(); depth],
            padding: shape.padding(),
        })
    }

    /// The weights.
    pub fn packed(&self) -> &Packed {
        &self.packed
    }

    /// Bytes of scratch that a job needs.
    pub fn scratch_bytes(&self) -> usize {
        self.plan.bytes()
    }

    /// A job over concrete tensors.
    ///
    /// # Panics
    /// When the scratch is too small.
    pub fn job<'a>(
        &'a self,
        sums: K::Sums<'a>,
        input: (*const K::Input, &'a Layout),
        out_layout: &'a Layout,
        part: &'a Part,
        scratch: &'a mut Scratch,
    ) -> Job<'a, K> {
        assert!(scratch.len() >= self.scratch_bytes(), "scratch");
        Job {
            packed: &self.packed,
            sums,
            channels: self.zeros.len(),
            input: input.0,
            in_layout: input.1,
            padding: self.padding,
            zeros: self.zeros.as_ptr(),
            out_layout,
            part,
            plan: self.plan,
            scratch: scratch.as_mut_bytes().as_mut_ptr(),
        }
    }
}
