//! Vectors of 32-bit lanes, and the dot products that kernels are built from.
//!
//! The generic cores (`direct`, `winograd`) are inlined into thin functions that switch a tier's features on.

/// One CPU's vectors: `LANES` f32 or i32 lanes, and twice as many i16 lanes.
///
/// # Safety
/// Every method may be called only where the implementing tier's features are on. That is all for methods without a
/// section of their own: they touch no memory. Loads and stores touch exactly what theirs name, at any alignment.
pub(crate) unsafe trait Simd: Copy + 'static {
    /// 32-bit lanes.
    const LANES: usize;
    /// f32 lanes.
    type F: Copy;
    /// i32 lanes.
    type I: Copy;
    /// i16 lanes, 2 · LANES of them.
    type H: Copy;

    unsafe fn zero_f() -> Self::F;
    unsafe fn splat_f(value: f32) -> Self::F;
    /// # Safety
    /// The tier's features are on; LANES f32 are readable at `at`.
    unsafe fn load_f(at: *const f32) -> Self::F;
    /// # Safety
    /// The tier's features are on; `n <= LANES`, and `n` f32 are readable at `at`.
    unsafe fn load_f_part(at: *const f32, n: usize) -> Self::F;
    /// # Safety
    /// The tier's features are on; `n <= LANES`, and `n` f32 are writable at `at`.
    unsafe fn store_f_part(value: Self::F, at: *mut f32, n: usize);
    unsafe fn add_f(a: Self::F, b: Self::F) -> Self::F;
    unsafe fn sub_f(a: Self::F, b: Self::F) -> Self::F;
    unsafe fn mul_f(a: Self::F, b: Self::F) -> Self::F;
    /// `c + a · b`, rounded once where the CPU can.
    unsafe fn mul_add_f(a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// `c − a · b`, rounded once where the CPU can.
    unsafe fn mul_sub_f(a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// The greater; `b` where `a` is no number.
    unsafe fn max_f(a: Self::F, b: Self::F) -> Self::F;
    /// The smaller; `b` where `a` is no number.
    unsafe fn min_f(a: Self::F, b: Self::F) -> Self::F;
    /// Rounds to nearest, ties to even.
    unsafe fn f_from_i(value: Self::I) -> Self::F;
    /// Stores `n` lanes, each within 0..=255, rounded to nearest, ties to even.
    ///
    /// # Safety
    /// The tier's features are on; `n <= LANES`, and `n` bytes are writable at `at`.
    unsafe fn store_u8_part(value: Self::F, at: *mut u8, n: usize);
    /// Stores `n` lanes as `clamp(rne(value), 0, 127)`; every value lies within ±2³¹.
    ///
    /// # Safety
    /// The tier's features are on; `n <= LANES`, and `n` bytes are writable at `at`.
    unsafe fn store_u7_part(value: Self::F, at: *mut u8, n: usize);
    /// [`store_u7_part`](Self::store_u7_part) of four whole vectors, `step` bytes apart.
    ///
    /// # Safety
    /// The tier's features are on; LANES bytes are writable at every `at + k · step`, `k < 4`.
    unsafe fn store_u7_4(values: [Self::F; 4], at: *mut u8, step: usize);
    /// # Safety
    /// The tier's features are on; `n <= LANES`, and `n` bytes are readable at `at`.
    unsafe fn load_u8_part(at: *const u8, n: usize) -> Self::F;
    /// # Safety
    /// The tier's features are on; LANES i32 are readable at `at`.
    unsafe fn load_i(at: *const i32) -> Self::I;
    /// # Safety
    /// The tier's features are on; LANES i32 are writable at `at`.
    unsafe fn store_i(value: Self::I, at: *mut i32);
    unsafe fn add_i(a: Self::I, b: Self::I) -> Self::I;
    unsafe fn sub_i(a: Self::I, b: Self::I) -> Self::I;
    /// Arithmetic shift to the right by `bits`, the same in every lane.
    unsafe fn shr_i(a: Self::I, bits: Self::I) -> Self::I;
    unsafe fn shl_i<const BITS: u32>(a: Self::I) -> Self::I;

    /// Loads `n` bytes, zero-extended; the other lanes are 0.
    ///
    /// # Safety
    /// The tier's features are on; `n <= 2 · LANES`, and `n` bytes are readable at `at`.
    unsafe fn load_u8_h(at: *const u8, n: usize) -> Self::H;
    /// # Safety
    /// The tier's features are on; 2 · LANES i16 are writable at `at`.
    unsafe fn store_h(value: Self::H, at: *mut i16);
    unsafe fn add_h(a: Self::H, b: Self::H) -> Self::H;
    unsafe fn sub_h(a: Self::H, b: Self::H) -> Self::H;
    unsafe fn shl_h<const BITS: u32>(a: Self::H) -> Self::H;
    unsafe fn zero_h() -> Self::H;
}

/// `acc + x · w`, where a lane of `w` and of `x` is one 32-bit group of numbers: an f32, two i16 or four bytes.
///
/// # Safety
/// As for [`Simd`]: `dot` touches no memory, the others exactly what their sections name, at any alignment.
pub(crate) unsafe trait Dot: Copy + 'static {
    type S: Simd;
    /// Accumulator: i32 or f32 lanes.
    type Acc: Copy;
    /// A vector of weights or of one input group in every lane.
    type V: Copy;
    /// Most vectors of output channels in a tile.
    const MAX_NV: usize;
    /// Pixels in a full tile: 4, 6 or 8.
    const MAX_MR: usize;
    /// Numbers in a 32-bit group.
    const PACK: usize;
    /// 32-bit groups of a lane that lie side by side in a panel.
    const TOGETHER: usize = 1;
    /// Whether a vector of weights holds every lane's first number, then every lane's second, and so on, instead of
    /// lane after lane.
    const APART: bool = false;

    /// Loads LANES accumulators.
    ///
    /// # Safety
    /// The tier's features are on; 4 · LANES bytes are readable at `at`.
    unsafe fn load_acc(at: *const u8) -> Self::Acc;
    /// # Safety
    /// The tier's features are on; 4 · LANES bytes are readable at `at`.
    unsafe fn weights(at: *const u8) -> Self::V;
    /// # Safety
    /// The tier's features are on; 4 bytes are readable at `at`.
    unsafe fn splat(at: *const u8) -> Self::V;
    unsafe fn dot(acc: Self::Acc, x: Self::V, w: Self::V) -> Self::Acc;
}

/// A dot product in two steps, for CPUs without an instruction for it: products are summed in i16, modulo 2¹⁶, over a
/// segment of groups; what has to be added for the true sum to be a signed number of 16 bits is proved at pack time
/// (`SegmentedPacked`). Then they are added to the i32 accumulators.
///
/// # Safety
/// As for [`Dot`]: none of these methods touches memory.
#[cfg(target_arch = "x86_64")]
pub(crate) unsafe trait SegmentedDot: Dot {
    /// The first group of a segment.
    unsafe fn first(x: Self::V, w: Self::V) -> Self::V;
    /// A further group.
    unsafe fn more(sum: Self::V, x: Self::V, w: Self::V) -> Self::V;
    /// Adds a segment's sum, and what its offset adds to it, to the accumulator.
    unsafe fn spill(acc: Self::Acc, sum: Self::V, offset: Self::V) -> Self::Acc;
}

/// Writes trait methods that are one expression of intrinsics.
macro_rules! ops {
    ($($(#[$meta:meta])* fn $name:ident $(<const $c:ident: u32>)? ($($arg:ident: $ty:ty),*) $(-> $ret:ty)? = $body:expr;)*) => {
        $($(#[$meta])* #[inline(always)]
        /// # Safety
        /// That of the trait's method of this name.
        unsafe fn $name $(<const $c: u32>)? ($($arg: $ty),*) $(-> $ret)? {
            // SAFETY: the caller upholds it: the tier's features are on, and pointers are good for the lanes named.
            unsafe { $body }
        })*
    };
}
pub(crate) use ops;
