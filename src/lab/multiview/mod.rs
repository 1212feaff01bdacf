//! Bodies from several views against exact truth: people with known joints go in, how far fitted bodies are from them
//! comes out, by number of views and by what the fit does.
//!
//! Two kinds of people: those of [`synth`](super::synth), whose skin and joints are not those of the fitted model
//! ([`studio`]), and bodies of the model itself ([`own`]), whose shape can be compared as well.

mod bare;
pub mod own;
mod parts;
mod report;
mod shell;
mod studio;
mod tables;
mod trial;

pub use bare::Bare;
pub use parts::PARTS;
pub use report::{Line, Tables, Times};
pub use shell::{Shell, apart};
pub use studio::studio;
pub use tables::{TablesOptions, tables};
pub use trial::{Cast, Errors, Trial};
