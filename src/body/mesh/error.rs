//! Why a body model cannot be read.

use crate::npz::NpzError;

/// What is wrong with a body model's file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MeshError {
    /// The archive or an array of it is damaged.
    #[error("body model: {0}")]
    Archive(#[from] NpzError),
    /// It is no archive but a pickle, as SMPL's own files are.
    #[error(
        "body model: expected a NumPy archive (.npz), found a pickle, which is a program and is not run; convert it by 'python models/body/from_pickle.py MODEL.pkl MODEL.npz'"
    )]
    Pickle,
    /// An array is missing.
    #[error(
        "body model: expected an array {name} as SMPL's files have it, found none; pickled models are converted with models/body/from_pickle.py"
    )]
    Missing {
        /// The array.
        name: String,
    },
    /// An array does not fit.
    #[error("body model: expected {expected} in {name}, found {found}")]
    Unfit {
        /// The array.
        name: String,
        /// What a body model has there.
        expected: String,
        /// What the file has.
        found: String,
    },
}

impl MeshError {
    pub(super) fn unfit(name: &str, expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self::Unfit {
            name: name.into(),
            expected: expected.into(),
            found: found.into(),
        }
    }
}
