//! The C interface of [`edgecap_client`]; `include/edgecap.h` is its other half and its documentation.
//!
//! Nothing unwinds into the caller: a panic becomes an error like any other.

#![deny(unsafe_code)]

#[allow(unsafe_code, reason = "exported by name")]
mod error;
#[allow(unsafe_code, reason = "exported by name")]
mod names;
#[allow(unsafe_code, reason = "pointers from C")]
mod reader;
#[allow(unsafe_code, reason = "exported by name, pointers from C")]
mod streams;
#[allow(unsafe_code, reason = "pointers from C")]
mod world;

pub use error::edgecap_error;
pub use names::{
    edgecap_angle_name, edgecap_bone_name, edgecap_bone_parent, edgecap_coco_joint,
    edgecap_coco_name, edgecap_event_name, edgecap_health_pace_name, edgecap_health_state_name,
    edgecap_joint_name, edgecap_joint_parent, edgecap_kinect_joint, edgecap_kinect_name,
};
pub use reader::Reader;
pub use streams::*;
pub use world::{edgecap_in_world, edgecap_world_body};
