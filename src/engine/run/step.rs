//! One operation of a planned network, bound to its buffers.

use std::sync::atomic::{AtomicPtr, Ordering};

use edgecap_kernels::{FConv, Layout, MaxPool, Part, QConv, Scratch};

use super::arena::Arena;
use crate::engine::network::ValueId;

/// A packed kernel.
pub(super) enum Kernel {
    /// int8 convolution to u8.
    Int8(QConv),
    /// int8 convolution to an f32 map.
    Int8ToMap(QConv),
    /// f32 convolution.
    Float(FConv),
    /// Max pooling of either type.
    Pool(MaxPool),
}

/// A tensor of the arena: its buffer's first element, and its layout from there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tensor {
    pub base: usize,
    pub layout: Layout,
}

/// Where a step writes.
#[derive(Debug, Clone, Copy)]
pub(super) enum Target {
    /// The arena.
    Arena(Tensor),
    /// An output map.
    Map { index: usize, layout: Layout },
}

/// The buffers of one engine.
pub(super) enum Memory {
    /// Of an int8 network.
    Int8(Arena<u8>),
    /// Of an f32 network.
    Float(Arena<f32>),
}

/// The output maps' first elements: set before every frame by the engine that owns them.
pub(super) type MapPointers = [AtomicPtr<f32>; 2];

/// One operation.
pub(super) struct Step {
    pub name: String,
    pub kernel: Kernel,
    pub input: Tensor,
    pub residual: Option<Tensor>,
    pub target: Target,
    /// The value it writes.
    pub output: ValueId,
    /// Shares of the work that may run at the same time.
    pub parts: Vec<Part>,
    pub macs: u64,
}

impl Step {
    /// Runs one share.
    ///
    /// # Safety
    /// - `memory` is the arena the step was planned for, and `maps` point at maps of its outputs' sizes.
    /// - All shares of earlier steps are done and seen by this thread; nobody runs this share, or a share of another step,
    ///   or touches the maps, at the same time.
    pub unsafe fn run(
        &self,
        part: &Part,
        memory: &Memory,
        maps: &MapPointers,
        scratch: &mut Scratch,
    ) {
        match memory {
            // SAFETY: the caller's promises.
            Memory::Int8(arena) => unsafe { self.run_int8(part, arena, maps, scratch) },
            // SAFETY: the caller's promises.
            Memory::Float(arena) => unsafe { self.run_float(part, arena, maps, scratch) },
        }
    }

    /// # Safety
    /// As [`run`](Self::run).
    unsafe fn run_int8(
        &self,
        part: &Part,
        arena: &Arena<u8>,
        maps: &MapPointers,
        scratch: &mut Scratch,
    ) {
        // SAFETY: `build` checked with the kernel that base + every index of the layout is < arena.len(), and the plan proves
        // that input, residual and output occupy different elements of the arena while they are alive (`Plan::prove`); shares
        // of one step write different rows or groups (`Part`).
        unsafe {
            let at = |t: &Tensor| arena.as_ptr().add(t.base);
            let input = at(&self.input).cast_const();
            let residual = self.residual.as_ref();
            let residual = residual.map(|r| (at(r).cast_const(), &r.layout));
            match (&self.kernel, &self.target) {
                (Kernel::Int8(conv), Target::Arena(to)) => conv.run_part(
                    input,
                    &self.input.layout,
                    residual,
                    at(to),
                    &to.layout,
                    part,
                    scratch,
                ),
                (Kernel::Int8ToMap(conv), Target::Map { index, layout }) => conv.run_part(
                    input,
                    &self.input.layout,
                    residual,
                    maps[*index].load(Ordering::Relaxed),
                    layout,
                    part,
                    scratch,
                ),
                (Kernel::Pool(pool), Target::Arena(to)) => {
                    pool.run_part(input, &self.input.layout, at(to), &to.layout, part);
                }
                _ => unreachable!("step `{}` is not an int8 one", self.name),
            }
        }
    }

    /// # Safety
    /// As [`run`](Self::run).
    unsafe fn run_float(
        &self,
        part: &Part,
        arena: &Arena<f32>,
        maps: &MapPointers,
        scratch: &mut Scratch,
    ) {
        // SAFETY: as in `run_int8`, in elements of f32.
        unsafe {
            let at = |t: &Tensor| arena.as_ptr().add(t.base);
            let input = at(&self.input).cast_const();
            let residual = self.residual.as_ref();
            let residual = residual.map(|r| (at(r).cast_const(), &r.layout));
            let (output, layout) = match &self.target {
                Target::Arena(to) => (at(to), &to.layout),
                Target::Map { index, layout } => (maps[*index].load(Ordering::Relaxed), layout),
            };
            let from = &self.input.layout;
            match &self.kernel {
                Kernel::Float(conv) => {
                    conv.run_part(input, from, residual, output, layout, part, scratch);
                }
                Kernel::Pool(pool) => pool.run_part(input, from, output, layout, part),
                _ => unreachable!("step `{}` is not an f32 one", self.name),
            }
        }
    }

    /// Bytes of scratch that a share needs.
    pub fn scratch_bytes(&self) -> usize {
        match &self.kernel {
            Kernel::Int8(c) | Kernel::Int8ToMap(c) => c.scratch_bytes(),
            Kernel::Float(c) => c.scratch_bytes(),
            Kernel::Pool(_) => 0,
        }
    }

    /// The kernel's name.
    pub fn kernel_name(&self) -> &'static str {
        match &self.kernel {
            Kernel::Int8(c) | Kernel::Int8ToMap(c) => c.name(),
            Kernel::Float(c) => c.name(),
            Kernel::Pool(p) => p.name(),
        }
    }

    /// Layout of what it writes.
    pub fn output_layout(&self) -> &Layout {
        match &self.target {
            Target::Arena(t) => &t.layout,
            Target::Map { layout, .. } => layout,
        }
    }
}
