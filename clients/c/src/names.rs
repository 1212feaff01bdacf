//! Names of joints and bones.

use std::ffi::{CString, c_char};
use std::ptr::null;
use std::sync::LazyLock;

use edgecap_client::joints::JOINT_NAMES;
use edgecap_client::message::HUMANOID_BONES;

static JOINTS: LazyLock<Vec<CString>> = LazyLock::new(|| with_ends(&JOINT_NAMES));
static BONES: LazyLock<Vec<CString>> = LazyLock::new(|| with_ends(&HUMANOID_BONES));

/// Name of a joint, such as `r_wrist`; null for numbers that are none.
#[unsafe(no_mangle)]
pub extern "C" fn edgecap_joint_name(joint: u32) -> *const c_char {
    JOINTS.get(joint as usize).map_or(null(), |n| n.as_ptr())
}

/// VRM / Unity name of a bone, such as `rightLowerArm`; null for numbers that are none.
#[unsafe(no_mangle)]
pub extern "C" fn edgecap_bone_name(bone: u32) -> *const c_char {
    BONES.get(bone as usize).map_or(null(), |n| n.as_ptr())
}

fn with_ends(names: &[&str]) -> Vec<CString> {
    let with_end = |n: &&str| CString::new(*n).expect("names hold no zero bytes");
    names.iter().map(with_end).collect()
}
