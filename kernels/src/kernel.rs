//! Descriptors of kernels, and the proof that this CPU can run one.
//!
//! A kernel is one static value: its name, how its weights are packed, the CPU features it asks for and the functions
//! that run it, written once by a macro of `arch`. To call them is unsafe: they run where the CPU has the features, and
//! a [`Ready`] exists only if it has.

use std::ops::Deref;

use crate::direct::Job;
use crate::packed::{Blocking, Packed};
use crate::segments::SegmentedPacked;
use crate::winograd::generic::{self as winograd, Floats, Integers};
use crate::writers::{Biased, Float, ToF32, ToU8};
use crate::{ConvShape, Isa, arch, pool};

/// Something static that runs only where the CPU has some features.
///
/// # Safety
/// [`is_available`](Self::is_available) is true only where the CPU has all features that its functions are compiled
/// with: callers take a [`Ready`] for the proof.
pub(crate) unsafe trait Kernel: 'static {
    /// Whether this CPU has them.
    fn is_available(&self) -> bool;
}

/// A kernel that this CPU can run.
#[derive(Debug)]
pub(crate) struct Ready<K: 'static>(&'static K);

impl<K> Clone for Ready<K> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<K> Copy for Ready<K> {}

impl<K> Deref for Ready<K> {
    type Target = K;

    fn deref(&self) -> &K {
        self.0
    }
}

impl<K: Kernel> Ready<K> {
    /// The proof, or `None` where this CPU lacks a feature of `kernel`.
    pub fn new(kernel: &'static K) -> Option<Self> {
        kernel.is_available().then_some(Self(kernel))
    }
}

/// Fields that every descriptor has.
macro_rules! descriptor {
    ($(#[$doc:meta])* $name:ident $(<$p:ident>)? { $($(#[$field_doc:meta])* $field:ident: $type:ty,)* }) => {
        $(#[$doc])*
        pub(crate) struct $name $(<$p: 'static>)? {
            /// The kernel's name, for logs and benches.
            pub name: &'static str,
            /// Whether this CPU has the features that the functions below are compiled with.
            pub available: fn() -> bool,
            $($(#[$field_doc])* pub $field: $type,)*
        }

        // SAFETY: `available` asks for the features of the functions: a macro of `arch` writes both from one list, and
        // what it does not write (`DIRECT_AMX`, `TILES`) asks the system, too.
        unsafe impl $(<$p: 'static>)? Kernel for $name $(<$p>)? {
            fn is_available(&self) -> bool {
                (self.available)()
            }
        }

        impl $(<$p: 'static>)? std::fmt::Debug for $name $(<$p>)? {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.name)
            }
        }
    };
}

descriptor! {
    /// A direct int8 convolution that reads panels `P`.
    Direct<P> {
        /// How the panels are cut.
        blocking: Blocking,
        /// Runs a job; safe where the CPU has the features, for a job and a writer as `direct::run` wants them.
        to_u8: unsafe fn(&Job<'_, P>, &ToU8<'_>),
        /// As `to_u8`.
        to_f32: unsafe fn(&Job<'_, P>, &ToF32<'_>),
    }
}

descriptor! {
    /// A Winograd int8 convolution.
    Winograd {
        /// How the panels are cut.
        blocking: Blocking,
        /// How scratch memory is divided for groups of so many channels.
        plan: fn(usize, usize) -> winograd::Plan,
        /// Runs a job; safe where the CPU has the features, for a job and a writer as `winograd::run` wants them.
        to_u8: unsafe fn(&winograd::Job<'_, Integers>, &ToU8<'_>),
        /// As `to_u8`.
        to_f32: unsafe fn(&winograd::Job<'_, Integers>, &ToF32<'_>),
    }
}

descriptor! {
    /// A direct f32 convolution.
    FloatDirect {
        /// How the panels are cut.
        blocking: Blocking,
        /// Runs a job; safe where the CPU has the features, for a job and a writer as `direct::run` wants them.
        run: unsafe fn(&Job<'_, Packed>, &Float<'_>),
    }
}

descriptor! {
    /// A Winograd f32 convolution.
    FloatWinograd {
        /// How the panels are cut.
        blocking: Blocking,
        /// How scratch memory is divided for groups of so many channels.
        plan: fn(usize, usize) -> winograd::Plan,
        /// Runs a job; safe where the CPU has the features, for a job and a writer as `winograd::run` wants them.
        run: unsafe fn(&winograd::Job<'_, Floats>, &Biased<'_>),
    }
}

descriptor! {
    /// A max-pool.
    Pool {
        /// Runs a job; safe where the CPU has the features, for a job as `MaxPool::run_part` wants it.
        u8: unsafe fn(&pool::Job<'_, u8>),
        /// As `u8`.
        f32: unsafe fn(&pool::Job<'_, f32>),
    }
}

descriptor! {
    /// A chain of multiply-accumulates in registers.
    PeakChain {
        /// Takes so many steps and returns its multiply-accumulates; safe where the CPU has the features.
        run: unsafe fn(u64) -> u64,
    }
}

/// The fastest int8 dot product of a tier, and for what it is exact.
#[derive(Debug, Clone, Copy)]
pub(crate) enum DotProduct {
    /// For inputs up to `input_max`, whatever the weights.
    Plain {
        kernel: &'static Direct<Packed>,
        input_max: u8,
    },
    /// `kernel` for shapes that it `takes`, which are those it can run and is faster for; exact for every input,
    /// whatever the weights.
    Choice {
        takes: fn(&ConvShape) -> bool,
        kernel: &'static Direct<Packed>,
        otherwise: &'static Direct<Packed>,
    },
    /// For weights that can be cut into i16 segments.
    #[cfg_attr(not(target_arch = "x86_64"), allow(dead_code))]
    Segmented(&'static Direct<SegmentedPacked>),
}

/// The kernels of one tier.
#[derive(Debug)]
pub(crate) struct Tier {
    pub isa: Isa,
    /// For layers of ours.
    pub dot: DotProduct,
    /// By way of i16 halves: exact for every input and all weights.
    pub widening: &'static Direct<Packed>,
    pub winograd: &'static Winograd,
    pub float: &'static FloatDirect,
    pub float_winograd: &'static FloatWinograd,
    pub pool: &'static Pool,
    pub peak_int8: &'static PeakChain,
    pub peak_f32: &'static PeakChain,
}

impl Tier {
    /// The tier's kernels; `None` for scalar, which has none, and for other architectures.
    pub fn of(isa: Isa) -> Option<&'static Self> {
        arch::TIERS.iter().find(|tier| tier.isa == isa)
    }

    /// Whether this CPU can run all kernels of the tier.
    pub fn is_available(&self) -> bool {
        let dot: &dyn Kernel = match &self.dot {
            DotProduct::Plain { kernel, .. } | DotProduct::Choice { kernel, .. } => *kernel,
            DotProduct::Segmented(kernel) => *kernel,
        };
        let others: [&dyn Kernel; 7] = [
            self.widening,
            self.winograd,
            self.float,
            self.float_winograd,
            self.pool,
            self.peak_int8,
            self.peak_f32,
        ];
        dot.is_available() && others.iter().all(|kernel| kernel.is_available())
    }
}
