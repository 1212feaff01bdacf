//! A network expanded to single operations on named values.

use std::collections::HashMap;

use edgecap_kernels::{ConvShape, PoolShape};

/// Index of a [`Value`] in [`Graph::values`].
pub type ValueId = usize;

/// Something that an operation reads or writes: a picture of some channels at some fraction of the input size.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Value {
    /// Name of the operation that writes it, or `input`.
    pub name: String,
    /// Channels.
    pub channels: usize,
}

/// Names of a convolution's parameters in a PyTorch state dict.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ParamNames {
    /// Weights.
    pub weight: String,
    /// Bias, where there is no batch norm.
    pub bias: Option<String>,
    /// Prefix of `weight`, `bias`, `running_mean`, `running_var` of the batch norm, if any.
    pub norm: Option<String>,
}

/// What an operation computes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Op {
    /// Convolution + bias, + residual where given, + ReLU where asked.
    Conv {
        /// Geometry.
        shape: ConvShape,
        /// Negative results become zero.
        relu: bool,
        /// Parameter names.
        params: ParamNames,
    },
    /// Maximum over a window of a value that is nowhere negative; what lies outside the picture does not count.
    MaxPool {
        /// Geometry.
        shape: PoolShape,
    },
}

/// One operation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Node {
    /// Unique name, e.g. `features.3.conv6`.
    pub name: String,
    /// What it computes.
    pub op: Op,
    /// Values whose concatenated channels go in.
    pub inputs: Vec<ValueId>,
    /// A value added before the ReLU.
    pub residual: Option<ValueId>,
    /// The value that comes out.
    pub output: ValueId,
}

impl Node {
    /// Rows or columns that come out for `n` that go in; 0 where that is too few.
    pub fn output_len(&self, n: usize) -> usize {
        match &self.op {
            Op::Conv { shape, .. } => shape.output_len(n),
            Op::MaxPool { shape } => shape.output_len(n),
        }
    }

    /// The convolution's geometry, if it is one.
    pub fn conv(&self) -> Option<&ConvShape> {
        match &self.op {
            Op::Conv { shape, .. } => Some(shape),
            Op::MaxPool { .. } => None,
        }
    }
}

/// Operations in an order in which they can run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Graph {
    /// Every value; 0 is the input.
    pub values: Vec<Value>,
    /// Every operation.
    pub nodes: Vec<Node>,
    /// Output name → value.
    pub outputs: Vec<(String, ValueId)>,
    /// What `from` and `output` of the network file can name, `input` included. A block is the last of its operations,
    /// whose value has a name of its own; the others have none here.
    pub layers: HashMap<String, ValueId>,
}

impl Graph {
    /// The input picture.
    pub const INPUT: ValueId = 0;

    /// (height, width) of every value for an input of `height` × `width`.
    pub fn sizes(&self, height: usize, width: usize) -> Vec<(usize, usize)> {
        let mut sizes = vec![(0, 0); self.values.len()];
        sizes[Self::INPUT] = (height, width);
        for node in &self.nodes {
            let (h, w) = sizes[node.inputs[0]];
            sizes[node.output] = (node.output_len(h), node.output_len(w));
        }
        sizes
    }

    /// Multiply-accumulates of a whole run for an input of `height` × `width`.
    pub fn macs(&self, height: usize, width: usize) -> u64 {
        let sizes = self.sizes(height, width);
        let of = |n: &Node| {
            let (h, w) = sizes[n.inputs[0]];
            n.conv().map_or(0, |s| s.macs(h, w))
        };
        self.nodes.iter().map(of).fold(0, u64::saturating_add)
    }

    /// Weights and biases after batch norm is folded.
    pub fn parameters(&self) -> usize {
        let of = |n: &Node| n.conv().map_or(0, |s| s.weight_len() + s.out_channels());
        self.nodes.iter().map(of).fold(0, usize::saturating_add)
    }
}
