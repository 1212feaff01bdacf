//! The built program: what its processes do, together and alone, and what they say of wrong input.

#[path = "../program/mod.rs"]
mod program;

mod bad_input;
mod doctor;
mod flip_test;
mod follow_people;
mod outcome;
mod record;
mod supervisor;
mod watch;
