//! One operation of a planned network, bound to its buffers.

use std::sync::Arc;
use std::sync::atomic::{AtomicPtr, Ordering};

use edgecap_kernels::{FConv, Layout, MaxPool, Part, QConv, Scratch};

use super::arena::Arena;
use super::team::Work;

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

impl Kernel {
    /// Bytes of scratch that a share needs.
    pub fn scratch_bytes(&self) -> usize {
        match self {
            Kernel::Int8(c) | Kernel::Int8ToMap(c) => c.scratch_bytes(),
            Kernel::Float(c) => c.scratch_bytes(),
            Kernel::Pool(_) => 0,
        }
    }

    /// The kernel's name.
    pub fn name(&self) -> &'static str {
        match self {
            Kernel::Int8(c) | Kernel::Int8ToMap(c) => c.name(),
            Kernel::Float(c) => c.name(),
            Kernel::Pool(p) => p.name(),
        }
    }
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

/// One operation, bound to its buffers.
pub(super) struct Step {
    pub input: Tensor,
    pub residual: Option<Tensor>,
    pub target: Target,
    /// Shares of the work that may run at the same time.
    pub parts: Vec<Part>,
    /// Multiply-accumulates of the definition.
    pub macs: u64,
    /// Those that the kernel executes ([`Algorithm::work`], in f32 [`Algorithm::products`]).
    pub work: u64,
}

/// A frame of one input size: every step with its kernel, and their memory.
pub(super) struct Program {
    pub kernels: Arc<[Kernel]>,
    /// As many as kernels.
    pub steps: Vec<Step>,
    pub memory: Memory,
    pub maps: MapPointers,
}

impl Work for Program {
    fn steps(&self) -> usize {
        self.steps.len()
    }

    fn parts(&self, step: usize) -> usize {
        self.steps[step].parts.len()
    }

    /// # Safety
    /// As [`Work::run`]; an index out of bounds panics.
    unsafe fn run(&self, step: usize, part: usize, scratch: &mut Scratch) {
        let (kernel, step) = (&self.kernels[step], &self.steps[step]);
        let part = &step.parts[part];
        // SAFETY: the steps were planned for this memory (`Engine::build`), and the engine points `maps` at its own
        // maps, which have the outputs' sizes, before every frame; the rest are the caller's promises.
        unsafe {
            match &self.memory {
                Memory::Int8(arena) => step.run_int8(kernel, part, arena, &self.maps, scratch),
                Memory::Float(arena) => step.run_float(kernel, part, arena, &self.maps, scratch),
            }
        }
    }
}

impl Step {
    /// Runs one share.
    ///
    /// # Safety
    /// - `arena` is the one that the step was planned for, and `maps` point at maps of its outputs' sizes.
    /// - All shares of earlier steps are done and seen by this thread; nobody runs this share, or a share of another
    ///   step, or touches the maps, at the same time.
    unsafe fn run_int8(
        &self,
        kernel: &Kernel,
        part: &Part,
        arena: &Arena<u8>,
        maps: &MapPointers,
        scratch: &mut Scratch,
    ) {
        // SAFETY: `build` checked with the kernel that base + every index of the layout is < arena.len(), and the plan
        // proves that input, residual and output occupy different elements of the arena while they are alive
        // (`Plan::prove`); shares of one step write different rows or groups (`Part`).
        unsafe {
            let at = |t: &Tensor| arena.as_ptr().add(t.base);
            let input = at(&self.input).cast_const();
            let residual = self.residual.as_ref();
            let residual = residual.map(|r| (at(r).cast_const(), &r.layout));
            match (kernel, &self.target) {
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
                _ => unreachable!("an f32 kernel in an int8 network"),
            }
        }
    }

    /// Runs one share.
    ///
    /// # Safety
    /// As [`run_int8`](Self::run_int8).
    unsafe fn run_float(
        &self,
        kernel: &Kernel,
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
            match kernel {
                Kernel::Float(conv) => {
                    conv.run_part(input, from, residual, output, layout, part, scratch);
                }
                Kernel::Pool(pool) => pool.run_part(input, from, output, layout, part),
                _ => unreachable!("an int8 kernel in an f32 network"),
            }
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
