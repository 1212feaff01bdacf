//! The measuring instruments: measures worked out by hand, truth in public formats, synthetic scenes.

mod eval_command;
mod humaneva;
mod measures;
mod recall;
mod studio;
mod synth;
#[path = "../program/tools.rs"]
mod tools;
mod truth;

/// Holds that two numbers are the same but for rounding.
fn near(a: f64, b: f64) {
    assert!((a - b).abs() < 1e-6, "{a} instead of {b}");
}
