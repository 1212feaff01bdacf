//! The box round somebody's joints.

use edgecap_client::message::Observation;

/// The corners of the box round the seen joints, pixels, the left upper one first. Without joints it holds nothing: the
/// corners are at infinity, the first beyond the second.
pub(super) fn bounds(person: &Observation) -> [[f32; 2]; 2] {
    let seen = || person.joints2d.iter().filter(|joint| joint[2] > 0.0);
    let end =
        |f: fn(f32, f32) -> f32, from: f32| [0, 1].map(|k| seen().map(|j| j[k]).fold(from, f));
    [
        end(f32::min, f32::INFINITY),
        end(f32::max, f32::NEG_INFINITY),
    ]
}
