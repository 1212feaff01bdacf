//! Normal equations JᵀWJ · x = −JᵀWr within an envelope: rows of the lower triangle from their first entry that may
//! differ from zero to the diagonal (Jennings 1966).

/// Matrix and gradient of a least-squares problem.
#[derive(Debug, Clone, Default)]
pub struct NormalEquations {
    first: Vec<usize>,
    /// Where column 0 of each row would lie in `values`, had the row one: element (i, j) is at `offset[i] + j`,
    /// wrapping.
    offset: Vec<usize>,
    values: Vec<f64>,
    gradient: Vec<f64>,
}

impl NormalEquations {
    /// All zero, with `first[i]` the first column of row `i` that may differ from zero. Keeps its memory.
    ///
    /// # Panics
    /// If a row starts beyond its diagonal.
    pub fn reset(&mut self, first: &[usize]) {
        if self.first != first {
            let mut start = 0_usize;
            self.offset.clear();
            for (i, &f) in first.iter().enumerate() {
                assert!(f <= i, "row {i} of the envelope starts at {f}");
                self.offset.push(start.wrapping_sub(f));
                start += i + 1 - f;
            }
            self.first = first.to_vec();
            self.values.resize(start, 0.0);
            self.gradient.resize(first.len(), 0.0);
        }
        self.values.fill(0.0);
        self.gradient.fill(0.0);
    }

    /// Unknowns.
    pub fn size(&self) -> usize {
        self.first.len()
    }

    /// Adds to element (`i`, `j`), `j` ≤ `i`.
    ///
    /// # Panics
    /// Outside the envelope.
    pub fn add(&mut self, i: usize, j: usize, value: f64) {
        assert!(
            self.first[i] <= j && j <= i,
            "({i}, {j}) lies outside the envelope"
        );
        self.values[self.offset[i].wrapping_add(j)] += value;
    }

    /// Adds to the gradient.
    pub fn pull(&mut self, i: usize, value: f64) {
        self.gradient[i] += value;
    }

    /// Element (`i`, `i`).
    pub fn diagonal(&self, i: usize) -> f64 {
        self.values[self.offset[i].wrapping_add(i)]
    }

    /// JᵀWr.
    pub fn gradient(&self) -> &[f64] {
        &self.gradient
    }

    /// Cholesky factor in place of the matrix. False unless it is positive definite.
    pub fn factorise(&mut self) -> bool {
        for i in 0..self.size() {
            let first = self.first[i];
            let start = self.offset[i].wrapping_add(first);
            let (above, rest) = self.values.split_at_mut(start);
            let row = &mut rest[..=i - first];
            for j in first..i {
                let from = first.max(self.first[j]);
                let other =
                    &above[self.offset[j].wrapping_add(from)..=self.offset[j].wrapping_add(j)];
                let own = &row[from - first..j - first];
                let dot: f64 = own.iter().zip(other).map(|(a, b)| a * b).sum();
                row[j - first] = (row[j - first] - dot) / other[j - from];
            }
            let square: f64 = row[..i - first].iter().map(|v| v * v).sum();
            let pivot = row[i - first] - square;
            if !(pivot > 0.0 && pivot.is_finite()) {
                return false;
            }
            row[i - first] = pivot.sqrt();
        }
        true
    }

    /// With the factor of [`factorise`](Self::factorise): the solution of matrix · x = gradient, in place of the
    /// gradient.
    pub fn substitute(&mut self) -> &[f64] {
        let Self {
            first,
            offset,
            values,
            gradient: x,
        } = self;
        for i in 0..first.len() {
            let f = first[i];
            let row = &values[offset[i].wrapping_add(f)..=offset[i].wrapping_add(i)];
            let dot: f64 = row.iter().zip(&x[f..i]).map(|(a, b)| a * b).sum();
            x[i] = (x[i] - dot) / row[i - f];
        }
        for i in (0..first.len()).rev() {
            let f = first[i];
            let row = &values[offset[i].wrapping_add(f)..=offset[i].wrapping_add(i)];
            x[i] /= row[i - f];
            let value = x[i];
            for (x, a) in x[f..i].iter_mut().zip(row) {
                *x -= a * value;
            }
        }
        &self.gradient
    }

    /// The damped matrix: λ times the diagonal, and a trace of the identity, are added.
    pub(super) fn damp(&mut self, damping: f64) {
        for i in 0..self.size() {
            let at = self.offset[i].wrapping_add(i);
            let diagonal = &mut self.values[at];
            *diagonal += damping * *diagonal + 1e-6;
        }
    }

    /// Takes over matrix and gradient.
    pub(super) fn copy_from(&mut self, other: &Self) {
        self.first.clone_from(&other.first);
        self.offset.clone_from(&other.offset);
        self.values.clone_from(&other.values);
        self.gradient.clone_from(&other.gradient);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_solution_is_that_of_a_dense_solver(
            starts in prop::collection::vec(0.0..1.0_f64, 1..12),
            values in prop::collection::vec(-1.0..1.0_f64, 90),
        ) {
            let first: Vec<usize> = starts.iter().enumerate().map(|(i, s)| (s * (i + 1) as f64) as usize).collect();
            let n = first.len();
            let mut equations = NormalEquations::default();
            equations.reset(&first);
            let mut dense = DMatrix::zeros(n, n);
            let mut next = values.iter().copied();
            for i in 0..n {
                for j in first[i]..=i {
                    // Diagonally dominant, hence positive definite.
                    let value = if i == j { 14.0 } else { next.next().unwrap() };
                    equations.add(i, j, value);
                    dense[(i, j)] = value;
                    dense[(j, i)] = value;
                }
                equations.pull(i, next.next().unwrap());
            }
            let right = DVector::from_column_slice(equations.gradient());
            let expected = dense.cholesky().unwrap().solve(&right);
            prop_assert!(equations.factorise());
            for (found, expected) in equations.substitute().iter().zip(&expected) {
                prop_assert!((found - expected).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn what_is_not_positive_definite_is_refused() {
        let mut equations = NormalEquations::default();
        equations.reset(&[0, 0]);
        equations.add(0, 0, 1.0);
        equations.add(1, 0, 2.0);
        equations.add(1, 1, 1.0);
        assert!(!equations.factorise());
    }

    #[test]
    #[should_panic(expected = "outside the envelope")]
    fn nothing_is_added_outside_the_envelope() {
        let mut equations = NormalEquations::default();
        equations.reset(&[0, 1]);
        equations.add(1, 0, 1.0);
    }
}
