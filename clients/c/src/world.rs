//! A body in the floor-aligned world.

use std::ffi::c_int;

use edgecap_client::WorldBody;
use edgecap_client::joints::BODY_JOINTS;
use edgecap_client::message::{Body, BodyFrame};

use crate::error::{CallError, guarded};

/// [`WorldBody`] as C reads it.
#[allow(non_camel_case_types, reason = "its name in C")]
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct edgecap_world_body {
    /// Pelvis, metres.
    pub position: [f32; 3],
    /// Rotation of the pelvis from the skeleton's rest axes to world axes, xyzw.
    pub orientation: [f32; 4],
    /// Pelvis velocity, metres per second.
    pub velocity: [f32; 3],
    /// Joints, metres.
    pub joints3d: [[f32; 3]; BODY_JOINTS],
}

impl From<WorldBody> for edgecap_world_body {
    fn from(b: WorldBody) -> Self {
        Self {
            position: b.position,
            orientation: b.orientation,
            velocity: b.velocity,
            joints3d: b.joints3d,
        }
    }
}

/// Takes a body of `frame` to the floor-aligned world: 1 when `there` was written, 0 while there is no floor, −1 when
/// it failed.
///
/// # Safety
/// `frame` and `body` are null or may be read, `there` is null or may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn edgecap_in_world(
    frame: *const BodyFrame,
    body: *const Body,
    there: *mut edgecap_world_body,
) -> c_int {
    guarded(-1, || {
        if frame.is_null() || body.is_null() || there.is_null() {
            return Err(CallError::Null {
                call: "edgecap_in_world",
                what: "a frame, a body and a place for the answer",
            });
        }
        // SAFETY: not null; the caller upholds that both may be read, and any bits make a valid message.
        let (frame, body) = unsafe { (&*frame, &*body) };
        let Some(found) = frame.in_world(body) else {
            return Ok(0);
        };
        // SAFETY: not null; the caller upholds that it may be written.
        unsafe { there.write(found.into()) };
        Ok(1)
    })
}
