//! The built program: what its processes do, together and alone, and what they say of wrong input.

#[path = "../program/mod.rs"]
mod program;

mod apart;
mod bad_input;
mod body_page;
mod bridges;
mod camera_away;
mod config;
mod doctor;
mod events;
mod export;
mod faults;
mod film;
mod first_steps;
mod flip_test;
mod follow_people;
mod hangs;
mod health;
mod hints;
mod install;
mod live_cameras;
mod metrics;
mod model_association;
mod open_weights;
mod outcome;
mod pace;
mod privacy;
mod quality;
mod record;
mod release;
mod replay;
mod show_picture;
mod soak;
mod supervisor;
mod view;
mod watch;
