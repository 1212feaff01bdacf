//! Who is who. In: what is remembered of people, and what is seen. Out: how unlike each pair is. XNect §5.1.

mod appearance;
mod dissimilarity;

pub use appearance::Appearance;
pub use dissimilarity::{
    BY_PLACE, VETO, by_place, confirms, dissimilarity, looks_may_tell, reidentification,
};
