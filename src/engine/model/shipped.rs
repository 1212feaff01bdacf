//! The weights that `build.rs` checked and embedded, if there were any.

include!(concat!(env!("OUT_DIR"), "/shipped_model.rs"));
