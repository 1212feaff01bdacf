//! Association: Stage I's maps go in, people come out. XNect §4.1.1.

mod detection;

pub use detection::Detection;
