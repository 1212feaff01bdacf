//! Ways to compute a convolution that differ in their numerics.

use std::fmt;

use crate::isa::variable;
use crate::{ConvShape, Isa, winograd};

/// Environment variable that chooses [`Algorithms`], by [`Algorithms::name`].
pub const ALGORITHM_VARIABLE: &str = "EDGECAP_ALGORITHM";

/// How a convolution is computed. In int8 results are bit-identical on every tier within one algorithm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Algorithm {
    /// Every product of the definition; in int8 exact in i32.
    #[default]
    Direct,
    /// Winograd F(4×4, 3×3): a quarter of the products. In int8 with i16 weights and inputs, each on half as many
    /// lanes: inputs are exact; rounding of the transformed weights is far below that of the i8 weights themselves. In
    /// f32 rounding errors are a few times those of the definition ([`FConv`](crate::FConv)).
    Winograd,
}

impl Algorithm {
    /// The algorithms that can compute `shape`, the plainest first.
    pub fn candidates(shape: &ConvShape) -> &'static [Algorithm] {
        if shape.kernel() == 3 && shape.stride() == 1 && !shape.transposed() {
            &[Algorithm::Direct, Algorithm::Winograd]
        } else {
            &[Algorithm::Direct]
        }
    }

    /// What it multiplies in int8 for an input of `height` × `width`, in int8 multiply-accumulates: those of i16 count
    /// twice, as half as many fit a vector.
    pub fn work(self, shape: &ConvShape, height: usize, width: usize) -> u64 {
        let products = self.products(shape, height, width);
        match self {
            Algorithm::Direct => products,
            Algorithm::Winograd => products.saturating_mul(2),
        }
    }

    /// Multiply-accumulates for an input of `height` × `width`, of whatever numbers; `u64::MAX` where there are more.
    pub fn products(self, shape: &ConvShape, height: usize, width: usize) -> u64 {
        match self {
            Algorithm::Direct => shape.macs(height, width),
            Algorithm::Winograd => {
                let rows = shape.output_len(height).div_ceil(winograd::OUT);
                let columns = shape.output_len(width).div_ceil(winograd::OUT);
                let per_tile = winograd::POINTS * shape.group_in() * shape.out_channels();
                let tiles = (rows as u64).saturating_mul(columns as u64);
                (per_tile as u64).saturating_mul(tiles)
            }
        }
    }

    /// Output rows that are computed together.
    pub(crate) fn row_block(self) -> usize {
        match self {
            Algorithm::Direct => 1,
            Algorithm::Winograd => winograd::OUT,
        }
    }

    /// The algorithm of [`Algorithms::Portable`]. It depends on the shape alone: with fewer channels the transforms
    /// take longer than what they save.
    pub fn preferred(shape: &ConvShape) -> Algorithm {
        if shape.group_in() >= 16 && Self::candidates(shape).contains(&Algorithm::Winograd) {
            Algorithm::Winograd
        } else {
            Algorithm::Direct
        }
    }
}

/// Which algorithm each layer of a network takes. In int8 every CPU gives the same bits for the same choice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Algorithms {
    /// [`Algorithm::preferred`]: what is fastest on most CPUs, and in f32 on all.
    #[default]
    Portable,
    /// [`Algorithm::Direct`]: the definition, and in int8 what is fastest on CPUs that multiply small matrices
    /// ([`Isa::Amx`], [`Isa::NeonI8mm`]). In int8 it is for layers whose channels come in fours; others, for which no
    /// tier has a direct vector kernel, are computed as by [`Algorithms::Portable`].
    Direct,
}

impl Algorithms {
    /// Every choice.
    pub const ALL: [Algorithms; 2] = [Algorithms::Portable, Algorithms::Direct];

    /// The name used in `EDGECAP_ALGORITHM` and certificates.
    pub fn name(self) -> &'static str {
        match self {
            Algorithms::Portable => "portable",
            Algorithms::Direct => "direct",
        }
    }

    /// The choice for a layer in int8. It depends on the shape alone, so that every CPU computes it alike.
    pub fn of(self, shape: &ConvShape) -> Algorithm {
        match self {
            // A 32-bit group is four bytes by the definition, two numbers of i16 in Winograd. Where channels do not
            // come in fours, only Winograd may have vectors; where it has none, its reference is the faster one.
            Algorithms::Direct if shape.group_in().is_multiple_of(4) => Algorithm::Direct,
            Algorithms::Portable | Algorithms::Direct => Algorithm::preferred(shape),
        }
    }

    /// The choice for a layer in f32, for which every tier has vector kernels whatever its channels.
    pub fn of_f32(self, shape: &ConvShape) -> Algorithm {
        match self {
            Algorithms::Portable => Algorithm::preferred(shape),
            Algorithms::Direct => Algorithm::Direct,
        }
    }

    /// The choice that is fastest in int8 with kernels of `isa`.
    pub fn fastest(isa: Isa) -> Self {
        match isa {
            // No CPU with i8mm was at hand. By Arm's guide Neoverse N2 begins two `usmmla` of 32 products a cycle and
            // one `smlal` of 4, so that the definition takes half of the cycles that Winograd's products do.
            Isa::Amx | Isa::NeonI8mm => Self::Direct,
            _ => Self::Portable,
        }
    }

    /// What `EDGECAP_ALGORITHM` says, else the choice that is fastest in int8 with kernels of `isa`.
    ///
    /// # Errors
    /// When the variable names no choice.
    pub fn detect(isa: Isa) -> Result<Self, AlgorithmsError> {
        Ok(Self::set()?.unwrap_or_else(|| Self::fastest(isa)))
    }

    /// What `EDGECAP_ALGORITHM` says, else the choice that is fastest in f32: no CPU here multiplies matrices of f32.
    ///
    /// # Errors
    /// When the variable names no choice.
    pub fn detect_f32() -> Result<Self, AlgorithmsError> {
        Ok(Self::set()?.unwrap_or(Self::Portable))
    }

    /// What `EDGECAP_ALGORITHM` says.
    fn set() -> Result<Option<Self>, AlgorithmsError> {
        let name = variable(ALGORITHM_VARIABLE);
        name.map(|name| Self::named(&name)).transpose()
    }

    /// The choice called `name`.
    ///
    /// # Errors
    /// When there is none.
    pub fn named(name: &str) -> Result<Self, AlgorithmsError> {
        let mut all = Self::ALL.into_iter();
        all.find(|choice| choice.name() == name)
            .ok_or_else(|| AlgorithmsError(name.to_owned()))
    }
}

/// No choice of algorithms has this name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AlgorithmsError(pub String);

impl fmt::Display for AlgorithmsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = Algorithms::ALL.map(Algorithms::name).join(" or ");
        let found = &self.0;
        write!(
            f,
            "{ALGORITHM_VARIABLE}: expected {names}, found {found:?}; correct or unset the variable"
        )
    }
}

impl std::error::Error for AlgorithmsError {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matrix_products_take_the_definition() {
        for isa in Isa::ALL {
            let direct = Algorithms::fastest(isa) == Algorithms::Direct;
            let matrices = matches!(isa, Isa::Amx | Isa::NeonI8mm);
            assert_eq!(direct, matrices, "{}", isa.name());
        }
    }

    /// 3 × 3, stride 1, 32 outputs.
    fn conv(in_channels: usize) -> ConvShape {
        ConvShape::new(crate::ConvDims {
            in_channels,
            out_channels: 32,
            kernel: 3,
            padding: 1,
            ..crate::ConvDims::default()
        })
        .unwrap()
    }

    #[test]
    fn the_definition_is_for_channels_in_fours_in_int8_and_for_all_in_f32() {
        let (direct, winograd) = (Algorithm::Direct, Algorithm::Winograd);
        for (channels, int8) in [
            (14, direct),
            (16, direct),
            (17, winograd),
            (18, winograd),
            (34, winograd),
            (36, direct),
        ] {
            let shape = conv(channels);
            assert_eq!(Algorithms::Direct.of(&shape), int8, "{channels}");
            assert_eq!(Algorithms::Direct.of_f32(&shape), direct, "{channels}");
        }
    }

    #[test]
    fn winograd_takes_a_quarter_of_the_products() {
        let shape = conv(64);
        let products = |algorithm: Algorithm, side| algorithm.products(&shape, side, side);
        let (direct, winograd) = (Algorithm::Direct, Algorithm::Winograd);
        assert_eq!(products(direct, 8), 64 * 9 * 64 * 32);
        assert_eq!(4 * products(winograd, 8), products(direct, 8));
        // Of i16 in int8.
        assert_eq!(2 * winograd.work(&shape, 8, 8), direct.work(&shape, 8, 8));
        // A tile that hangs over the edge is computed whole.
        assert_eq!(products(winograd, 5), products(winograd, 8));
    }

    #[test]
    fn choices_are_found_by_name() {
        for choice in Algorithms::ALL {
            assert_eq!(Algorithms::named(choice.name()), Ok(choice));
        }
        let error = Algorithms::named("magic").unwrap_err().to_string();
        assert!(
            error.contains("portable or direct") && error.contains("magic"),
            "{error}"
        );
    }
}
