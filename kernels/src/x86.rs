//! The thin functions that switch a tier's features on around the generic cores.

use crate::direct::{self, Job, Plain, Segmented, Write};
use crate::simd::{Simd, avx2, avx512};
use crate::winograd::generic as winograd;

/// A leaf: the generic core with one tier's features.
macro_rules! leaf {
    ($(#[$doc:meta])* $name:ident, $features:literal, $chain:ty, $simd:ty, $acc:ident) => {
        $(#[$doc])*
        ///
        /// # Safety
        /// The CPU has the features; the contract of [`direct::run`].
        #[target_feature(enable = $features)]
        pub(crate) unsafe fn $name<W: Write<$simd, <$simd as Simd>::$acc>>(job: &Job, writer: &W) {
            // SAFETY: the caller's contract.
            unsafe { direct::run::<$chain, W>(job, writer) }
        }
    };
}

leaf!(
    /// u8 · i8, AVX-512-VNNI.
    qs8_direct_avx512vnni, "avx512f,avx512bw,avx512vl,avx512vnni,avx2,fma",
    Plain<avx512::U8Vnni>, avx512::Avx512, I
);
leaf!(
    /// u8 · i8 in i16 segments, AVX-512BW.
    qs8_direct_avx512, "avx512f,avx512bw,avx512vl,avx2,fma",
    Segmented<avx512::U8Segmented>, avx512::Avx512, I
);
leaf!(
    /// u8 · i8 of any range, AVX-512BW.
    qs8_wide_avx512, "avx512f,avx512bw,avx512vl,avx2,fma",
    Plain<avx512::U8Wide>, avx512::Avx512, I
);
leaf!(
    /// f32, AVX-512F.
    f32_direct_avx512, "avx512f,avx512bw,avx512vl,avx2,fma",
    Plain<avx512::F32>, avx512::Avx512, F
);
leaf!(
    /// u8 · i8, AVX-VNNI.
    qs8_direct_avxvnni, "avx2,fma,avxvnni",
    Plain<avx2::U8Vnni>, avx2::Avx2, I
);
leaf!(
    /// u8 · i8 in i16 segments, AVX2.
    qs8_direct_avx2, "avx2,fma",
    Segmented<avx2::U8Segmented>, avx2::Avx2, I
);
leaf!(
    /// u8 · i8 of any range, AVX2.
    qs8_wide_avx2, "avx2,fma",
    Plain<avx2::U8Wide>, avx2::Avx2, I
);
leaf!(
    /// f32, AVX2 and FMA.
    f32_direct_avx2, "avx2,fma",
    Plain<avx2::F32>, avx2::Avx2, F
);

/// A leaf of Winograd.
macro_rules! winograd_leaf {
    ($(#[$doc:meta])* $name:ident, $features:literal, $dot:ty, $simd:ty) => {
        $(#[$doc])*
        ///
        /// # Safety
        /// The CPU has the features; the contract of [`winograd::run`].
        #[target_feature(enable = $features)]
        pub(crate) unsafe fn $name<W: Write<$simd, <$simd as Simd>::I>>(job: &winograd::Job, writer: &W) {
            // SAFETY: the caller's contract.
            unsafe { winograd::run::<$dot, W>(job, writer) }
        }
    };
}

winograd_leaf!(
    /// i16 · i16, AVX-512-VNNI.
    qs8_winograd4_avx512vnni, "avx512f,avx512bw,avx512vl,avx512vnni,avx2,fma",
    avx512::I16Vnni, avx512::Avx512
);
winograd_leaf!(
    /// i16 · i16, AVX-512BW.
    qs8_winograd4_avx512, "avx512f,avx512bw,avx512vl,avx2,fma",
    avx512::I16, avx512::Avx512
);
winograd_leaf!(
    /// i16 · i16, AVX-VNNI.
    qs8_winograd4_avxvnni, "avx2,fma,avxvnni",
    avx2::I16Vnni, avx2::Avx2
);
winograd_leaf!(
    /// i16 · i16, AVX2.
    qs8_winograd4_avx2, "avx2,fma",
    avx2::I16, avx2::Avx2
);
