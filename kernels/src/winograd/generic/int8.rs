//! u8 inputs, i16 products, i32 sums.

use super::super::POINTS;
use super::{Kind, Vectors};
use crate::simd::{Dot, Simd, ops};

/// u8 → i16 → i32.
#[derive(Debug, Clone)]
pub(crate) struct Integers;

/// Where sums begin, and what is done to them.
#[derive(Clone, Copy)]
pub(crate) struct Sums<'a> {
    /// Where the bias point's sums begin; padded, one per lane.
    pub bias: *const i32,
    pub shifts: &'a [Shift; POINTS],
}

/// How a point's sums lose the bits that its weights have more: in every lane of a vector, since the compiler makes two
/// instructions of a shift that it knows to be the same in all of them.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(crate) struct Shift {
    /// What sums begin with: half a unit of the shift.
    start: [i32; MOST_LANES],
    /// By how much they are shifted to the right.
    bits: [i32; MOST_LANES],
}

/// Most 32-bit lanes of a vector.
const MOST_LANES: usize = 16;

impl Shift {
    /// By `bits`, less than 32.
    pub fn new(bits: u32) -> Self {
        Self {
            start: [(1 << bits) >> 1; MOST_LANES],
            bits: [bits as i32; MOST_LANES],
        }
    }
}

impl Kind for Integers {
    type Input = u8;
    type Value = i16;
    type Sum = i32;
    type Sums<'a> = Sums<'a>;

    #[inline(always)]
    fn bias(sums: &Sums<'_>) -> Option<*const i32> {
        Some(sums.bias)
    }
}

// SAFETY: a vector is twice as many i16 as D has lanes; a vector of shifts has MOST_LANES lanes, of which D has at most
// as many (asserted).
unsafe impl<D: Dot<Acc = <<D as Dot>::S as Simd>::I>> Vectors<D> for Integers {
    type V = <D::S as Simd>::H;
    type End = D::Acc;
    const WIDTH: usize = 2 * D::S::LANES;

    ops! {
        fn load(at: *const u8, n: usize) -> Self::V = D::S::load_u8_h(at, n);
        fn store(value: Self::V, at: *mut i16) = D::S::store_h(value, at);
        fn zero() -> Self::V = D::S::zero_h();
        fn b_transform(d: [Self::V; 6]) -> [Self::V; 6] = {
            let a = D::S::sub_h(d[4], D::S::shl_h::<2>(d[2]));
            let b = D::S::sub_h(d[3], D::S::shl_h::<2>(d[1]));
            let c = D::S::sub_h(d[4], d[2]);
            let difference = D::S::sub_h(d[3], d[1]);
            let e = D::S::add_h(difference, difference);
            let f = D::S::add_h(D::S::shl_h::<2>(D::S::sub_h(d[0], d[2])), c);
            let g = D::S::sub_h(D::S::sub_h(d[5], d[3]), D::S::shl_h::<2>(difference));
            [
                f,
                D::S::add_h(a, b),
                D::S::sub_h(a, b),
                D::S::add_h(c, e),
                D::S::sub_h(c, e),
                g,
            ]
        };
        fn start(sums: &Sums<'_>, point: usize) -> D::Acc = {
            const { assert!(D::S::LANES <= MOST_LANES) };
            D::S::load_i(sums.shifts[point].start.as_ptr())
        };
        fn end(sums: &Sums<'_>, point: usize) -> D::Acc = D::S::load_i(sums.shifts[point].bits.as_ptr());
        fn store_sum(sum: D::Acc, end: D::Acc, at: *mut i32) = D::S::store_i(D::S::shr_i(sum, end), at);
        fn add(a: D::Acc, b: D::Acc) -> D::Acc = D::S::add_i(a, b);
        fn sub(a: D::Acc, b: D::Acc) -> D::Acc = D::S::sub_i(a, b);
        fn a0(first: D::Acc, inner: D::Acc, outer: D::Acc) -> D::Acc =
            D::S::add_i(D::S::add_i(first, inner), outer);
        fn a1(inner: D::Acc, outer: D::Acc) -> D::Acc =
            D::S::add_i(inner, D::S::add_i(outer, outer));
        fn a2(inner: D::Acc, outer: D::Acc) -> D::Acc =
            D::S::add_i(inner, D::S::shl_i::<2>(outer));
        fn a3(inner: D::Acc, outer: D::Acc, last: D::Acc) -> D::Acc =
            D::S::add_i(D::S::add_i(inner, D::S::shl_i::<3>(outer)), last);
    }
}
