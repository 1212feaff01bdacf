//! Arrays of joints by row, person and joint.

use std::io::Cursor;

use crate::lab::eval::EvalError;
use crate::npz::{Archive, NpzError, Numbers};

/// An archive with the name that errors give it.
pub(super) struct Source<'a> {
    pub(super) archive: Archive<Cursor<&'a [u8]>>,
    pub(super) name: &'a str,
}

impl Source<'_> {
    pub(super) fn numbers(&mut self, key: &str) -> Result<Option<Numbers>, EvalError> {
        let read = self.archive.numbers(key);
        read.map_err(|e| self.named(e))
    }

    pub(super) fn texts(&mut self, key: &str) -> Result<Option<Vec<String>>, EvalError> {
        let read = self.archive.texts(key);
        read.map_err(|e| self.named(e))
    }

    /// The names of all arrays, for errors.
    pub(super) fn listed(&self) -> String {
        match &self.archive.names()[..] {
            [] => "no array at all".into(),
            names => format!("only {}", names.join(", ")),
        }
    }

    pub(super) fn wrong(&self, expected: impl Into<String>, found: impl Into<String>) -> EvalError {
        EvalError::format(self.name, expected, found)
    }

    fn named(&self, e: NpzError) -> EvalError {
        self.wrong(e.expected, e.found)
    }
}

/// Points of D coordinates by row, person and joint, each known or not.
pub(super) struct Table<const D: usize> {
    /// Name of the array.
    pub(super) key: &'static str,
    size: [usize; 3],
    /// D, or D + 1 with a flag.
    width: usize,
    data: Vec<f64>,
}

impl<const D: usize> Table<D> {
    /// The first of `keys` that is in the archive.
    pub(super) fn read(
        source: &mut Source<'_>,
        keys: [&'static str; 2],
    ) -> Result<Option<Self>, EvalError> {
        for key in keys {
            let Some(Numbers { shape, data }) = source.numbers(key)? else {
                continue;
            };
            let (size, width) = match shape[..] {
                [rows, joints, width] => ([rows, 1, joints], width),
                [rows, people, joints, width] => ([rows, people, joints], width),
                _ => ([0; 3], 0),
            };
            if (width != D && width != D + 1) || size.contains(&0) {
                return Err(source.wrong(
                    format!(
                        "'{key}' of shape [rows, joints, {D}] or [rows, people, joints, {D}], or with a flag as column {}",
                        D + 1
                    ),
                    format!("{shape:?}"),
                ));
            }
            return Ok(Some(Self {
                key,
                size,
                width,
                data,
            }));
        }
        Ok(None)
    }

    /// Rows, people, joints.
    pub(super) fn size(&self) -> [usize; 3] {
        self.size
    }

    /// The point of a row, person and joint, if it is known.
    pub(super) fn at(&self, [row, person, joint]: [usize; 3]) -> Option<[f64; D]> {
        let [_, people, joints] = self.size;
        let start = ((row * people + person) * joints + joint) * self.width;
        let values = &self.data[start..start + self.width];
        let point: [f64; D] = std::array::from_fn(|i| values[i]);
        let flagged = values.get(D).is_none_or(|flag| *flag > 0.0);
        (flagged && point.iter().all(|x| x.is_finite())).then_some(point)
    }
}
