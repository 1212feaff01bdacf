//! How a camera is doing: published at every change of its state and about once a second, also while it is away.

use iceoryx2::prelude::ZeroCopySend;
use zerocopy::{FromBytes, Immutable, IntoBytes};

open_enum! {
    /// What has become of the pictures.
    HealthState: u32 {
        /// None has come yet.
        STARTING = 0 "starting",
        /// They come and are gone through.
        LIVE = 1 "live",
        /// They come; nobody is in view, so that only a few are glanced at.
        IDLE = 2 "idle",
        /// None has come for a second, or for 2.5 intervals where that is longer, or none that can be decoded.
        STALLED = 3 "stalled",
        /// The camera is not there and is looked for, or sends pictures of another shape than its lens is for.
        AWAY = 4 "away",
        /// The input has ended, or the process that tells was asked to end or failed: nothing follows from it.
        ENDED = 5 "ended",
    }
}

open_enum! {
    /// Whether the machine is fast enough.
    HealthPace: u32 {
        /// Not told: of files, which wait, of rooms, of an empty place, and before a second has been measured.
        UNKNOWN = 0 "unknown",
        /// Of the pictures that come and are wanted nine in ten at least are gone through.
        KEEPS_UP = 1 "keeps_up",
        /// Fewer are: the others are dropped, and what is published is as new as ever.
        BEHIND = 2 "behind",
    }
}

/// How one camera is doing, as its `infer` knows it; of a room of several cameras, as `fit` does; of a file, as the one
/// process that goes through it.
///
/// `publish_ns`, `started_ns` and `since_ns` are CLOCK_MONOTONIC nanoseconds, of files, too.
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend, FromBytes, IntoBytes, Immutable)]
#[type_name("EdgecapHealthFrameV1")]
#[repr(C)]
pub struct HealthFrame {
    /// When this message was published. While somebody publishes and none has come for several seconds, that process
    /// hangs.
    pub publish_ns: u64,
    /// When the process that tells began to: what is counted below is counted from then on.
    pub started_ns: u64,
    /// Since when the state is what it is.
    pub since_ns: u64,
    /// [`ObservationFrame::sequence`](super::ObservationFrame::sequence) of the newest picture; of a room
    /// [`BodyFrame::sequence`](super::BodyFrame::sequence).
    pub sequence: u64,
    /// When that picture was taken; 0 before the first.
    pub capture_ns: u64,
    /// Pictures of which was published who is in them; of a room, instants.
    pub observed: u64,
    /// Pictures that the camera took between those, by its own count: dropped for want of time, or left out on purpose
    /// while nobody is in view or more than `--max-fps` come. 0 of files and rooms.
    pub left_out: u64,
    /// What has become of the pictures.
    pub state: HealthState,
    /// `FLAG_*` bits.
    pub flags: u32,
    /// Pictures a second that the camera takes, by its own times and count; of a film, its own rate. 0: not known.
    pub source_hz: f32,
    /// Pictures a second of which is published who is in them. 0 while none is.
    pub observed_hz: f32,
    /// Pictures a second of those that the network looks at: in the others people are followed, or nothing has changed.
    pub look_hz: f32,
    /// From capture to publication, microseconds: of observations, of a room of bodies. Median of the last pictures,
    /// 128 at most. 0: not known, as of files.
    pub latency_us: u32,
    /// Whether the machine is fast enough.
    pub pace: HealthPace,
    /// People in the newest picture; 0 while none comes.
    pub people: u32,
    /// Width of the network's input for a whole picture, pixels: it follows the people in view and the machine's speed.
    /// 0: not known, as before the first look.
    pub input_width: u32,
    /// Height of that input, pixels.
    pub input_height: u32,
    /// How often the camera came back after it was away.
    pub reconnects: u32,
    /// How often `run` has started this process again, since it died or hung; 0 without `run`.
    pub restarts: u32,
    /// Cameras that this message is about: 1, of a room all that belong to it.
    pub cameras: u32,
    /// Those of them whose pictures come.
    pub cameras_live: u32,
}

impl HealthFrame {
    /// For how long the state is what it is by the time of this message, seconds.
    pub fn state_seconds(&self) -> f32 {
        self.publish_ns.saturating_sub(self.since_ns) as f32 * 1e-9
    }
}

/// What and for how long, in a line: `live for 12 s, 29.9 of 30.0 pictures a second, 42 ms, 2 people`.
impl core::fmt::Display for HealthFrame {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{:?} for {:.0} s", self.state, self.state_seconds())?;
        if !matches!(self.state, HealthState::LIVE | HealthState::IDLE) {
            return Ok(());
        }
        write!(f, ", {:.1}", self.observed_hz)?;
        if self.source_hz > 0.0 {
            write!(f, " of {:.1}", self.source_hz)?;
        }
        f.write_str(" pictures a second")?;
        if self.pace == HealthPace::BEHIND {
            f.write_str(" (behind)")?;
        }
        if self.latency_us > 0 {
            write!(f, ", {:.0} ms", self.latency_us as f32 * 1e-3)?;
        }
        let word = if self.people == 1 { "person" } else { "people" };
        write!(f, ", {} {word}", self.people)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_what_there_is_to_say() {
        let mut health = HealthFrame {
            publish_ns: 13_000_000_000,
            since_ns: 1_000_000_000,
            state: HealthState::LIVE,
            source_hz: 30.0,
            observed_hz: 11.96,
            latency_us: 41_800,
            pace: HealthPace::BEHIND,
            people: 2,
            ..HealthFrame::default()
        };
        assert_eq!(
            health.to_string(),
            "live for 12 s, 12.0 of 30.0 pictures a second (behind), 42 ms, 2 people"
        );
        (health.source_hz, health.latency_us, health.people) = (0.0, 0, 1);
        (health.state, health.pace) = (HealthState::IDLE, HealthPace::UNKNOWN);
        let line = "idle for 12 s, 12.0 pictures a second, 1 person";
        assert_eq!(health.to_string(), line);
        health.state = HealthState::AWAY;
        assert_eq!(health.to_string(), "away for 12 s");
        health.state = 77.into();
        assert_eq!(health.to_string(), "HealthState(77) for 12 s");
    }
}
