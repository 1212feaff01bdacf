//! The fuzz target of MP4 on the stable compiler, as `tests/fuzz.rs` runs the others: here, since these tests are the
//! ones that are built with the feature.

#[path = "../../../../tests/program/damage.rs"]
mod damage;
#[path = "../../../../fuzz/src/film.rs"]
mod film;

use super::{TINY, shown};

#[test]
fn any_bytes_are_refused_or_end() {
    damage::run("mp4", film::mp4, &[TINY.to_vec()]);
}

/// One that is refused at once would test nothing.
#[test]
fn the_seed_is_whole() {
    assert_eq!(shown(TINY).len(), 2);
}
