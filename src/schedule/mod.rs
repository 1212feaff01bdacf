//! How the next picture is looked at: when, at what size, which crop of it, and by how many threads. Times, sizes and
//! what was seen go in, plans come out; nothing here has a clock, a thread or a network.

pub mod change;
pub mod crew;
pub mod due;
pub mod inputs;
pub mod mean;
pub mod pace;
pub mod region;
pub mod sides;
pub mod size;
pub mod spacing;
pub mod speed;
pub mod wish;
pub mod zoom;
