//! V4L2 cameras: a device file goes in, the newest picture comes out, for as long as the program runs.
//!
//! [`CameraSource`] holds the [`Live`] state machine, which opens and reopens a [`CameraPort`]. [`V4l2Port`] is the
//! real one, and holds the [lock](InstanceLock) of the device that it has opened.

mod controls;
mod identity;
mod list;
mod live;
mod lock;
mod mode;
mod options;
mod port;
mod refusal;
mod source;
#[allow(unsafe_code, reason = "the kernel's camera interface: ioctl and mmap")]
mod v4l2;

pub use controls::{ControlSetting, list_controls};
pub use list::{CameraInfo, list_cameras};
pub use live::{CameraPort, CameraStream, Live, Step};
pub use lock::InstanceLock;
pub use mode::{Mode, choose_mode};
pub use options::OpenOptions;
pub use port::V4l2Port;
pub use source::CameraSource;
