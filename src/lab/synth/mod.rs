//! Synthetic scenes: a seed goes in, pictures of moving people and the exact truth about them come out.
//!
//! Nothing here comes from outside data: bodies are smooth solids ([`flesh`]) turned into skin ([`mesh`]), moved by a
//! skeleton ([`pose`], [`gait`], [`poses`]), dressed ([`outfit`]), put into procedural rooms and streets ([`place`]),
//! lit ([`render`]) and photographed ([`sensor`]); [`measure`] writes down what is true ([`truth`]). [`studio`] sets
//! several cameras round one scene; [`detector`] makes of truth what a network would tell.

pub mod acts;
pub mod camera;
pub mod clip;
pub mod demo;
pub mod detector;
pub mod director;
pub mod flesh;
pub mod frames;
pub mod gait;
pub mod measure;
pub mod mesh;
pub mod noise;
pub mod outfit;
pub mod place;
pub mod pose;
pub mod poses;
pub mod raster;
pub mod render;
pub mod scene;
pub mod sensor;
pub mod shape;
pub mod shoot;
pub mod stills;
pub mod studio;
pub mod support;
pub mod survey;
pub mod truth;
pub mod underside;
pub mod weights;
pub mod world;

pub use truth::{Truth, TruthCamera, TruthError, TruthFrame, TruthPerson};
