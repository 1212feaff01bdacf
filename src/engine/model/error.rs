//! What can be wrong with a model file.

use std::path::PathBuf;

use crate::engine::network::NetworkError;

/// A model or weight file cannot be read, written or used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// The file system says no.
    #[error("cannot {action} {path}")]
    Io {
        /// Read or write.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Not the safetensors layout, or cut short.
    #[error("{0}; the file is damaged or no model: fetch or import it again")]
    Damaged(String),
    /// Float weights in a model file's place.
    #[error(
        "expected a model file (.ecm), found float weights: `edgecap model import FILE --check` looks at these, without --check it makes a model file of them"
    )]
    Floats,
    /// The digest in the file is not that of its content.
    #[error(
        "the model's content has digest {found}, its header says {expected}: the file is damaged, fetch or import it again"
    )]
    Digest {
        /// In the header.
        expected: String,
        /// Computed.
        found: String,
    },
    /// The layout is one that this program does not know yet.
    #[error(
        "expected a model file of version {expected}, found version {found}: a newer edgecap made it; take that edgecap, or a model of this one"
    )]
    Newer {
        /// The version that this program reads.
        expected: u32,
        /// The file's.
        found: u64,
    },
    /// A tensor is missing.
    #[error("expected a tensor `{0}`, found none; was the right --arch given?")]
    Missing(String),
    /// Tensors that no layer of the network uses.
    #[error(
        "the network has no use for {count} tensor(s), first `{first}`; was the right --arch given?"
    )]
    Unused {
        /// How many.
        count: usize,
        /// The first in order of name.
        first: String,
    },
    /// Tensors whose names have something before them.
    #[error(
        "{count} tensors have `{prefix}` before the name that is expected: models/train/convert.py takes that off"
    )]
    Prefix {
        /// What stands there.
        prefix: String,
        /// How many.
        count: usize,
    },
    /// A PyTorch checkpoint in place of safetensors.
    #[error(
        "this is a PyTorch checkpoint, which can hold programs and is never opened here: make safetensors of it with models/train/convert.py (docs/weights.md)"
    )]
    Checkpoint,
    /// A tensor has the wrong type or shape.
    #[error("tensor `{name}`: expected {expected}, found {found}; was the right --arch given?")]
    Tensor {
        /// Its name.
        name: String,
        /// Type or shape expected.
        expected: String,
        /// Type or shape found.
        found: String,
    },
    /// A tensor holds values that cannot be.
    #[error("tensor `{name}` holds {found}; train or export the weights again")]
    Values {
        /// Its name.
        name: String,
        /// What is wrong.
        found: String,
    },
    /// What the weights mean is not what this program computes.
    #[error(
        "contract of the weights, `{key}`: expected {expected}, found {found}; this version cannot run these weights"
    )]
    Contract {
        /// Key in the metadata.
        key: String,
        /// What this program computes.
        expected: String,
        /// What the file says.
        found: String,
    },
    /// The network description.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// Activation ranges are needed and there are none.
    #[error(
        "no activation range is known for `{0}`: `edgecap model import --calibrate DIR` finds ranges on pictures, `edgecap model run --precision f32` needs none"
    )]
    NoRange(String),
    /// A build without embedded weights.
    #[error(
        "this program was built without weights (its model file was absent): give a model with --model FILE"
    )]
    NotShipped,
}

impl ModelError {
    pub(crate) fn damaged(e: impl std::fmt::Display) -> Self {
        Self::Damaged(e.to_string())
    }
}
