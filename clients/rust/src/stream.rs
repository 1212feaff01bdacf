//! What a stream is called, in iceoryx2 and as files.

use std::path::{Path, PathBuf};

use iceoryx2::prelude::ZeroCopySend;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::error::LinkError;
use crate::message::{BodyFrame, EventFrame, HealthFrame, ObservationFrame, PictureFrame};

/// A message type with a stream of its own.
pub trait Message:
    ZeroCopySend + FromBytes + IntoBytes + Immutable + Copy + Default + core::fmt::Debug + 'static
{
    /// Last part of the service's name.
    const STREAM: &'static str;
    /// Version of its layout; part of the service's name, so that readers of another version never see it.
    const VERSION: u32;

    /// Its `FLAG_*` bits; none of a message that has none.
    fn flags(&self) -> u32 {
        0
    }

    /// Of a message that tells what is so at this moment: when it was published, CLOCK_MONOTONIC nanoseconds. `None` of
    /// one that stays true or holds until the next comes, and of one that does not say.
    fn told_ns(&self) -> Option<u64> {
        None
    }
}

impl Message for ObservationFrame {
    const STREAM: &'static str = "observations";
    const VERSION: u32 = 1;

    fn flags(&self) -> u32 {
        self.flags
    }

    fn told_ns(&self) -> Option<u64> {
        (self.publish_ns > 0).then_some(self.publish_ns)
    }
}

impl Message for BodyFrame {
    const STREAM: &'static str = "bodies";
    const VERSION: u32 = 2;

    fn flags(&self) -> u32 {
        self.flags
    }

    fn told_ns(&self) -> Option<u64> {
        (self.publish_ns > 0).then_some(self.publish_ns)
    }
}

impl Message for EventFrame {
    const STREAM: &'static str = "events";
    const VERSION: u32 = 1;

    fn flags(&self) -> u32 {
        self.flags
    }
}

impl Message for HealthFrame {
    const STREAM: &'static str = "health";
    const VERSION: u32 = 1;

    fn flags(&self) -> u32 {
        self.flags
    }

    fn told_ns(&self) -> Option<u64> {
        (self.publish_ns > 0).then_some(self.publish_ns)
    }
}

impl Message for PictureFrame {
    const STREAM: &'static str = "pictures";
    const VERSION: u32 = 1;

    fn flags(&self) -> u32 {
        self.flags
    }
}

/// Name of a camera's stream of `M`.
pub fn service_name<M: Message>(camera: &str) -> String {
    format!("edgecap/v{}/{camera}/{}", M::VERSION, M::STREAM)
}

/// Refuses camera names that cannot be part of a file's name.
pub(crate) fn check_camera(camera: &str) -> Result<(), LinkError> {
    let ok = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    if camera.is_empty() || camera.len() > 64 || !camera.chars().all(ok) {
        return Err(LinkError::Name(camera.to_owned()));
    }
    Ok(())
}

/// How the files of one camera's stream begin: the same for all versions of its messages, which exclude each other.
pub(crate) fn file_stem<M: Message>(camera: &str) -> String {
    format!("{camera}.{}", M::STREAM)
}

/// The stem of a stream's file, if it is one.
pub(crate) fn stem_of(file_name: &str) -> Option<&str> {
    let (first, rest) = file_name.split_once('.')?;
    let stream = rest.split('.').next()?;
    let is_stream = [
        ObservationFrame::STREAM,
        BodyFrame::STREAM,
        EventFrame::STREAM,
        HealthFrame::STREAM,
        PictureFrame::STREAM,
    ]
    .contains(&stream);
    let stem = &file_name[..first.len() + 1 + stream.len()];
    (is_stream && check_camera(first).is_ok() && stem.len() < file_name.len()).then_some(stem)
}

/// The file that holds a stream's newest messages.
pub(crate) fn ring_path<M: Message>(folder: &Path, camera: &str) -> PathBuf {
    folder.join(format!("{}.v{}", file_stem::<M>(camera), M::VERSION))
}

/// The version of a ring's file of the stream `stem`.
pub(crate) fn version_of(file_name: &str, stem: &str) -> Option<u32> {
    let version = file_name.strip_prefix(stem)?.strip_prefix(".v")?;
    version.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_streams_are_told_from_others() {
        assert_eq!(stem_of("camera0.bodies.v2"), Some("camera0.bodies"));
        assert_eq!(stem_of("a-b.observations.lock"), Some("a-b.observations"));
        assert_eq!(stem_of("camera0.health.v1"), Some("camera0.health"));
        for other in ["camera0.bodies", "bodies.v2", "lock", ".bodies.v2", "a.b.c"] {
            assert_eq!(stem_of(other), None, "{other}");
        }
        assert_eq!(version_of("c.bodies.v12", "c.bodies"), Some(12));
        assert_eq!(version_of("c.bodies.v12.new", "c.bodies"), None);
    }
}
