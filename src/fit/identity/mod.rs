//! Who is who. In: what is remembered of people, and what is seen. Out: how unlike each pair is. XNect §5.1.

mod confirmation;
mod dissimilarity;
mod looks;

pub use confirmation::confirmed;
pub use dissimilarity::{
    VETO, by_former_place, by_looks_or_place, confirmation, dissimilarity, looks_may_tell,
    reidentification,
};
pub use looks::{Bounds, Look, overlap};
