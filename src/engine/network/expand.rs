//! Blocks of a network file become single operations.

use std::collections::{HashMap, HashSet};

use edgecap_kernels::{ConvDims, ConvShape, PoolShape};

use super::NetworkError;
use super::graph::{Graph, Node, Op, ParamNames, Value, ValueId};
use super::spec::{ConvSpec, LayerSpec, NetworkSpec};
use crate::engine::Maps;

/// Most operations of a network; the largest shipped one has some 70.
const MAX_NODES: usize = 10_000;
/// Channels of the input: red, green and blue.
const RGB: usize = 3;

/// Expands every layer; checks that names exist once, that channels fit and that groups divide, and that all numbers
/// are of a size that the kernels take.
pub(super) fn expand(spec: &NetworkSpec) -> Result<Graph, NetworkError> {
    let mut b = Builder::new(spec);
    let multiple = spec.input.multiple;
    let has_sizes =
        (1..=Maps::MOST_SIDE).contains(&multiple) && Maps::step(&[multiple]) <= Maps::MOST_SIDE;
    if spec.input.channels != RGB || !has_sizes {
        return Err(b.error(
            format!(
                "an input of {} channels in multiples of {} pixels",
                spec.input.channels, multiple
            ),
            "give 3 channels, those of the picture, and multiples of 1 or more that go into 8192 together with 8",
        ));
    }
    for layer in &spec.layers {
        b.layer(layer)?;
    }
    let mut outputs = Vec::new();
    for (name, layer) in &spec.output {
        outputs.push((name.clone(), b.lookup(layer)?));
    }
    let readers = b.readers();
    for &(_, v) in &outputs {
        if let Some(reader) = readers[v] {
            return Err(b.error(
                format!(
                    "output `{}` is also read by `{}`",
                    b.values[v].name, reader.name
                ),
                "end the network in layers that nothing reads",
            ));
        }
    }
    if outputs.is_empty() {
        return Err(b.error("no output is named", "name at least one in `output`"));
    }
    Ok(Graph {
        values: b.values,
        nodes: b.nodes,
        outputs,
        layers: b.names,
    })
}

struct Builder<'a> {
    spec: &'a NetworkSpec,
    values: Vec<Value>,
    /// Whether a value of `values` may hold numbers below 0, as the picture does.
    can_be_negative: Vec<bool>,
    nodes: Vec<Node>,
    names: HashMap<String, ValueId>,
    /// Names of `nodes`: tensors of model files are called by them.
    taken: HashSet<String>,
    last: ValueId,
}

/// A convolution about to be added.
struct NewConv {
    name: String,
    params: ParamNames,
    out: usize,
    kernel: usize,
    stride: usize,
    groups: usize,
    transposed: bool,
    relu: bool,
}

impl NewConv {
    /// Convolution + batch norm + ReLU with PyTorch's names in a `Sequential`.
    fn sequential(name: String, out: usize, kernel: usize, stride: usize, groups: usize) -> Self {
        let params = ParamNames {
            weight: format!("{name}.0.weight"),
            bias: None,
            norm: Some(format!("{name}.1")),
        };
        Self {
            name,
            params,
            out,
            kernel,
            stride,
            groups,
            transposed: false,
            relu: true,
        }
    }
}

impl<'a> Builder<'a> {
    fn new(spec: &'a NetworkSpec) -> Self {
        let input = Value {
            name: "input".into(),
            channels: spec.input.channels,
        };
        Self {
            spec,
            values: vec![input],
            can_be_negative: vec![true],
            nodes: Vec::new(),
            names: HashMap::from([("input".into(), Graph::INPUT)]),
            taken: HashSet::new(),
            last: Graph::INPUT,
        }
    }

    fn error(&self, found: impl Into<String>, remedy: &str) -> NetworkError {
        NetworkError::Inconsistent {
            network: self.spec.name.clone(),
            found: found.into(),
            remedy: remedy.into(),
        }
    }

    /// A layer without any of its parts would be another name of what goes in.
    fn nothing(&self, layer: &str, parts: &str) -> NetworkError {
        self.error(
            format!("layer `{layer}` has no {parts}"),
            "give it one or more, or leave the layer out",
        )
    }

    fn lookup(&self, name: &str) -> Result<ValueId, NetworkError> {
        self.names.get(name).copied().ok_or_else(|| {
            self.error(
                format!("no layer named `{name}` comes before its use"),
                "check `from` and `output`",
            )
        })
    }

    fn sources(&self, from: &[String]) -> Result<Vec<ValueId>, NetworkError> {
        if from.is_empty() {
            return Ok(vec![self.last]);
        }
        from.iter().map(|n| self.lookup(n)).collect()
    }

    fn name(&mut self, name: &str, value: ValueId) -> Result<(), NetworkError> {
        if self.names.insert(name.into(), value).is_some() {
            return Err(self.error(format!("two layers are named `{name}`"), "rename one"));
        }
        Ok(())
    }

    fn push(
        &mut self,
        name: String,
        op: Op,
        inputs: Vec<ValueId>,
        residual: Option<ValueId>,
        channels: usize,
    ) -> Result<ValueId, NetworkError> {
        let output = self.values.len();
        if output > MAX_NODES {
            return Err(self.error(
                format!("more than {MAX_NODES} operations"),
                "correct the number of blocks",
            ));
        }
        if !self.taken.insert(name.clone()) {
            return Err(self.error(
                format!("two layers are named `{name}`, blocks' own layers counted"),
                "rename one",
            ));
        }
        self.can_be_negative.push(match &op {
            Op::Conv { relu, .. } => !relu,
            Op::MaxPool { .. } => self.can_be_negative[inputs[0]],
        });
        self.values.push(Value {
            name: name.clone(),
            channels,
        });
        self.nodes.push(Node {
            name,
            op,
            inputs,
            residual,
            output,
        });
        Ok(output)
    }

    fn conv(
        &mut self,
        conv: NewConv,
        inputs: Vec<ValueId>,
        residual: Option<ValueId>,
    ) -> Result<ValueId, NetworkError> {
        let in_channels: usize = inputs.iter().map(|&v| self.values[v].channels).sum();
        let padding = if conv.transposed {
            let beyond = conv.kernel.checked_sub(conv.stride);
            beyond.filter(|n| n.is_multiple_of(2)).map(|n| n / 2)
        } else {
            Some(conv.kernel / 2)
        };
        let shape = padding.and_then(|padding| {
            ConvShape::new(ConvDims {
                in_channels,
                out_channels: conv.out,
                groups: conv.groups,
                kernel: conv.kernel,
                stride: conv.stride,
                padding,
                transposed: conv.transposed,
            })
            .ok()
        });
        let Some(shape) = shape else {
            return Err(self.error(
                format!(
                    "layer `{}`: {in_channels} → {} channels, kernel {}, stride {}, {} groups",
                    conv.name, conv.out, conv.kernel, conv.stride, conv.groups
                ),
                "channels are 1 to 2²⁰ and divided by the groups, kernel and stride 1 to 64; when transposed, kernel - stride must be even and ≥ 0",
            ));
        };
        let op = Op::Conv {
            shape,
            relu: conv.relu,
            params: conv.params,
        };
        self.push(conv.name, op, inputs, residual, conv.out)
    }

    fn single(&mut self, c: &ConvSpec, transposed: bool) -> Result<(), NetworkError> {
        let n = &c.name;
        if c.norm_name.is_some() && !c.norm {
            return Err(self.error(
                format!("layer `{n}` has `norm_name` beside `norm = false`"),
                "leave one of them out",
            ));
        }
        let params = match (&c.norm_name, c.norm) {
            (Some(norm), true) => ParamNames {
                weight: format!("{n}.weight"),
                bias: None,
                norm: Some(norm.clone()),
            },
            (None, true) => ParamNames {
                weight: format!("{n}.0.weight"),
                bias: None,
                norm: Some(format!("{n}.1")),
            },
            (_, false) => ParamNames {
                weight: format!("{n}.weight"),
                bias: Some(format!("{n}.bias")),
                norm: None,
            },
        };
        let new = NewConv {
            name: n.clone(),
            params,
            out: c.out,
            kernel: c.kernel,
            stride: c.stride,
            groups: c.groups,
            transposed,
            relu: c.relu,
        };
        let inputs = self.sources(&c.from)?;
        self.last = self.conv(new, inputs, None)?;
        self.name(n, self.last)
    }

    fn layer(&mut self, layer: &LayerSpec) -> Result<(), NetworkError> {
        match layer {
            LayerSpec::Conv(c) => self.single(c, false),
            LayerSpec::Deconv(c) => self.single(c, true),
            LayerSpec::Maxpool {
                name,
                from,
                kernel,
                stride,
            } => {
                let inputs = self.sources(from)?;
                let shape = PoolShape::new(*kernel, *stride, kernel / 2);
                let (&[input], Ok(shape)) = (&inputs[..], shape) else {
                    return Err(self.error(
                        format!(
                            "pooling `{name}`: {} inputs, kernel {kernel}, stride {stride}",
                            inputs.len()
                        ),
                        "give it one input, kernel and stride of 1 to 64",
                    ));
                };
                if input == Graph::INPUT && *kernel == 1 {
                    return Err(self.error(
                        format!("pooling `{name}` copies `input`, whose numbers are larger than those of layers"),
                        "copy a layer",
                    ));
                }
                // A window of one pixel reads nothing that lies around.
                if *kernel > 1 && self.can_be_negative[input] {
                    return Err(self.error(
                        format!(
                            "pooling `{name}` reads `{}`, which can be negative, while 0 lies around it",
                            self.values[input].name
                        ),
                        "pool a layer that ends in ReLU",
                    ));
                }
                let (op, channels) = (Op::MaxPool { shape }, self.values[input].channels);
                self.last = self.push(name.clone(), op, inputs, None, channels)?;
                self.name(name, self.last)
            }
            LayerSpec::Selecsls {
                name,
                from,
                groups,
                modules,
            } => {
                if modules.is_empty() {
                    return Err(self.nothing(name, "modules"));
                }
                let mut x = self.sources(from)?;
                let mut skip = None;
                for (i, m) in modules.iter().enumerate() {
                    let out = self.selecsls(&format!("{name}.{i}"), x, skip, groups, *m)?;
                    if m[1] == 0 {
                        skip = Some(out);
                    }
                    x = vec![out];
                }
                self.last = x[0];
                self.name(name, self.last)
            }
            LayerSpec::Bottlenecks {
                name,
                from,
                width,
                out,
                blocks,
                stride,
            } => {
                if *blocks == 0 {
                    return Err(self.nothing(name, "blocks"));
                }
                let mut x = self.sources(from)?;
                for i in 0..*blocks {
                    let stride = if i == 0 { *stride } else { 1 };
                    x = vec![self.bottleneck(&format!("{name}.{i}"), x, *width, *out, stride)?];
                }
                self.last = x[0];
                self.name(name, self.last)
            }
        }
    }

    /// Of every value the first operation that reads it.
    fn readers(&self) -> Vec<Option<&Node>> {
        let mut readers = vec![None; self.values.len()];
        for node in &self.nodes {
            for &read in node.inputs.iter().chain(&node.residual) {
                readers[read].get_or_insert(node);
            }
        }
        readers
    }

    /// XNect §6.1: d1, d2, d3 and the level's first output, concatenated, reduced by a 1×1.
    fn selecsls(
        &mut self,
        name: &str,
        x: Vec<ValueId>,
        skip: Option<ValueId>,
        groups: &[[usize; 2]],
        [cin, cskip, k, out, stride]: [usize; 5],
    ) -> Result<ValueId, NetworkError> {
        let found: usize = x.iter().map(|&v| self.values[v].channels).sum();
        let skip_channels = skip.map_or(0, |v| self.values[v].channels);
        if found != cin || (cskip != 0 && cskip != skip_channels) {
            return Err(self.error(
                format!("module `{name}` expects {cin} input and {cskip} skip channels, there are {found} and {skip_channels}"),
                "correct the module table",
            ));
        }
        let g = |n: usize| {
            let holds = groups.iter().rev().find(|r| n > r[0]);
            holds.map_or(1, |r| r[1])
        };
        let c = |i: usize, out, kernel, stride, groups| {
            NewConv::sequential(format!("{name}.conv{i}"), out, kernel, stride, groups)
        };
        let d1 = self.conv(c(1, k, 3, stride, g(k)), x, None)?;
        let t2 = self.conv(c(2, k, 1, 1, 1), vec![d1], None)?;
        let d2 = self.conv(c(3, k / 2, 3, 1, g(k / 2)), vec![t2], None)?;
        let t3 = self.conv(c(4, k, 1, 1, 1), vec![d2], None)?;
        let d3 = self.conv(c(5, k / 2, 3, 1, g(k / 2)), vec![t3], None)?;
        let mut all = vec![d1, d2, d3];
        all.extend(skip.filter(|_| cskip != 0));
        self.conv(c(6, out, 1, 1, 1), all, None)
    }

    /// He et al. 2016: 1×1, 3×3 (with the stride), 1×1 + shortcut, ReLU. Names are torchvision's.
    fn bottleneck(
        &mut self,
        name: &str,
        x: Vec<ValueId>,
        width: usize,
        out: usize,
        stride: usize,
    ) -> Result<ValueId, NetworkError> {
        let c = |i: usize, out, kernel, stride| {
            let mut conv = NewConv::sequential(format!("{name}.conv{i}"), out, kernel, stride, 1);
            conv.params.weight = format!("{name}.conv{i}.weight");
            conv.params.norm = Some(format!("{name}.bn{i}"));
            conv
        };
        let shortcut = match x[..] {
            [only] if stride == 1 && self.values[only].channels == out => only,
            _ => {
                let mut conv = NewConv::sequential(format!("{name}.downsample"), out, 1, stride, 1);
                conv.relu = false;
                self.conv(conv, x.clone(), None)?
            }
        };
        let a = self.conv(c(1, width, 1, 1), x, None)?;
        let b = self.conv(c(2, width, 3, stride), vec![a], None)?;
        self.conv(c(3, out, 1, 1), vec![b], Some(shortcut))
    }
}
