//! f32 throughout.

use super::super::float::{INNER, OUTER};
use super::{Kind, Vectors};
use crate::simd::{Dot, Simd, ops};

/// f32 → f32 → f32.
#[derive(Debug, Clone)]
pub(crate) struct Floats;

impl Kind for Floats {
    type Input = f32;
    type Value = f32;
    type Sum = f32;
    type Sums<'a> = ();

    #[inline(always)]
    fn bias((): &()) -> Option<*const f32> {
        // No point reaches every output with one factor.
        None
    }
}

// SAFETY: a vector has as many f32 as D has lanes.
unsafe impl<D: Dot<Acc = <<D as Dot>::S as Simd>::F>> Vectors<D> for Floats {
    type V = D::Acc;
    type End = ();
    const WIDTH: usize = D::S::LANES;

    /// # Safety
    /// None: nothing is touched.
    #[inline(always)]
    unsafe fn end((): &(), _point: usize) {}

    ops! {
        fn load(at: *const f32, n: usize) -> D::Acc = D::S::load_f_part(at, n);
        fn store(value: D::Acc, at: *mut f32) = D::S::store_f_part(value, at, D::S::LANES);
        fn zero() -> D::Acc = D::S::zero_f();
        fn b_transform(d: [D::Acc; 6]) -> [D::Acc; 6] = {
            let (half, two) = (D::S::splat_f(0.5), D::S::splat_f(2.0));
            let (inner, outer) = (D::S::splat_f(INNER), D::S::splat_f(OUTER));
            let both = D::S::splat_f(2.5);
            let even = D::S::mul_sub_f(two, d[2], d[4]);
            let odd = D::S::mul_sub_f(two, d[1], d[3]);
            let even2 = D::S::mul_sub_f(half, d[2], d[4]);
            let odd2 = D::S::mul_sub_f(half, d[1], d[3]);
            [
                D::S::mul_sub_f(both, d[2], D::S::add_f(d[0], d[4])),
                D::S::mul_add_f(inner, odd, even),
                D::S::mul_sub_f(inner, odd, even),
                D::S::mul_add_f(outer, odd2, even2),
                D::S::mul_sub_f(outer, odd2, even2),
                D::S::mul_sub_f(both, d[3], D::S::add_f(d[1], d[5])),
            ]
        };
        fn start(_sums: &(), _point: usize) -> D::Acc = D::S::zero_f();
        fn store_sum(sum: D::Acc, _end: (), at: *mut f32) = D::S::store_f_part(sum, at, D::S::LANES);
        fn add(a: D::Acc, b: D::Acc) -> D::Acc = D::S::add_f(a, b);
        fn sub(a: D::Acc, b: D::Acc) -> D::Acc = D::S::sub_f(a, b);
        fn a0(first: D::Acc, inner: D::Acc, outer: D::Acc) -> D::Acc =
            D::S::add_f(D::S::add_f(first, inner), outer);
        fn a1(inner: D::Acc, outer: D::Acc) -> D::Acc = {
            let outer = D::S::mul_f(D::S::splat_f(OUTER), outer);
            D::S::mul_add_f(D::S::splat_f(INNER), inner, outer)
        };
        fn a2(inner: D::Acc, outer: D::Acc) -> D::Acc =
            D::S::mul_add_f(D::S::splat_f(0.5), inner, D::S::add_f(outer, outer));
        fn a3(inner: D::Acc, outer: D::Acc, last: D::Acc) -> D::Acc = {
            let last = D::S::mul_add_f(D::S::splat_f(2.0 * OUTER), outer, last);
            D::S::mul_add_f(D::S::splat_f(0.5 * INNER), inner, last)
        };
    }
}
