//! People between two looks: pictures go in, and where those whom the last look found are in them comes out, or that it
//! is time for the next look.

mod between;
mod joints;

pub use between::{Between, Found};
