//! Colours that everyone can tell apart.

/// Red, green, blue.
pub type Colour = [u8; 3];

/// Rims and shadows.
pub(super) const INK: Colour = [0, 0, 0];
/// Text.
pub(super) const PAPER: Colour = [255, 255, 255];

/// Okabe and Ito's palette, chosen to be told apart with any kind of colour vision, without black.
const PALETTE: [Colour; 7] = [
    [230, 159, 0],
    [86, 180, 233],
    [0, 158, 115],
    [240, 228, 66],
    [213, 94, 0],
    [204, 121, 167],
    [0, 114, 178],
];

/// The colour of an identity: the same in every picture and every run.
pub fn colour_of(identity: u32) -> Colour {
    PALETTE[identity as usize % PALETTE.len()]
}
