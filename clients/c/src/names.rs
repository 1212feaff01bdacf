//! Names of joints, angles, bones, events and states, and what carries what.

use std::ffi::{CString, c_char, c_int};
use std::ptr::null;
use std::sync::LazyLock;

use edgecap_client::joints::{
    ANGLE_NAMES, COCO_JOINTS, COCO_KEYPOINTS, HUMANOID_BONES, HUMANOID_PARENTS, JOINT_NAMES,
    KINECT_JOINTS, KINECT_NAMES, PARENTS,
};
use edgecap_client::message::{EventKind, HealthPace, HealthState};

static JOINTS: LazyLock<Vec<CString>> = LazyLock::new(|| with_ends(&JOINT_NAMES));
static ANGLES: LazyLock<Vec<CString>> = LazyLock::new(|| with_ends(&ANGLE_NAMES));
static EVENTS: LazyLock<Vec<CString>> = LazyLock::new(|| numbered(|n| EventKind::from(n).name()));
static STATES: LazyLock<Vec<CString>> = LazyLock::new(|| numbered(|n| HealthState::from(n).name()));
static PACES: LazyLock<Vec<CString>> = LazyLock::new(|| numbered(|n| HealthPace::from(n).name()));
static BONES: LazyLock<Vec<CString>> = LazyLock::new(|| with_ends(&HUMANOID_BONES));
static COCO: LazyLock<Vec<CString>> = LazyLock::new(|| with_ends(&COCO_KEYPOINTS));
static KINECT: LazyLock<Vec<CString>> = LazyLock::new(|| with_ends(&KINECT_NAMES));

/// Name of a joint, such as `r_wrist`; null for numbers that are none.
#[unsafe(no_mangle)]
pub extern "C" fn edgecap_joint_name(joint: u32) -> *const c_char {
    JOINTS.get(joint as usize).map_or(null(), |n| n.as_ptr())
}

/// Name of a degree of freedom, such as `r_elbow_flexion`; null for numbers that are none.
#[unsafe(no_mangle)]
pub extern "C" fn edgecap_angle_name(angle: u32) -> *const c_char {
    ANGLES.get(angle as usize).map_or(null(), |n| n.as_ptr())
}

/// The joint that a joint's bone starts in, the pelvis for itself; −1 for numbers that are none.
#[unsafe(no_mangle)]
pub extern "C" fn edgecap_joint_parent(joint: u32) -> c_int {
    parent(&PARENTS, joint)
}

/// The bone that carries a bone, the hips for themselves; −1 for numbers that are none.
#[unsafe(no_mangle)]
pub extern "C" fn edgecap_bone_parent(bone: u32) -> c_int {
    parent(&HUMANOID_PARENTS, bone)
}

fn parent(parents: &[usize], of: u32) -> c_int {
    parents.get(of as usize).map_or(-1, |&p| p as c_int)
}

/// VRM / Unity name of a bone, such as `rightLowerArm`; null for numbers that are none.
#[unsafe(no_mangle)]
pub extern "C" fn edgecap_bone_name(bone: u32) -> *const c_char {
    BONES.get(bone as usize).map_or(null(), |n| n.as_ptr())
}

/// COCO's name of a keypoint, such as `left_wrist`; null for numbers that are none.
#[unsafe(no_mangle)]
pub extern "C" fn edgecap_coco_name(keypoint: u32) -> *const c_char {
    COCO.get(keypoint as usize).map_or(null(), |n| n.as_ptr())
}

/// The body joint for a keypoint of COCO; −1 in the face, and for numbers that are none.
#[unsafe(no_mangle)]
pub extern "C" fn edgecap_coco_joint(keypoint: u32) -> c_int {
    joint(&COCO_JOINTS, keypoint)
}

/// Azure Kinect's name of a joint, such as `WRIST_LEFT`; null for numbers that are none.
#[unsafe(no_mangle)]
pub extern "C" fn edgecap_kinect_name(joint: u32) -> *const c_char {
    KINECT.get(joint as usize).map_or(null(), |n| n.as_ptr())
}

/// The body joint for one of Azure Kinect's; −1 where there is none, and for numbers that are none.
#[unsafe(no_mangle)]
pub extern "C" fn edgecap_kinect_joint(kinect: u32) -> c_int {
    joint(&KINECT_JOINTS, kinect)
}

fn joint(joints: &[Option<usize>], of: u32) -> c_int {
    let joint = joints.get(of as usize).copied().flatten();
    joint.map_or(-1, |j| j as c_int)
}

/// Name of what has happened, such as `zone_entered`; null for numbers that are none.
#[unsafe(no_mangle)]
pub extern "C" fn edgecap_event_name(kind: u32) -> *const c_char {
    EVENTS.get(kind as usize).map_or(null(), |n| n.as_ptr())
}

/// Name of what has become of a camera's pictures, such as `away`; null for numbers that are none.
#[unsafe(no_mangle)]
pub extern "C" fn edgecap_health_state_name(state: u32) -> *const c_char {
    STATES.get(state as usize).map_or(null(), |n| n.as_ptr())
}

/// Name of whether the machine is fast enough, such as `behind`; null for numbers that are none.
#[unsafe(no_mangle)]
pub extern "C" fn edgecap_health_pace_name(pace: u32) -> *const c_char {
    PACES.get(pace as usize).map_or(null(), |n| n.as_ptr())
}

/// The names that numbers from 0 on have.
fn numbered(name: impl Fn(u32) -> Option<&'static str>) -> Vec<CString> {
    let names: Vec<&str> = (0..).map_while(name).collect();
    with_ends(&names)
}

fn with_ends(names: &[&str]) -> Vec<CString> {
    let with_end = |n: &&str| CString::new(*n).expect("names hold no zero bytes");
    names.iter().map(with_end).collect()
}
