//! The message contract: what `infer` publishes to `fit`, and what `fit` publishes to local apps.
//!
//! Every type is `#[repr(C)]`, has no pointers, no padding and a fixed size, and is valid for all bit patterns, so that C and
//! Python read it through a plain struct. Camera frame: x right, y down, z forward, metres; pixels are those of the original
//! picture, pixel centres on integers; quaternions are xyzw. Times are CLOCK_MONOTONIC nanoseconds.

use iceoryx2::prelude::ZeroCopySend;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::joints::{BODY_JOINTS, DOF, EVIDENCE_JOINTS};
pub use crate::joints::{HUMANOID_BONE_COUNT, HUMANOID_BONES};

/// Most people in one message; further ones, lowest scores first, are left out.
pub const MAX_PEOPLE: usize = 32;
/// Bins of each appearance histogram (hue, saturation). XNect §5.1.
pub const APPEARANCE_BINS: usize = 30;
/// Bit of [`ObservationFrame::flags`] and [`BodyFrame::flags`]: the input has ended, this message holds no new people.
pub const FLAG_END_OF_STREAM: u32 = 1;
/// Bit of the flags: `capture_ns` is a file's presentation time, not CLOCK_MONOTONIC.
pub const FLAG_FILE_TIME: u32 = 2;

/// Pinhole camera of the original picture, pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend, FromBytes, IntoBytes, Immutable)]
#[type_name("EdgecapIntrinsicsV1")]
#[repr(C)]
pub struct Intrinsics {
    /// Horizontal focal length.
    pub fx: f32,
    /// Vertical focal length.
    pub fy: f32,
    /// Principal point, u.
    pub cx: f32,
    /// Principal point, v.
    pub cy: f32,
}

impl Intrinsics {
    /// Square pixels, principal point in the centre, the given horizontal field of view.
    pub fn from_horizontal_fov(width: u32, height: u32, fov_degrees: f32) -> Self {
        let f = 0.5 * width as f32 / (0.5 * fov_degrees.to_radians()).tan();
        Self {
            fx: f,
            fy: f,
            cx: 0.5 * (width as f32 - 1.0),
            cy: 0.5 * (height as f32 - 1.0),
        }
    }

    /// Pixel of a camera-space point (metres); meaningless for z ≤ 0.
    pub fn project(&self, p: [f32; 3]) -> [f32; 2] {
        [
            self.fx * p[0] / p[2] + self.cx,
            self.fy * p[1] / p[2] + self.cy,
        ]
    }

    /// Unit vector from the camera centre through a pixel.
    pub fn ray(&self, u: f32, v: f32) -> [f32; 3] {
        let (x, y) = ((u - self.cx) / self.fx, (v - self.cy) / self.fy);
        let n = (x * x + y * y + 1.0).sqrt().recip();
        [x * n, y * n, n]
    }
}

/// Time spent on a frame in each stage of `infer`, microseconds.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend, FromBytes, IntoBytes, Immutable,
)]
#[type_name("EdgecapStageTimesV1")]
#[repr(C)]
pub struct StageTimes {
    /// Letterbox to the network's input.
    pub preprocess_us: u32,
    /// Stage I network.
    pub stage1_us: u32,
    /// Peaks, limbs, people.
    pub association_us: u32,
    /// Stage II network and appearance.
    pub stage2_us: u32,
}

/// One person as seen in one frame: Stage II's output.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend, FromBytes, IntoBytes, Immutable)]
#[type_name("EdgecapObservationV1")]
#[repr(C)]
pub struct Observation {
    /// How well the joints can be expected to fit somebody who is there: expected object keypoint similarity, 0–1.
    pub score: f32,
    /// Evidence joints: u, v in pixels of the original picture, confidence 0–1. Confidence 0: not seen; u and v are where Stage
    /// II's body has the joint once it is placed over the seen ones, or 0, 0 where that is not known.
    pub joints2d: [[f32; 3]; EVIDENCE_JOINTS],
    /// Body joints relative to the pelvis, camera axes, metres, of the person rescaled to
    /// [`CANONICAL_STATURE`](crate::joints::CANONICAL_STATURE). Complete: unseen joints are filled in by Stage II.
    pub joints3d: [[f32; 3]; BODY_JOINTS],
    /// Hue histogram of the torso, sums to 1; all zero when the torso was not seen.
    pub hue: [f32; APPEARANCE_BINS],
    /// Saturation histogram of the torso, sums to 1; all zero when the torso was not seen.
    pub saturation: [f32; APPEARANCE_BINS],
}

impl Default for Observation {
    fn default() -> Self {
        Self {
            score: 0.0,
            joints2d: [[0.0; 3]; EVIDENCE_JOINTS],
            joints3d: [[0.0; 3]; BODY_JOINTS],
            hue: [0.0; APPEARANCE_BINS],
            saturation: [0.0; APPEARANCE_BINS],
        }
    }
}

/// Everyone seen in one frame: `infer` → `fit`.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend, FromBytes, IntoBytes, Immutable)]
#[type_name("EdgecapObservationFrameV1")]
#[repr(C)]
pub struct ObservationFrame {
    /// Counts the frames of this input from 0; gaps are dropped frames.
    pub sequence: u64,
    /// When the picture was taken.
    pub capture_ns: u64,
    /// When this message was published.
    pub publish_ns: u64,
    /// Width of the original picture, pixels.
    pub width: u32,
    /// Height of the original picture, pixels.
    pub height: u32,
    /// Camera of the original picture.
    pub intrinsics: Intrinsics,
    /// Time spent per stage.
    pub stage_times: StageTimes,
    /// `FLAG_*` bits.
    pub flags: u32,
    /// People whose neck was not found and who were therefore left out.
    pub without_neck: u32,
    /// Valid entries of `people`.
    pub count: u32,
    /// Frames in the input; 0 when not known (cameras, pipes).
    pub frame_total: u32,
    /// The people, by falling score.
    pub people: [Observation; MAX_PEOPLE],
}

impl Default for ObservationFrame {
    fn default() -> Self {
        Self {
            sequence: 0,
            capture_ns: 0,
            publish_ns: 0,
            width: 0,
            height: 0,
            intrinsics: Intrinsics::default(),
            stage_times: StageTimes::default(),
            flags: 0,
            without_neck: 0,
            count: 0,
            frame_total: 0,
            people: [Observation::default(); MAX_PEOPLE],
        }
    }
}

impl ObservationFrame {
    /// The valid people.
    pub fn people(&self) -> &[Observation] {
        &self.people[..(self.count as usize).min(MAX_PEOPLE)]
    }
}

/// An enumeration in shared memory. Another process writes it, so any number may stand there: one that has no name here is
/// of a later version and equals none of the constants.
macro_rules! open_enum {
    ($(#[$doc:meta])* $name:ident: $number:ty { $($(#[$what:meta])* $constant:ident = $value:literal $text:literal,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, Hash, Default, ZeroCopySend, FromBytes, IntoBytes, Immutable)]
        #[repr(C)]
        pub struct $name($number);

        impl $name {
            $($(#[$what])* pub const $constant: Self = Self($value);)*

            /// What stands in the message.
            pub const fn code(self) -> $number {
                self.0
            }

            /// Its name in records and in the Python client; `None` of a number without one.
            pub const fn name(self) -> Option<&'static str> {
                match self {
                    $(Self::$constant => Some($text),)*
                    _ => None,
                }
            }
        }

        impl From<$number> for $name {
            fn from(code: $number) -> Self {
                Self(code)
            }
        }

        impl std::fmt::Debug for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                match self.name() {
                    Some(name) => f.write_str(name),
                    None => write!(f, "{}({})", stringify!($name), self.0),
                }
            }
        }
    };
}

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
    /// Identity, from 1, never reused while `fit` runs.
    pub id: u32,
    /// Whether it was seen in this frame.
    pub state: BodyState,
    /// Overall confidence, 0–1.
    pub score: f32,
    /// Pelvis in camera space, metres.
    pub position: [f32; 3],
    /// Rotation of the pelvis from the skeleton's rest axes to camera axes, xyzw. Rest axes: x to the person's left, y up,
    /// z to the front; an upright person who faces the camera has a half turn about x.
    pub orientation: [f32; 4],
    /// Pelvis velocity in camera space, metres per second.
    pub velocity: [f32; 3],
    /// Skeleton parameters: root translation (m), root rotation vector (rad), 23 joint angles (rad) in the order of
    /// `models/skeleton.toml`.
    pub angles: [f32; DOF],
    /// Joints in camera space, metres.
    pub joints3d: [[f32; 3]; BODY_JOINTS],
    /// `joints3d` projected into the original picture, pixels.
    pub joints2d: [[f32; 2]; BODY_JOINTS],
    /// Probability that a joint is within 150 mm of the truth, 0–1.
    pub confidence: [f32; BODY_JOINTS],
    /// Stature, metres.
    pub height: f32,
    /// Length of the bone that ends in each joint, metres, as the pose was solved with; 0 for the pelvis. With `angles` they
    /// give `joints3d`.
    pub bone_lengths: [f32; BODY_JOINTS],
    /// Local rotations for [`HUMANOID_BONES`], xyzw, from a T-pose with axes x left, y up, z front.
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

/// The floor-aligned world: x to the camera's right along the floor, y up, z towards the viewer (right-handed), metres, origin
/// on the floor below the camera. world = rotation · camera + translation.
///
/// An estimated world appears once enough feet have stood about. After that it turns by at most 0.5° and rises by at most 3 cm
/// a second. It is forgotten where the input starts over (another recording, a pause longer than the identities' memory) and
/// where the picture's size or intrinsics change.
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
    /// [`ObservationFrame::sequence`] of the newest frame behind this message.
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
    /// [`ObservationFrame::frame_total`].
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
