//! A square matrix between a transform and its transpose, by the definition.

use super::{IN, POINTS};

/// `out = T x Tᵀ` for a transform of so many rows as `out` is wide; `add(sum, a, b)` is `sum + a · b`.
pub(super) fn sandwich<T: Copy + Default, const ROWS: usize>(
    transform: &[[T; IN]; ROWS],
    x: &[T; POINTS],
    out: &mut [T],
    add: impl Fn(T, T, T) -> T,
) {
    let mut half = [T::default(); POINTS];
    for (i, value) in half[..ROWS * IN].iter_mut().enumerate() {
        let terms = (0..IN).map(|k| (transform[i / IN][k], x[k * IN + i % IN]));
        *value = terms.fold(T::default(), |sum, (a, b)| add(sum, a, b));
    }
    for (i, value) in out[..ROWS * ROWS].iter_mut().enumerate() {
        let terms = (0..IN).map(|k| (half[i / ROWS * IN + k], transform[i % ROWS][k]));
        *value = terms.fold(T::default(), |sum, (a, b)| add(sum, a, b));
    }
}
