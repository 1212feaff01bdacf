//! What `fit` publishes to local apps: everybody, and the floor.

use iceoryx2::prelude::ZeroCopySend;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use super::{Intrinsics, MAX_PEOPLE, StageTimes};
use crate::joints::{BODY_JOINTS, DOF, HUMANOID_BONE_COUNT};

open_enum! {
    /// How a track is doing.
    BodyState: u32 {
        /// Seen in this frame, identity not yet confirmed. Not published.
        TENTATIVE = 0 "tentative",
        /// Seen in this frame.
        TRACKED = 1 "tracked",
        /// Not seen in this frame, extrapolated.
        PREDICTED = 2 "predicted",
    }
}

open_enum! {
    /// Where a joint's position comes from.
    JointState: u8 {
        /// Filled in by motion alone: the person was not seen in this frame.
        PREDICTED = 0 "predicted",
        /// Filled in from the person's other joints.
        OCCLUDED = 1 "occluded",
        /// Seen in this frame.
        OBSERVED = 2 "observed",
    }
}

/// One person with an identity: Stage III's output.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend, FromBytes, IntoBytes, Immutable)]
#[type_name("EdgecapBodyV1")]
#[repr(C)]
pub struct Body {
    /// Identity, from 1, never given twice while `run` runs, or `fit` alone.
    pub id: u32,
    /// Whether it was seen in this frame.
    pub state: BodyState,
    /// Overall confidence, 0–1.
    pub score: f32,
    /// Pelvis in camera space, metres.
    pub position: [f32; 3],
    /// Rotation of the pelvis from the skeleton's rest axes to camera axes, xyzw. Rest axes: x to the person's left, y
    /// up, z to the front; an upright person who faces the camera has a half turn about x.
    pub orientation: [f32; 4],
    /// Pelvis velocity in camera space, metres per second.
    pub velocity: [f32; 3],
    /// Skeleton parameters: root translation (m), root rotation vector (rad), 23 joint angles (rad) in the order of
    /// `models/skeleton.toml`.
    pub angles: [f32; DOF],
    /// Joints in camera space, metres.
    pub joints3d: [[f32; 3]; BODY_JOINTS],
    /// `joints3d` projected into the original picture, pixels; 0, 0 of joints behind the camera.
    pub joints2d: [[f32; 2]; BODY_JOINTS],
    /// Probability that a joint is within 150 mm of the truth, 0–1.
    pub confidence: [f32; BODY_JOINTS],
    /// Stature, metres.
    pub height: f32,
    /// Length of the bone that ends in each joint, metres, as the pose was solved with; 0 for the pelvis. With `angles`
    /// they give `joints3d`.
    pub bone_lengths: [f32; BODY_JOINTS],
    /// Local rotations for [`HUMANOID_BONES`](crate::joints::HUMANOID_BONES), xyzw, from a T-pose with axes x left, y
    /// up, z front.
    pub bone_rotations: [[f32; 4]; HUMANOID_BONE_COUNT],
    /// Where each joint's position comes from.
    pub joint_states: [JointState; BODY_JOINTS],
    /// Zeros, so that no byte of a message is undefined.
    pub reserved: [u8; 3],
}

impl Default for Body {
    fn default() -> Self {
        Self {
            id: 0,
            state: BodyState::TENTATIVE,
            score: 0.0,
            position: [0.0; 3],
            orientation: [0.0, 0.0, 0.0, 1.0],
            velocity: [0.0; 3],
            angles: [0.0; DOF],
            joints3d: [[0.0; 3]; BODY_JOINTS],
            joints2d: [[0.0; 2]; BODY_JOINTS],
            confidence: [0.0; BODY_JOINTS],
            height: 0.0,
            bone_lengths: [0.0; BODY_JOINTS],
            bone_rotations: [[0.0, 0.0, 0.0, 1.0]; HUMANOID_BONE_COUNT],
            joint_states: [JointState::PREDICTED; BODY_JOINTS],
            reserved: [0; 3],
        }
    }
}

open_enum! {
    /// Where the floor of a [`World`] comes from.
    WorldState: u32 {
        /// No floor is known: there is no world.
        NONE = 0 "none",
        /// The floor was found from standing feet; it is as large or small as the heights that people are taken for.
        ESTIMATED = 1 "estimated",
        /// The floor is given by the settings.
        GIVEN = 2 "given",
    }
}

/// The floor-aligned world: x to the camera's right along the floor, y up, z towards the viewer (right-handed), metres,
/// origin on the floor below the camera. world = rotation · camera + translation.
///
/// An estimated world appears once enough feet have stood about. After that it turns by at most 0.5° and rises by at
/// most 3 cm a second. It is forgotten where the input starts over (another recording, a pause longer than the
/// identities' memory) and where the picture's size or intrinsics change.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend, FromBytes, IntoBytes, Immutable)]
#[type_name("EdgecapWorldV1")]
#[repr(C)]
pub struct World {
    /// Rotation from camera axes to world axes, xyzw.
    pub rotation: [f32; 4],
    /// The camera in the world: (0, its height above the floor, 0), metres.
    pub translation: [f32; 3],
    /// Where the floor comes from; without a world rotation and translation are those of no motion.
    pub state: WorldState,
}

impl Default for World {
    fn default() -> Self {
        Self {
            rotation: [0.0, 0.0, 0.0, 1.0],
            translation: [0.0; 3],
            state: WorldState::NONE,
        }
    }
}

/// Everyone with an identity: `fit` → local apps.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend, FromBytes, IntoBytes, Immutable)]
#[type_name("EdgecapBodyFrameV2")]
#[repr(C)]
pub struct BodyFrame {
    /// [`ObservationFrame::sequence`](super::ObservationFrame::sequence) of the newest frame behind this message; goes
    /// on where `infer` was started again and its numbers began anew.
    pub sequence: u64,
    /// When that picture was taken.
    pub capture_ns: u64,
    /// The time the bodies are given for; later than `capture_ns` when extrapolated.
    pub pose_ns: u64,
    /// When this message was published; minus `capture_ns` it is the latency of every body in it.
    pub publish_ns: u64,
    /// Width of the original picture, pixels.
    pub width: u32,
    /// Height of the original picture, pixels.
    pub height: u32,
    /// Camera of the original picture.
    pub intrinsics: Intrinsics,
    /// Time spent per stage of `infer` on that picture.
    pub stage_times: StageTimes,
    /// Identity and fit, microseconds.
    pub fit_us: u32,
    /// `FLAG_*` bits.
    pub flags: u32,
    /// Valid entries of `bodies`.
    pub count: u32,
    /// [`ObservationFrame::frame_total`](super::ObservationFrame::frame_total).
    pub frame_total: u32,
    /// The floor-aligned world; [`BodyFrame::in_world`] takes bodies there.
    pub world: World,
    /// The bodies, by rising id.
    pub bodies: [Body; MAX_PEOPLE],
}

impl Default for BodyFrame {
    fn default() -> Self {
        Self {
            sequence: 0,
            capture_ns: 0,
            pose_ns: 0,
            publish_ns: 0,
            width: 0,
            height: 0,
            intrinsics: Intrinsics::default(),
            stage_times: StageTimes::default(),
            fit_us: 0,
            flags: 0,
            count: 0,
            frame_total: 0,
            world: World::default(),
            bodies: [Body::default(); MAX_PEOPLE],
        }
    }
}

impl BodyFrame {
    /// The valid bodies.
    pub fn bodies(&self) -> &[Body] {
        &self.bodies[..(self.count as usize).min(MAX_PEOPLE)]
    }
}
