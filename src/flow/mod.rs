//! Where points of a picture are in the next one: optical flow, by Lucas and Kanade's method over a pyramid of scales
//! (Bouguet, *Pyramidal implementation of the Lucas–Kanade feature tracker*, 2001).

mod lucas_kanade;
mod plane;
mod pyramid;

pub use lucas_kanade::LucasKanade;
pub use pyramid::Pyramid;
