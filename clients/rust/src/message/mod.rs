//! The message contract: what `infer` publishes to `fit`, what `fit` publishes to local apps, bodies and events, and
//! what both say of themselves.
//!
//! Every type is `#[repr(C)]`, has no pointers, no padding and a fixed size, and is valid for all bit patterns, so that
//! C and Python read it through a plain struct. Camera frame: x right, y down, z forward, metres; pixels are those of
//! the original picture, pixel centres on integers; quaternions are xyzw. Times are CLOCK_MONOTONIC nanoseconds.

use iceoryx2::prelude::ZeroCopySend;
use zerocopy::{FromBytes, Immutable, IntoBytes};

pub use crate::joints::{HUMANOID_BONE_COUNT, HUMANOID_BONES};

/// An enumeration in shared memory. Another process writes it, so any number may stand there: one that has no name here
/// is of a later version and equals none of the constants.
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

mod body;
mod event;
mod health;
mod observation;
mod picture;

pub use body::{Body, BodyFrame, BodyState, JointState, World, WorldState};
pub use event::{Event, EventFrame, EventKind, Hand, MAX_EVENTS, ZONE_NAME};
pub use health::{HealthFrame, HealthPace, HealthState};
pub use observation::{Observation, ObservationFrame};
pub use picture::{MAX_PICTURE, PictureFrame};

/// Most people in one message; further ones, lowest scores first, are left out.
pub const MAX_PEOPLE: usize = 32;
/// Bins of each appearance histogram (hue, saturation). XNect §5.1.
pub const APPEARANCE_BINS: usize = 30;
/// Bit of the `flags` of every message: the input has ended, this message holds nothing new.
pub const FLAG_END_OF_STREAM: u32 = 1;
/// Bit of the flags: `capture_ns`, `pose_ns` and `time_ns` are a file's presentation time, not CLOCK_MONOTONIC.
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
