//! Inputs of fuzz targets, damaged: whole seeds, everything that fuzzing once found, and seeds damaged at random.

use std::fs;
use std::path::{Path, PathBuf};

use rand::rngs::SmallRng;
use rand::seq::IndexedRandom;
use rand::{Rng, SeedableRng};

/// Damaged inputs per seed.
pub const DAMAGED: u64 = 200;

/// What lies in `fuzz/` of a kind for a target.
pub fn folder(kind: &str, target: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fuzz")
        .join(kind)
        .join(target)
}

/// Runs a target and says which input it was, should it panic.
pub fn check(target: fn(&[u8]), what: &str, bytes: &[u8]) {
    let panicked = std::panic::catch_unwind(|| target(bytes)).is_err();
    assert!(!panicked, "{what} panics: {}", bytes.escape_ascii());
}

/// A few of the mistakes that copying, cutting and hostile hands make.
pub fn damage(bytes: &mut Vec<u8>, rng: &mut SmallRng) {
    for _ in 0..rng.random_range(1..=4) {
        if bytes.is_empty() {
            return;
        }
        let at = rng.random_range(0..bytes.len());
        let end = (at + rng.random_range(1..=16)).min(bytes.len());
        match rng.random_range(0..7) {
            0 => bytes[at] ^= 1 << rng.random_range(0..8),
            1 => bytes[at] = *[0, 1, 0x7F, 0x80, 0xFF, b'9', b'-'].choose(rng).unwrap(),
            2 => bytes[at..end].fill(*[0, 0xFF, b'9'].choose(rng).unwrap()),
            3 => bytes.truncate(at),
            4 => drop(bytes.drain(at..end)),
            5 => {
                let piece = bytes[at..end].to_vec();
                let to = rng.random_range(0..=bytes.len());
                bytes.splice(to..to, piece);
            }
            _ => {
                // A number in text, or a length in a header.
                let number = [u64::MAX, 1 << 62, 1 << 32, 1 << 31, 65_536, 0]
                    .choose(rng)
                    .unwrap();
                let piece = if bytes[at].is_ascii_digit() {
                    number.to_string().into_bytes()
                } else {
                    number.to_le_bytes()[..4].to_vec()
                };
                let end = (at + if bytes[at].is_ascii_digit() { 1 } else { 4 }).min(bytes.len());
                bytes.splice(at..end, piece);
            }
        }
    }
}

/// Runs a target over its seeds, each whole and damaged in [`DAMAGED`] ways, and over what was found.
pub fn run(name: &str, target: fn(&[u8]), seeds: &[Vec<u8>]) {
    for (i, seed) in seeds.iter().enumerate() {
        check(target, &format!("{name}, seed {i}"), seed);
        for k in 0..DAMAGED {
            let mut bytes = seed.clone();
            damage(&mut bytes, &mut SmallRng::seed_from_u64(k));
            check(target, &format!("{name}, seed {i}, damage {k}"), &bytes);
        }
    }
    if let Ok(found) = fs::read_dir(folder("found", name)) {
        for entry in found {
            let path = entry.unwrap().path();
            check(
                target,
                &path.display().to_string(),
                &fs::read(&path).unwrap(),
            );
        }
    }
}
