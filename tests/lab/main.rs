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
