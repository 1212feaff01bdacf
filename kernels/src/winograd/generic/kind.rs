//! What Winograd is computed in: integers, or f32.

use crate::simd::Dot;

/// The numbers that a job is made of.
pub(crate) trait Kind: 'static {
    /// Of the input.
    type Input: Copy + Default;
    /// Of transformed inputs.
    type Value: Copy;
    /// Of sums; 4 bytes.
    type Sum: Copy;
    /// What sums need beside products.
    type Sums<'a>: Copy;

    /// One per padded output channel, where sums of the bias point begin; `None` where the writer adds it.
    fn bias(sums: &Self::Sums<'_>) -> Option<*const Self::Sum>;
}

/// Vectors of these numbers, and the transforms of six of them.
///
/// # Safety
/// Every method may be called only where the features of `D` are on. That is all for methods without a section of their
/// own: they touch no memory. [`load`](Self::load), [`store`](Self::store) and [`store_sum`](Self::store_sum) touch
/// exactly what theirs name; nothing else touches a tensor or the scratch.
pub(crate) unsafe trait Vectors<D: Dot>: Kind {
    /// Vector of transformed inputs; a whole number of them fills a cache line.
    type V: Copy;
    /// What becomes of a point's sums, in every lane.
    type End: Copy;
    /// Numbers in a vector of transformed inputs.
    const WIDTH: usize;

    /// Loads inputs as they are transformed, zeros behind the first `n`.
    ///
    /// # Safety
    /// The features of `D` are on; `n <= WIDTH`, and `n` inputs are readable at `at`.
    unsafe fn load(at: *const Self::Input, n: usize) -> Self::V;
    /// # Safety
    /// The features of `D` are on; WIDTH values are writable at `at`.
    unsafe fn store(value: Self::V, at: *mut Self::Value);
    unsafe fn zero() -> Self::V;
    /// `Bᵀ` on six vectors.
    unsafe fn b_transform(d: [Self::V; 6]) -> [Self::V; 6];

    /// Where sums of a point begin.
    ///
    /// # Safety
    /// The features of `D` are on; `point < 36`.
    unsafe fn start(sums: &Self::Sums<'_>, point: usize) -> D::Acc;
    /// # Safety
    /// The features of `D` are on; `point < 36`.
    unsafe fn end(sums: &Self::Sums<'_>, point: usize) -> Self::End;
    /// Stores what a point's sum ends as.
    ///
    /// # Safety
    /// The features of `D` are on; LANES sums are writable at `at`.
    unsafe fn store_sum(sum: D::Acc, end: Self::End, at: *mut Self::Sum);
    unsafe fn add(a: D::Acc, b: D::Acc) -> D::Acc;
    unsafe fn sub(a: D::Acc, b: D::Acc) -> D::Acc;

    /// Row 0 of `Aᵀ` on (m0, m1 + m2, m3 + m4).
    unsafe fn a0(first: D::Acc, inner: D::Acc, outer: D::Acc) -> D::Acc;
    /// Row 1 on (m1 − m2, m3 − m4).
    unsafe fn a1(inner: D::Acc, outer: D::Acc) -> D::Acc;
    /// Row 2 on (m1 + m2, m3 + m4).
    unsafe fn a2(inner: D::Acc, outer: D::Acc) -> D::Acc;
    /// Row 3 on (m1 − m2, m3 − m4, m5).
    unsafe fn a3(inner: D::Acc, outer: D::Acc, last: D::Acc) -> D::Acc;
}
