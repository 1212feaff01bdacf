//! Model → kernels: chosen, their weights packed. Kernels + plan → steps: every access checked once.

use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::Builder;

use edgecap_kernels::{
    Algorithm, Algorithms, ConvShape, Epilogue, FConv, FConvParams, Isa, KernelError, MaxPool,
    Part, QConv, QConvParams,
};

use super::error::EngineError;
use super::step::{Kernel, Step, Target, Tensor};
use crate::engine::model::{
    FloatConv, ModelError, QuantConv, Scale, Weights, dequantise, input_scales,
};
use crate::engine::network::{Graph, Node, Op};
use crate::engine::plan::{Place, Plan};

/// Weights as the engine is to run them.
pub(super) enum Source<'a> {
    /// f32, of every node.
    Float(Vec<Option<FloatConv>>),
    /// int8, of every node, with the scale of every value.
    Int8(&'a [Option<QuantConv>], &'a [Option<Scale>]),
}

impl<'a> Source<'a> {
    /// int8 as they are.
    ///
    /// # Errors
    /// [`EngineError::NotQuantised`] where they are floats.
    pub fn int8(weights: &'a Weights) -> Result<Self, EngineError> {
        match weights {
            Weights::Int8 { convs, scales } => Ok(Self::Int8(convs, scales)),
            Weights::Float(_) => Err(EngineError::NotQuantised),
        }
    }

    /// f32: as trained, or what int8 weights stand for.
    pub fn float(graph: &Graph, weights: &Weights) -> Self {
        match weights {
            Weights::Float(convs) => Self::Float(convs.clone()),
            Weights::Int8 { convs, scales } => {
                let nodes = graph.nodes.iter().zip(convs);
                let real = nodes.map(|(n, q)| q.as_ref().map(|q| dequantise(n, q, scales)));
                Self::Float(real.collect())
            }
        }
    }

    /// The stored number of real 0 of a value.
    pub fn padding(&self, value: usize) -> u8 {
        match self {
            Self::Float(_) => 0,
            Self::Int8(_, scales) => scales[value].as_ref().map_or(0, Scale::padding),
        }
    }
}

/// Channels of the picture as stored for int8: kernels read channels by fours; the fourth has weight 0.
pub(super) const PICTURE_CHANNELS: usize = 4;

/// The graph with the channels that values have in memory.
pub(super) fn stored(graph: &Graph, source: &Source<'_>) -> Graph {
    let mut stored = graph.clone();
    let reads = |n: &&Node| n.inputs.contains(&Graph::INPUT);
    let adds = |n: &Node| n.residual == Some(Graph::INPUT);
    if matches!(source, Source::Int8(..))
        && graph.nodes.iter().filter(reads).all(takes_picture)
        // What it is added to has the channels of the network.
        && !graph.nodes.iter().any(adds)
    {
        stored.values[Graph::INPUT].channels = PICTURE_CHANNELS;
    }
    stored
}

/// Whether a node's weights can be given a fourth channel.
fn takes_picture(node: &Node) -> bool {
    node.inputs == [Graph::INPUT] && node.conv().is_some_and(|s| s.groups() == 1)
}

fn refused(node: &Node) -> impl Fn(KernelError) -> EngineError {
    |source| EngineError::Kernel {
        layer: node.name.clone(),
        source,
    }
}

fn missing(node: &Node) -> EngineError {
    EngineError::Layer(node.name.clone())
}

/// What kernels are packed for.
#[derive(Clone, Copy)]
pub(super) struct How {
    pub isa: Isa,
    pub algorithms: Algorithms,
}

/// Most bytes of all packed weights, more than the largest networks for poses can take (HRNet-W48: 1.3 GB). What is
/// larger is a mistake in a network file, or a small file that asks for the memory of a large one.
const MOST_PACKED: usize = 2 << 30;

/// Packs every node's weights, by so many threads or as many of them as there can be.
pub(super) fn kernels(
    graph: &Graph,
    source: &Source<'_>,
    how: How,
    threads: usize,
) -> Result<Arc<[Kernel]>, EngineError> {
    let convs = graph.nodes.iter().filter_map(Node::conv);
    let bytes = convs.map(ConvShape::most_packed_bytes);
    let bytes = bytes.fold(0, usize::saturating_add);
    if bytes > MOST_PACKED {
        return Err(EngineError::Packed {
            most: MOST_PACKED / 1_000_000,
            found: bytes / 1_000_000,
        });
    }
    let kernel = |i: usize| kernel(graph, source, how, i);
    // Packing is most of the start-up: every layer is packed on its own.
    let packed = shared_out(graph.nodes.len(), threads, Builder::new, kernel);
    packed.into_iter().collect()
}

/// What `make` makes of each number below `count`, in order: by this thread and more, `threads` in all or as many as
/// the system has room for. They have ended by then: the team's come after them, and there may be no room for both.
fn shared_out<T: Send>(
    count: usize,
    threads: usize,
    thread: impl Fn() -> Builder,
    make: impl Fn(usize) -> T + Sync,
) -> Vec<T> {
    let next = AtomicUsize::new(0);
    let some = || -> Vec<(usize, T)> {
        let numbers = std::iter::from_fn(|| Some(next.fetch_add(1, Ordering::Relaxed)));
        let numbers = numbers.take_while(|i| *i < count);
        numbers.map(|i| (i, make(i))).collect()
    };
    let mut made = std::thread::scope(|scope| {
        let more = (1..threads.min(count)).map_while(|_| thread().spawn_scoped(scope, some).ok());
        let more: Vec<_> = more.collect();
        let mut made = some();
        for other in more {
            made.extend(other.join().unwrap_or_else(|panic| resume_unwind(panic)));
        }
        made
    });
    made.sort_unstable_by_key(|(i, _)| *i);
    made.into_iter().map(|(_, made)| made).collect()
}

fn kernel(
    graph: &Graph,
    source: &Source<'_>,
    how: How,
    index: usize,
) -> Result<Kernel, EngineError> {
    let node = &graph.nodes[index];
    let is_map = graph.outputs.iter().any(|(_, v)| *v == node.output);
    Ok(match (&node.op, source) {
        (Op::MaxPool { .. }, Source::Int8(..)) if is_map => return Err(missing(node)),
        (Op::MaxPool { shape }, _) => {
            Kernel::Pool(MaxPool::new(how.isa, *shape).map_err(refused(node))?)
        }
        (Op::Conv { shape, relu, .. }, Source::Float(convs)) => {
            let conv = convs[index].as_ref().ok_or_else(|| missing(node))?;
            let params = FConvParams {
                shape: *shape,
                weights: &conv.weight,
                bias: &conv.bias,
                relu: *relu,
                residual: node.residual.is_some(),
                algorithm: how.algorithms.of_f32(shape),
            };
            Kernel::Float(FConv::new(how.isa, &params).map_err(refused(node))?)
        }
        (Op::Conv { relu, .. }, Source::Int8(convs, scales)) => {
            let conv = convs[index].as_ref().ok_or_else(|| missing(node))?;
            if is_map && (*relu || node.residual.is_some()) {
                return Err(missing(node));
            }
            check_sum(graph, node, scales)?;
            let channels = node.inputs.iter().map(|&v| graph.values[v].channels).sum();
            let conv = int8(node, channels, conv, scales, how).map_err(refused(node))?;
            if is_map {
                Kernel::Int8ToMap(conv)
            } else {
                Kernel::Int8(conv)
            }
        }
    })
}

/// Binds every kernel to its buffers; `shares` says into how many parts the rows of a step may be cut.
pub(super) fn steps(
    graph: &Graph,
    plan: &Plan,
    kernels: &[Kernel],
    shares: usize,
) -> Result<Vec<Step>, EngineError> {
    let nodes = graph.nodes.iter().zip(kernels);
    nodes
        .map(|(node, kernel)| step(graph, plan, node, kernel, shares))
        .collect()
}

fn step(
    graph: &Graph,
    plan: &Plan,
    node: &Node,
    kernel: &Kernel,
    shares: usize,
) -> Result<Step, EngineError> {
    let tensor = |place: Place| match place {
        Place::Slot { slot, layout } => Ok(Tensor {
            base: plan.slots[slot].base,
            layout,
        }),
        Place::Output { .. } => Err(missing(node)),
    };
    let input = tensor(plan.input(graph, node))?;
    let residual = match node.residual {
        Some(v) => Some(tensor(plan.values[v])?),
        None => None,
    };
    let target = match plan.values[node.output] {
        Place::Output { index, layout } => Target::Map { index, layout },
        place => Target::Arena(tensor(place)?),
    };

    // Lengths count from the tensor's own buffer to the end of the arena (or of the map), which is what its pointer may
    // reach.
    let reach = |t: &Tensor| plan.len - t.base;
    let out = match &target {
        Target::Arena(t) => (&t.layout, reach(t)),
        Target::Map { layout, .. } => (layout, layout.buffer_len()),
    };
    let from = (&input.layout, reach(&input));
    let also = residual.as_ref().map(|r| (&r.layout, reach(r)));
    match kernel {
        Kernel::Int8(c) | Kernel::Int8ToMap(c) => c.check(from, also, out),
        Kernel::Float(c) => c.check(from, also, out),
        Kernel::Pool(p) => p.check(from, out),
    }
    .map_err(refused(node))?;

    let height = out.0.height();
    let count = shares.min(height).max(1);
    let part = |i: usize| match kernel {
        Kernel::Int8(c) | Kernel::Int8ToMap(c) => c.part(height, i, count),
        Kernel::Float(c) => c.part(height, i, count),
        Kernel::Pool(p) => p.part(height, i, count),
    };
    let busy = |p: &Part| !p.rows.is_empty() && !p.groups.is_empty();
    let parts = (0..count).map(part).filter(busy).collect();
    let (h, w) = plan.sizes[node.inputs[0]];
    // Of the network's channels, of which the picture may have one more in memory.
    let work = |s: &ConvShape| match kernel {
        Kernel::Int8(c) | Kernel::Int8ToMap(c) => c.algorithm().work(s, h, w),
        Kernel::Float(c) => c.algorithm().products(s, h, w),
        Kernel::Pool(_) => 0,
    };
    Ok(Step {
        input,
        residual,
        target,
        parts,
        macs: node.conv().map_or(0, |s| s.macs(h, w)),
        work: node.conv().map_or(0, work),
    })
}

/// Values of a residual sum have one step for all their channels: the kernel has one factor.
fn check_sum(graph: &Graph, node: &Node, scales: &[Option<Scale>]) -> Result<(), EngineError> {
    for v in node.residual.iter().flat_map(|&r| [r, node.output]) {
        let steps = scales[v].as_ref().map_or(&[][..], |s| &s.steps);
        if steps.iter().any(|s| *s != steps[0]) {
            let name = format!("{}.step", graph.values[v].name);
            let found = "different steps of the channels of a residual sum".into();
            return Err(ModelError::Values { name, found }.into());
        }
    }
    Ok(())
}

/// Packs an int8 convolution. Every stored number q stands for `scale * (q - zero)`: zeros of inputs, of the residual
/// and of the output are constants per output channel and phase (which sums taps of its own), so they are folded into
/// the biases. `channels` of the input are stored, the last of which may be more than the network has: they get weight
/// 0.
fn int8(
    node: &Node,
    channels: usize,
    conv: &QuantConv,
    scales: &[Option<Scale>],
    how: How,
) -> Result<QConv, KernelError> {
    let Op::Conv { shape, .. } = &node.op else {
        unreachable!("called for convolutions only");
    };
    let zeros: Vec<f32> = input_scales(node, scales).map(|s| s.1).collect();
    let residual = node.residual.and_then(|v| scales[v].as_ref());
    let output = scales[node.output].as_ref();
    let (gi, go) = (shape.group_in(), shape.group_out());
    let (kernel, outs) = (shape.kernel(), shape.out_channels());
    let taps = kernel * kernel;
    let mut bias = vec![0; shape.phases() * outs];
    for (o, row) in conv.weight.chunks_exact(gi * taps).enumerate() {
        let first = o / go * gi;
        let mut of_zeros = vec![0.0; shape.phases()];
        for (i, &w) in row.iter().enumerate() {
            let (channel, tap) = (first + i / taps, i % taps);
            let phase = shape.phase_of(tap / kernel, tap % kernel);
            of_zeros[phase] += f64::from(w) * f64::from(zeros[channel]);
        }
        for (phase, of_zeros) in of_zeros.into_iter().enumerate() {
            let mut acc = f64::from(conv.bias[o]) / f64::from(conv.scale[o]);
            acc -= of_zeros;
            for (s, sign) in [(residual, -1.0), (output, 1.0)] {
                let real = s.map_or(0.0, |s| f64::from(s.steps[o]) * f64::from(s.zero));
                acc += sign * real / f64::from(conv.scale[o]);
            }
            let acc = acc.round();
            if !(f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&acc) {
                return Err(KernelError::Value(format!(
                    "expected a bias within i32, found {acc:.2e} steps of the weights of output channel {o}; quantise the weights again"
                )));
            }
            bias[phase * outs + o] = acc as i32;
        }
    }
    let epilogue = match output {
        None => Epilogue::F32 {
            scale: conv.scale.clone(),
        },
        Some(out) => Epilogue::U8 {
            scale: conv
                .scale
                .iter()
                .zip(&out.steps)
                .map(|(s, t)| s / t)
                .collect(),
            max: 127,
            // Values of a residual sum have one step for all their channels.
            residual_scale: residual.map(|r| r.steps[0] / out.steps[0]),
        },
    };
    // The picture alone has whole bytes: nothing pools it, and kernels put out 7 bits.
    let picture = node.inputs.contains(&Graph::INPUT);
    let mut dims = shape.dims();
    let mut weights = std::borrow::Cow::from(&conv.weight);
    if channels > shape.in_channels() {
        weights = conv
            .weight
            .chunks_exact(shape.in_channels() * taps)
            .flat_map(|row| {
                let zeros = std::iter::repeat_n(0, (channels - shape.in_channels()) * taps);
                row.iter().copied().chain(zeros)
            })
            .collect();
        dims.in_channels = channels;
    }
    let shape = ConvShape::new(dims)?;
    let pack = |algorithm| {
        let params = QConvParams {
            shape,
            weights: &weights,
            bias: &bias,
            input_max: if picture { 255 } else { 127 },
            epilogue: epilogue.clone(),
            algorithm,
        };
        QConv::new(how.isa, &params)
    };
    // Winograd refuses some weights. Which ones depends on the weights alone, so every machine takes the same way.
    match pack(how.algorithms.of(&shape)) {
        Err(KernelError::Value(_)) => pack(Algorithm::Direct),
        packed => packed,
    }
}

#[cfg(test)]
mod tests;
