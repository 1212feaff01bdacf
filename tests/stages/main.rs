//! The stages before shared memory, each by itself, and what draws their results.

mod any_network;
mod build_script;
mod detect;
mod detect_maps;
mod engine;
mod lift;
mod model_file;
mod overlay;
mod overlay_characters;
mod tiny_network;
mod weights;
