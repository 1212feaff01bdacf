//! One array as it is stored: its header and bytes go in, numbers or strings come out in the file's order, and go from
//! there into row-major order.

use std::io;

use npyz::{NpyFile, NpyHeader};

use super::error::excerpt;

/// An array as it is stored: as many bytes as its header says.
pub(super) struct Raw {
    pub header: NpyHeader,
    pub shape: Vec<usize>,
    pub bytes: Vec<u8>,
}

impl Raw {
    /// Values in the file's order if they are of type `T`.
    fn values<T: npyz::Deserialize>(&self) -> Option<io::Result<Vec<T>>> {
        let file = NpyFile::with_header(self.header.clone(), &self.bytes[..]);
        Some(file.try_data::<T>().ok()?.collect())
    }

    pub fn numbers(&self) -> Option<io::Result<Vec<f64>>> {
        macro_rules! first_of {
            ($($type:ty),*) => {
                $(if let Some(values) = self.values::<$type>() {
                    return Some(values.map(|v| v.into_iter().map(|x| x as f64).collect()));
                })*
            };
        }
        first_of!(f32, f64, u8, i8, u16, i16, u32, i32, u64, i64);
        let truth = self.values::<bool>()?;
        Some(truth.map(|v| v.into_iter().map(|x| f64::from(u8::from(x))).collect()))
    }

    pub fn texts(&self) -> Option<io::Result<Vec<String>>> {
        if let Some(unicode) = self.values::<String>() {
            return Some(unicode);
        }
        let bytes = self.values::<Vec<u8>>()?;
        let text = |b: Vec<u8>| String::from_utf8(b).map_err(io::Error::other);
        Some(bytes.and_then(|all| all.into_iter().map(text).collect()))
    }

    pub fn description(&self) -> String {
        let found = format!(
            "type {} of shape {:?}",
            self.header.dtype().descr(),
            self.shape
        );
        excerpt(&found) + "; save it again as what is expected"
    }

    /// Brings values from the file's order into row-major order.
    pub fn row_major<T: Clone>(&self, stored: Vec<T>) -> Vec<T> {
        if self.header.order() == npyz::Order::C || self.shape.len() < 2 {
            return stored;
        }
        let mut out = Vec::with_capacity(stored.len());
        let mut index = vec![0; self.shape.len()];
        for _ in 0..stored.len() {
            // Column-major: the first index runs fastest.
            let axes = index.iter().zip(&self.shape).rev();
            let at = axes.fold(0, |at, (&i, &n)| at * n + i);
            out.push(stored[at].clone());
            for (i, &n) in index.iter_mut().zip(&self.shape).rev() {
                *i += 1;
                if *i < n {
                    break;
                }
                *i = 0;
            }
        }
        out
    }
}
