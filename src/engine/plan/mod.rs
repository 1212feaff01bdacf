//! A network and an input size go in; where every value lies comes out, each buffer placed once.
//!
//! Rules, in this order:
//! 1. Network outputs lie in the caller's maps, dense, without halo.
//! 2. Values that are concatenated anywhere lie side by side in one buffer, so that a concatenation is only a wider
//!    view of what its producers wrote. Concatenations share a buffer when a common value falls on the same channels in
//!    both and all others' lifetimes allow it: one buffer `[d1 | d2 | d3 | skip]` per level of SelecSLS.
//! 3. Every other value takes over a buffer of the same geometry whose tenant is dead, or a new one.
//!
//! A buffer has one geometry for ever, so halos are written once, at the start.

mod lifetime;
mod place;

pub use place::PlanError;
pub(crate) use place::{Place, Plan};
