//! Instruction set tiers: what this CPU has, and which one to use.

use std::fmt;

/// Environment variable that forces a tier, by [`Isa::name`].
pub const ISA_VARIABLE: &str = "EDGECAP_ISA";

/// A tier of kernels. All tiers give bit-identical int8 results; scalar is the specification.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Isa {
    /// Plain Rust: every CPU; the oracle of the others.
    Scalar,
    /// SSSE3 and SSE4.1: x86 CPUs without AVX2.
    Sse41,
    /// AVX2 and FMA.
    Avx2,
    /// AVX2, FMA and AVX-VNNI (`vpdpbusd` on 256 bits).
    AvxVnni,
    /// AVX-512 F, BW and VL, without VNNI.
    Avx512,
    /// AVX-512 F, BW, VL and VNNI.
    Avx512Vnni,
    /// AMX with int8 (`tdpbusd` on tiles) beside AVX-512 with VNNI.
    Amx,
    /// NEON: every aarch64 CPU.
    Neon,
    /// NEON with dotprod (`sdot`).
    NeonDot,
    /// NEON with i8mm (`usmmla`).
    NeonI8mm,
}

impl Isa {
    /// Every tier, slowest first.
    pub const ALL: [Isa; 10] = [
        Isa::Scalar,
        Isa::Sse41,
        Isa::Avx2,
        Isa::AvxVnni,
        Isa::Avx512,
        Isa::Avx512Vnni,
        Isa::Amx,
        Isa::Neon,
        Isa::NeonDot,
        Isa::NeonI8mm,
    ];

    /// The name used in `EDGECAP_ISA`, logs and benches.
    pub fn name(self) -> &'static str {
        match self {
            Isa::Scalar => "scalar",
            Isa::Sse41 => "sse41",
            Isa::Avx2 => "avx2",
            Isa::AvxVnni => "avxvnni",
            Isa::Avx512 => "avx512",
            Isa::Avx512Vnni => "avx512vnni",
            Isa::Amx => "amx",
            Isa::Neon => "neon",
            Isa::NeonDot => "neondot",
            Isa::NeonI8mm => "neoni8mm",
        }
    }

    /// Whether this CPU can run the tier.
    pub fn is_available(self) -> bool {
        #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
        if let Some(tier) = crate::kernel::Tier::of(self) {
            return tier.is_available();
        }
        self == Isa::Scalar
    }

    /// The tiers this CPU can run, slowest first; never empty.
    pub fn available() -> impl Iterator<Item = Isa> {
        Self::ALL.into_iter().filter(|isa| isa.is_available())
    }

    /// The fastest tier of this CPU, or the one forced by `EDGECAP_ISA`.
    ///
    /// # Errors
    /// When the variable names no tier, or one that this CPU lacks.
    pub fn detect() -> Result<Isa, IsaError> {
        match variable(ISA_VARIABLE) {
            Some(name) => Self::forced(&name),
            None => Ok(Self::available().last().unwrap_or(Isa::Scalar)),
        }
    }

    /// The tier called `name`, if this CPU can run it.
    ///
    /// # Errors
    /// When there is no such tier, or this CPU lacks it.
    pub fn forced(name: &str) -> Result<Isa, IsaError> {
        let isa = Self::ALL
            .into_iter()
            .find(|isa| isa.name() == name)
            .ok_or_else(|| IsaError::Unknown(name.to_owned()))?;
        if isa.is_available() {
            Ok(isa)
        } else {
            Err(IsaError::Unavailable(isa))
        }
    }
}

/// What a variable of the environment says, if anything. What is not UTF-8 is something, too, and no name of ours.
pub(crate) fn variable(name: &str) -> Option<String> {
    let set = std::env::var_os(name).filter(|set| !set.is_empty())?;
    Some(set.to_string_lossy().into_owned())
}

impl fmt::Display for Isa {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A forced tier that cannot be had.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum IsaError {
    /// No tier of that name.
    Unknown(String),
    /// The CPU lacks the tier.
    Unavailable(Isa),
}

impl fmt::Display for IsaError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = |isas: &mut dyn Iterator<Item = Isa>| {
            isas.map(Isa::name).collect::<Vec<_>>().join(", ")
        };
        match self {
            IsaError::Unknown(found) => write!(
                f,
                "{ISA_VARIABLE}: expected one of {}, found {found:?}; correct or unset the variable",
                names(&mut Isa::ALL.into_iter())
            ),
            IsaError::Unavailable(isa) => write!(
                f,
                "{ISA_VARIABLE}: this CPU has {}, but {isa} was asked for; name one of these or unset the variable",
                names(&mut Isa::available())
            ),
        }
    }
}

impl std::error::Error for IsaError {}
