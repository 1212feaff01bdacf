//! The text of a network file (`models/*.toml`) goes in, a checked description comes out.
//!
//! A file has a `name`, an `about` line, the `input`, the named `output`s, and `layers`, one inline table each, told
//! apart by `kind`:
//!
//! | kind | is |
//! |---|---|
//! | `conv` | convolution, then batch norm and ReLU unless `norm = false`, `relu = false` |
//! | `deconv` | transposed convolution, the same otherwise |
//! | `maxpool` | maximum over a window of a layer that ends in ReLU, or of such a pool; with `kernel = 1` of any layer |
//! | `selecsls` | a chain of SelecSLS modules `[in, skip, k, out, stride]` (XNect §6.1) |
//! | `bottlenecks` | a chain of ResNet bottleneck blocks (He et al. 2016, §4.1) |
//!
//! `from` lists the layers whose outputs, concatenated, are the input; without it, the layer above. Padding is `kernel
//! / 2` for convolutions and pooling and `(kernel - stride) / 2` for transposed ones. Parameters are called as PyTorch
//! calls them: `NAME.0.weight` with batch norm `NAME.1.*` where there is one, else `NAME.weight` and `NAME.bias`; with
//! `norm_name = "N"`, `NAME.weight` and `N.*`.

use std::collections::BTreeMap;

use serde::Deserialize;

/// A network file.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkSpec {
    /// Short name, as given to `--arch`.
    pub name: String,
    /// One line for people.
    pub about: String,
    /// What goes in.
    pub input: InputSpec,
    /// Output name → layer name.
    pub output: BTreeMap<String, String>,
    /// Layers in order of execution.
    pub layers: Vec<LayerSpec>,
}

/// The picture that goes in.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InputSpec {
    /// Channels: 3, since the engine feeds RGB.
    pub channels: usize,
    /// Width and height are multiples of this many pixels.
    pub multiple: usize,
}

/// One entry of `layers`.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum LayerSpec {
    /// A convolution.
    Conv(ConvSpec),
    /// A transposed convolution.
    Deconv(ConvSpec),
    /// Max pooling.
    Maxpool {
        /// Name.
        name: String,
        /// The input layer, one that is nowhere negative.
        #[serde(default)]
        from: Vec<String>,
        /// Window side.
        kernel: usize,
        /// Stride.
        stride: usize,
    },
    /// SelecSLS modules in a row; the last one's output carries `name`.
    Selecsls {
        /// Name; modules are `name.0`, `name.1`, ….
        name: String,
        /// Input layers.
        #[serde(default)]
        from: Vec<String>,
        /// `[above, groups]`: 3×3 convolutions with more than `above` outputs have `groups` groups; the last that holds
        /// wins.
        #[serde(default)]
        groups: Vec<[usize; 2]>,
        /// `[in, skip, k, out, stride]`; skip 0 begins a level.
        modules: Vec<[usize; 5]>,
    },
    /// ResNet bottleneck blocks in a row; the last one's output carries `name`.
    Bottlenecks {
        /// Name; blocks are `name.0`, `name.1`, ….
        name: String,
        /// Input layers.
        #[serde(default)]
        from: Vec<String>,
        /// Channels of the 3×3 convolution.
        width: usize,
        /// Channels that come out.
        out: usize,
        /// Number of blocks.
        blocks: usize,
        /// Stride of the first block.
        stride: usize,
    },
}

/// A convolution with what follows it.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConvSpec {
    /// Name.
    pub name: String,
    /// Input layers.
    #[serde(default)]
    pub from: Vec<String>,
    /// Output channels.
    pub out: usize,
    /// Kernel side.
    pub kernel: usize,
    /// Stride.
    #[serde(default = "one")]
    pub stride: usize,
    /// Groups.
    #[serde(default = "one")]
    pub groups: usize,
    /// Batch norm follows.
    #[serde(default = "yes")]
    pub norm: bool,
    /// Name of the batch norm where it is not `NAME.1`.
    #[serde(default)]
    pub norm_name: Option<String>,
    /// ReLU follows.
    #[serde(default = "yes")]
    pub relu: bool,
}

fn one() -> usize {
    1
}

fn yes() -> bool {
    true
}
