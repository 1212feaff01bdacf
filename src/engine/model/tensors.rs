//! Reading of safetensors: names, types and shapes are checked, f16 and f32 become f32.

use std::collections::BTreeSet;

use half::f16;
use safetensors::{Dtype, SafeTensors, tensor::TensorView};

use super::ModelError;

/// How files of `torch.save` begin: zip archives, and pickles before version 1.6.
const CHECKPOINTS: [&[u8]; 2] = [b"PK\x03\x04", b"\x80\x02"];

/// Tensors of one file and which of them were asked for.
pub(crate) struct Tensors<'a> {
    tensors: SafeTensors<'a>,
    metadata: std::collections::HashMap<String, String>,
    unread: BTreeSet<String>,
}

impl<'a> Tensors<'a> {
    /// Checks the header against the bytes.
    ///
    /// # Errors
    /// [`ModelError::Checkpoint`] where they are what `torch.save` writes, [`ModelError::Damaged`] where they are no
    /// safetensors either.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, ModelError> {
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|e| {
            match CHECKPOINTS.iter().any(|begin| bytes.starts_with(begin)) {
                true => ModelError::Checkpoint,
                false => ModelError::damaged(e),
            }
        })?;
        let tensors = SafeTensors::deserialize(bytes).map_err(ModelError::damaged)?;
        let unread = tensors.names().into_iter().map(str::to_owned).collect();
        Ok(Self {
            tensors,
            metadata: metadata.metadata().clone().unwrap_or_default(),
            unread,
        })
    }

    /// An entry of the file's metadata.
    pub fn metadata(&self, key: &str) -> Option<&str> {
        self.metadata.get(key).map(String::as_str)
    }

    /// Tensors not read so far, in order of name.
    pub fn unread(&self) -> impl Iterator<Item = &str> {
        self.unread.iter().map(String::as_str)
    }

    fn find(&self, name: &str) -> Result<TensorView<'a>, ModelError> {
        self.tensors
            .tensor(name)
            .map_err(|_| ModelError::Missing(name.into()))
    }

    fn get(&mut self, name: &str, shape: &[usize]) -> Result<TensorView<'a>, ModelError> {
        let t = self.find(name)?;
        self.unread.remove(name);
        if t.shape() != shape {
            return Err(ModelError::Tensor {
                name: name.into(),
                expected: format!("shape {shape:?}"),
                found: format!("shape {:?}", t.shape()),
            });
        }
        Ok(t)
    }

    /// Rows of a matrix that has at least one.
    ///
    /// # Errors
    /// [`ModelError::Missing`] where there is none of this name, [`ModelError::Tensor`] where it is no such matrix.
    pub fn rows(&self, name: &str) -> Result<usize, ModelError> {
        match self.find(name)?.shape() {
            [rows, _] if *rows > 0 => Ok(*rows),
            other => Err(ModelError::Tensor {
                name: name.into(),
                expected: "a matrix of one row or more".into(),
                found: format!("shape {other:?}"),
            }),
        }
    }

    /// A tensor of f16 or f32; every value is finite.
    ///
    /// # Errors
    /// [`ModelError::Missing`] where there is none of this name, [`ModelError::Tensor`] where it has another type or
    /// shape, [`ModelError::Values`] where a value is not finite.
    pub fn floats(&mut self, name: &str, shape: &[usize]) -> Result<Vec<f32>, ModelError> {
        let t = self.get(name, shape)?;
        let values: Vec<f32> = match t.dtype() {
            Dtype::F32 => {
                let (quads, _) = t.data().as_chunks::<4>();
                quads.iter().map(|&b| f32::from_le_bytes(b)).collect()
            }
            Dtype::F16 => {
                let (pairs, _) = t.data().as_chunks::<2>();
                pairs
                    .iter()
                    .map(|&b| f16::from_le_bytes(b).to_f32())
                    .collect()
            }
            other => {
                return Err(ModelError::Tensor {
                    name: name.into(),
                    expected: "type F16 or F32".into(),
                    found: format!("type {other:?}"),
                });
            }
        };
        match values.iter().position(|v| !v.is_finite()) {
            None => Ok(values),
            Some(i) => Err(ModelError::Values {
                name: name.into(),
                found: format!("{} at element {i}", values[i]),
            }),
        }
    }

    /// A tensor of i8.
    ///
    /// # Errors
    /// [`ModelError::Missing`] where there is none of this name, [`ModelError::Tensor`] where it has another type or
    /// shape.
    pub fn bytes(&mut self, name: &str, shape: &[usize]) -> Result<Vec<i8>, ModelError> {
        let t = self.get(name, shape)?;
        if t.dtype() != Dtype::I8 {
            return Err(ModelError::Tensor {
                name: name.into(),
                expected: "type I8".into(),
                found: format!("type {:?}", t.dtype()),
            });
        }
        Ok(t.data().iter().map(|&b| b as i8).collect())
    }

    /// Every tensor must have been read, but for those that `ignore` accepts.
    ///
    /// # Errors
    /// [`ModelError::Unused`] where one was not.
    pub fn finish(&self, ignore: impl Fn(&str) -> bool) -> Result<(), ModelError> {
        let mut left = self.unread().filter(|n| !ignore(n));
        match left.next() {
            None => Ok(()),
            Some(first) => Err(ModelError::Unused {
                first: first.into(),
                count: 1 + left.count(),
            }),
        }
    }
}

/// Counters of batches, which nobody needs to run a network.
pub(super) fn is_counter(name: &str) -> bool {
    name.ends_with("num_batches_tracked")
}
