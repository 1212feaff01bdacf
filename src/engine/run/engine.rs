//! The engine: a model, an input size and a number of threads go in; pictures become [`Maps`].

use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, MutexGuard};

use edgecap_kernels::{Algorithms, ConvShape, Isa};

use super::arena::Arena;
use super::build::{self, Source};
use super::error::EngineError;
use super::picture;
use super::step::{Kernel, Memory, Program, Target, Tensor};
use super::team::{Team, Track};
use crate::engine::maps::{HEAD2D_CHANNELS, HEAD3D_CHANNELS, Maps};
use crate::engine::model::{Model, Observed};
use crate::engine::network::{Graph, ValueId};
use crate::engine::plan::{Place, Plan};

/// Arithmetic of an engine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Precision {
    /// int8 weights, 7-bit activations.
    #[default]
    Int8,
    /// f32 throughout. From a model file these are the numbers its int8 weights stand for, not the trained ones.
    F32,
}

/// How to run a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EngineOptions {
    /// Pixels across; a multiple of 16.
    pub width: usize,
    /// Pixels down; a multiple of 16.
    pub height: usize,
    /// Threads, the caller's included; at least 1.
    pub threads: usize,
    /// Instruction set; `None` takes the fastest, or what `EDGECAP_ISA` says.
    pub isa: Option<Isa>,
    /// Algorithms of layers; `None` takes those that are fastest with `isa`, or what `EDGECAP_ALGORITHM` says.
    pub algorithms: Option<Algorithms>,
    /// Arithmetic.
    pub precision: Precision,
}

impl Default for EngineOptions {
    /// 512×320, int8, one thread per core up to four.
    fn default() -> Self {
        let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
        Self {
            width: 512,
            height: 320,
            threads: cores.min(4),
            isa: None,
            algorithms: None,
            precision: Precision::Int8,
        }
    }
}

/// One layer of the last run.
#[derive(Debug, Clone, PartialEq)]
pub struct LayerProfile {
    /// Name in the network.
    pub name: String,
    /// The kernel's name.
    pub kernel: &'static str,
    /// Geometry; `None` for pooling.
    pub shape: Option<ConvShape>,
    /// Output (height, width).
    pub output: (usize, usize),
    /// Multiply-accumulates of the definition.
    pub macs: u64,
    /// Those that the kernel executes ([`edgecap_kernels::Algorithm::work`]).
    pub work: u64,
    /// Nanoseconds.
    pub ns: u64,
}

/// What all input sizes of a model have in common: nothing of it depends on the size.
struct Packed {
    /// As the network file says.
    graph: Graph,
    /// With the channels that values have in memory.
    stored: Graph,
    kernels: Arc<[Kernel]>,
    /// Stored number of real 0 of every value.
    padding: Vec<u8>,
    /// What input sides are multiples of.
    multiple: usize,
    isa: Isa,
}

/// A network ready to run: everything is placed, packed and allocated.
pub struct Engine {
    packed: Arc<Packed>,
    team: Arc<Mutex<Team>>,
    track: Arc<Track<Program>>,
    maps: Maps,
    /// Which of (head2d, head3d) each of the network's outputs is.
    order: [usize; 2],
    input: Tensor,
    options: EngineOptions,
}

impl Engine {
    /// Plans, packs and allocates.
    ///
    /// # Errors
    /// When size, precision, instruction set or the model's network do not fit together.
    pub fn new(model: &Model, options: EngineOptions) -> Result<Self, EngineError> {
        let network = model.network();
        let graph = network.graph().clone();
        let multiple = Maps::step(&[network.input().multiple]);
        check_size(multiple, &options)?;
        let isa = match options.isa {
            Some(isa) => isa,
            None => Isa::detect()?,
        };
        let algorithms = match options.algorithms {
            Some(algorithms) => algorithms,
            None => match options.precision {
                Precision::Int8 => Algorithms::detect(isa)?,
                Precision::F32 => Algorithms::detect_f32()?,
            },
        };
        let source = match options.precision {
            Precision::Int8 => Source::int8(model.weights())?,
            Precision::F32 => Source::float(&graph, model.weights()),
        };
        let stored = build::stored(&graph, &source);
        let how = build::How { isa, algorithms };
        let kernels = build::kernels(&stored, &source, how, options.threads)?;
        let scratch = kernels.iter().map(Kernel::scratch_bytes).max();
        let packed = Packed {
            padding: (0..graph.values.len()).map(|v| source.padding(v)).collect(),
            graph,
            stored,
            kernels,
            multiple,
            isa,
        };
        let team = Team::new(scratch.unwrap_or(0), options.threads.max(1))
            .map_err(|e| EngineError::Threads(options.threads, e))?;
        Self::build(Arc::new(packed), Arc::new(Mutex::new(team)), options)
    }

    /// An engine for another input size that shares this one's packed weights and threads: it costs a plan and its
    /// buffers. Engines that share threads run one frame at a time.
    ///
    /// # Errors
    /// When the size does not fit the network.
    pub fn resized(&self, width: usize, height: usize) -> Result<Self, EngineError> {
        let options = EngineOptions {
            width,
            height,
            ..self.options
        };
        check_size(self.packed.multiple, &options)?;
        Self::build(self.packed.clone(), self.team.clone(), options)
    }

    fn build(
        packed: Arc<Packed>,
        team: Arc<Mutex<Team>>,
        options: EngineOptions,
    ) -> Result<Self, EngineError> {
        let EngineOptions { width, height, .. } = options;
        let element = match options.precision {
            Precision::Int8 => size_of::<u8>(),
            Precision::F32 => size_of::<f32>(),
        };
        let padding = |v: ValueId| packed.padding[v];
        let plan = Plan::new(&packed.stored, height, width, element, padding)?;
        let maps = Maps::new(width / Maps::STRIDE, height / Maps::STRIDE);
        let order = outputs(&packed.graph, &plan, &maps)?;
        // One part for each thread that could be started: on an idle machine two per thread cost 5 % (more row bands
        // with ragged ends), and on a busy one they gained nothing.
        let shares = lock(&team).threads();
        let steps = build::steps(&packed.stored, &plan, &packed.kernels, shares)?;
        let Place::Slot { slot, layout } = plan.values[Graph::INPUT] else {
            return Err(EngineError::Outputs("the input itself".into()));
        };
        let input = Tensor {
            base: plan.slots[slot].base,
            layout,
        };
        let memory = match options.precision {
            Precision::Int8 => {
                let mut arena = Arena::new(plan.len);
                fill_halos(&packed, &plan, arena.as_mut_slice());
                Memory::Int8(arena)
            }
            // Zeroed memory is the halo of real 0.
            Precision::F32 => Memory::Float(Arena::new(plan.len)),
        };
        let program = Program {
            kernels: packed.kernels.clone(),
            steps,
            memory,
            maps: Default::default(),
        };
        Ok(Self {
            packed,
            team,
            track: Arc::new(Track::new(program)),
            maps,
            order,
            input,
            options,
        })
    }

    fn team(&self) -> MutexGuard<'_, Team> {
        lock(&self.team)
    }

    /// Runs the network over one picture: `rgb` is row-major `[height, width, 3]`. Allocates nothing.
    ///
    /// # Panics
    /// When `rgb` is not of the engine's size.
    pub fn run(&mut self, rgb: &[u8]) -> &Maps {
        self.begin(rgb);
        // SAFETY: arena and maps are this engine's own, which `&mut self` keeps from everybody else.
        unsafe { self.team().run(&self.track) };
        &self.maps
    }

    /// As [`run`](Self::run), adding every value the network computes to `observed` (one entry per value of the graph).
    /// Slow: one thread. For f32 engines.
    ///
    /// # Panics
    /// When `rgb` is not of the engine's size, or `observed` not of the graph's.
    pub fn observe(&mut self, rgb: &[u8], observed: &mut [Observed]) -> &Maps {
        let graph = &self.packed.graph;
        assert_eq!(observed.len(), graph.values.len(), "one per value");
        self.begin(rgb);
        let program = &self.track.work;
        if let Memory::Float(arena) = &program.memory {
            // SAFETY: no frame is running, and the input was placed within the arena by the plan.
            unsafe { add(&self.input, arena.as_ptr(), &mut observed[Graph::INPUT]) };
        }
        let seen = |step: usize| {
            if let (Memory::Float(arena), Target::Arena(tensor)) =
                (&program.memory, &program.steps[step].target)
            {
                let value = self.packed.graph.nodes[step].output;
                // SAFETY: `run_alone` has no other thread at work, and the kernel's check put the tensor within the
                // arena.
                unsafe { add(tensor, arena.as_ptr(), &mut observed[value]) };
            }
        };
        // SAFETY: arena and maps are this engine's own, which `&mut self` keeps from everybody else; `seen` is called
        // between steps.
        unsafe { self.team().run_alone(&self.track, seen) };
        let graph = &self.packed.graph;
        for ((_, value), head) in graph.outputs.iter().zip(self.order) {
            let map = [&self.maps.head2d, &self.maps.head3d][head];
            for pixel in map.chunks_exact(graph.values[*value].channels) {
                observed[*value].add(pixel);
            }
        }
        &self.maps
    }

    /// Times of the last run's layers, in order.
    pub fn profile(&self) -> Vec<LayerProfile> {
        let nodes = self.packed.graph.nodes.iter();
        let steps = nodes.zip(&self.track.work.steps).enumerate();
        steps
            .map(|(i, (node, step))| {
                let out = step.output_layout();
                LayerProfile {
                    name: node.name.clone(),
                    kernel: self.packed.kernels[i].name(),
                    shape: node.conv().copied(),
                    output: (out.height(), out.width()),
                    macs: step.macs,
                    work: step.work,
                    ns: self.track.nanoseconds(i),
                }
            })
            .collect()
    }

    /// The instruction set in use.
    pub fn isa(&self) -> Isa {
        self.packed.isa
    }

    /// Threads that there are, the caller's included; [`use_threads`](Self::use_threads) says how many of them work.
    pub fn threads(&self) -> usize {
        self.team().threads()
    }

    /// From now on so many of these threads share a frame, here and in all engines that share them: at least one, at
    /// most all that there are. Maps do not depend on it in int8.
    pub fn use_threads(&self, threads: usize) {
        self.team().use_threads(threads);
    }

    /// What it was built with.
    pub fn options(&self) -> &EngineOptions {
        &self.options
    }

    /// Multiply-accumulates of one run by the definition.
    pub fn macs(&self) -> u64 {
        self.track.work.steps.iter().map(|s| s.macs).sum()
    }

    /// Those that the kernels execute ([`edgecap_kernels::Algorithm::work`]).
    pub fn executed_macs(&self) -> u64 {
        self.track.work.steps.iter().map(|s| s.work).sum()
    }

    /// Bytes of activations, all buffers together.
    pub fn activation_bytes(&self) -> usize {
        match &self.track.work.memory {
            Memory::Int8(a) => a.len(),
            Memory::Float(a) => 4 * a.len(),
        }
    }

    /// Puts the picture into its buffer and tells the steps where the maps are.
    fn begin(&mut self, rgb: &[u8]) {
        let EngineOptions { width, height, .. } = self.options;
        assert_eq!(
            rgb.len(),
            3 * width * height,
            "expected an RGB picture of {width}x{height}, found {} bytes; letterbox it to the engine's input",
            rgb.len()
        );
        // SAFETY: no frame of this engine is running (`&mut self`, and however `Team::run` is left, no thread is at
        // work on the frame any more), so nobody else touches the arena; slot.base + layout.buffer_len() <= plan.len,
        // the arena's length (`Plan::new`).
        unsafe { picture::store(rgb, &self.input, &self.track.work.memory) };
        let pointers = [self.maps.head2d.as_mut_ptr(), self.maps.head3d.as_mut_ptr()];
        for (slot, head) in self.track.work.maps.iter().zip(self.order) {
            // Helpers see it through the lock that begins a frame.
            slot.store(pointers[head], Ordering::Relaxed);
        }
    }
}

fn lock(team: &Mutex<Team>) -> MutexGuard<'_, Team> {
    // A team that was left in a frame says so itself.
    team.lock().unwrap_or_else(|e| e.into_inner())
}

/// Refuses an input size that the network does not take.
fn check_size(multiple: usize, options: &EngineOptions) -> Result<(), EngineError> {
    let EngineOptions { width, height, .. } = *options;
    let fits = |n: usize| n > 0 && n <= Maps::MOST_SIDE && n.is_multiple_of(multiple);
    if fits(width) && fits(height) {
        return Ok(());
    }
    Err(EngineError::Size {
        multiple,
        width,
        height,
    })
}

/// Adds every pixel of a tensor of the arena that begins at `arena`.
///
/// # Safety
/// The tensor lies within the arena, and nobody writes it meanwhile.
unsafe fn add(tensor: &Tensor, arena: *const f32, observed: &mut Observed) {
    let l = &tensor.layout;
    for y in 0..l.height() {
        for x in 0..l.width() {
            let at = tensor.base + l.origin() + y * l.row_stride() + x * l.pixel_stride();
            // SAFETY: (y, x) and `channels` elements from it lie within the layout, hence within the arena (caller).
            observed.add(unsafe { std::slice::from_raw_parts(arena.add(at), l.channels()) });
        }
    }
}

/// Checks that the network's outputs are Stage I's two heads; returns which head each output is.
fn outputs(graph: &Graph, plan: &Plan, maps: &Maps) -> Result<[usize; 2], EngineError> {
    let found = || {
        let one = |(name, v): &(String, usize)| {
            let (h, w) = plan.sizes[*v];
            format!("{name} [{h}, {w}, {}]", graph.values[*v].channels)
        };
        graph.outputs.iter().map(one).collect::<Vec<_>>().join(", ")
    };
    let heads = [("head2d", HEAD2D_CHANNELS), ("head3d", HEAD3D_CHANNELS)];
    let mut order = [usize::MAX; 2];
    for (i, (name, v)) in graph.outputs.iter().enumerate() {
        let head = heads.iter().position(|&(n, c)| {
            n == name
                && graph.values[*v].channels == c
                && plan.sizes[*v] == (maps.height, maps.width)
        });
        match (head, order.get_mut(i)) {
            (Some(head), Some(to)) => *to = head,
            _ => return Err(EngineError::Outputs(found())),
        }
    }
    let complete = order == [0, 1] || order == [1, 0];
    complete
        .then_some(order)
        .ok_or_else(|| EngineError::Outputs(found()))
}

/// Writes what padding reads, once: nobody writes halos later.
fn fill_halos(packed: &Packed, plan: &Plan, arena: &mut [u8]) {
    for slot in &plan.slots {
        let l = slot.layout;
        let halo = l.halo() as isize;
        for &(v, first) in &slot.tenants {
            let padding = packed.padding[v];
            if padding == 0 {
                continue;
            }
            for y in -halo..l.height() as isize + halo {
                for x in -halo..l.width() as isize + halo {
                    let at = slot.base + l.index(y, x) + first;
                    arena[at..at + packed.stored.values[v].channels].fill(padding);
                }
            }
        }
    }
}
