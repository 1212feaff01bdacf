//! Real-time 3D motion capture of everyone in front of ordinary cameras, on a CPU.
//!
//! The way of a frame: [`capture`] → [`engine`] (Stage I) → [`detect`] → [`lift`] (Stage II) → shared memory → [`fit`]
//! (Stage III) → shared memory → local apps. Each stage is pure: input in, output out. [`commands`] joins them.

#![deny(unsafe_code)]

pub mod assignment;
pub mod board;
pub mod body;
pub mod bounded;
pub mod bridge;
pub mod calibrate;
pub mod camera;
pub mod capture;
pub mod commands;
pub mod config;
pub mod counted;
pub mod detect;
pub mod engine;
pub mod events;
pub mod export;
pub mod fit;
pub mod flow;
pub mod follow;
pub mod http;
pub mod lab;
pub mod lift;
pub mod lru;
pub mod machine;
pub mod metrics;
pub mod multiview;
pub mod npz;
pub mod output;
pub mod overlay;
pub mod record;
pub mod schedule;
pub mod sink;
pub mod solve;
pub mod supervise;
pub mod view;

// Fuzz targets name the crate as others do; its own tests run that of the feature.
#[cfg(all(test, feature = "mp4"))]
extern crate self as edgecap;

pub use edgecap_client::{joints, message};

/// Which build this is: version, commit (outside a repository none) and the digest of the weights inside,
/// such as `0.1.0 (commit 6383f1c20aa1, weights c286956e3aae)`.
pub const BUILD: &str = env!("EDGECAP_BUILD");
