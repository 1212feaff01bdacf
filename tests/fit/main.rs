//! Stage III against exact truth.

#[path = "../program/mod.rs"]
mod program;
mod scene;

mod ablation;
mod background;
mod boards;
mod calibrate;
mod clocks;
mod damaged_films;
mod demo;
mod exchanged_views;
mod fitter;
mod live_views;
mod many_views;
mod meshes;
mod multiview;
mod noise;
mod one_of_two;
mod one_view;
mod piped;
mod place;
mod printed;
mod rate;
mod rest_pose;
mod resume;
mod silhouettes;
mod six_people;
mod standing;
mod time_offsets;
mod turned_views;
mod view_times;
mod who_is_who;
