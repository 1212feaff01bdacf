//! What has happened in front of a camera: published beside the bodies, when something has.

use iceoryx2::prelude::ZeroCopySend;
use zerocopy::{FromBytes, Immutable, IntoBytes};

/// Most events in one message; what happens beside them comes with the next one, of the same frame.
pub const MAX_EVENTS: usize = 32;
/// Bytes of a zone's name, with the zero that ends it.
pub const ZONE_NAME: usize = 64;

open_enum! {
    /// What has happened.
    EventKind: u32 {
        /// Somebody is there for the first time.
        ENTERED = 0 "entered",
        /// Somebody is away; `seconds` they were there.
        LEFT = 1 "left",
        /// Somebody who had left is there again; `seconds` they were away.
        CAME_BACK = 2 "came_back",
        /// Somebody has stepped into a zone of the floor.
        ZONE_ENTERED = 3 "zone_entered",
        /// Somebody has stepped out of a zone, or left while in it; `seconds` they were in it.
        ZONE_LEFT = 4 "zone_left",
        /// Somebody has been in a zone for its `dwell`; `seconds` by now.
        DWELT = 5 "dwelt",
        /// A hand is above the head.
        HAND_RAISED = 6 "hand_raised",
        /// A raised hand is below the shoulder again.
        HAND_LOWERED = 7 "hand_lowered",
        /// A hand has gone to and fro.
        WAVED = 8 "waved",
        /// Another person is the nearest to the camera.
        MAIN_PERSON = 9 "main_person",
    }
}

open_enum! {
    /// The person's own left or right hand.
    Hand: u32 {
        /// It is no event of a hand.
        NONE = 0 "none",
        /// Left.
        LEFT = 1 "left",
        /// Right.
        RIGHT = 2 "right",
    }
}

/// Something that has happened, once it was certain.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend, FromBytes, IntoBytes, Immutable)]
#[type_name("EdgecapEventV1")]
#[repr(C)]
pub struct Event {
    /// What.
    pub kind: EventKind,
    /// [`Body::id`](super::Body::id) of whom it is about; 0 where nobody is the main person any more.
    pub person: u32,
    /// What the kind says of it; 0 where it says nothing.
    pub seconds: f32,
    /// Which hand, of what hands do.
    pub hand: Hand,
    /// Name of the zone in UTF-8, ended by a zero and filled up with zeros; empty where it is no event of a zone.
    pub zone: [u8; ZONE_NAME],
}

impl Default for Event {
    fn default() -> Self {
        Self {
            kind: EventKind::ENTERED,
            person: 0,
            seconds: 0.0,
            hand: Hand::NONE,
            zone: [0; ZONE_NAME],
        }
    }
}

impl Event {
    /// Name of the zone; empty where it is no event of a zone, or no text.
    pub fn zone(&self) -> &str {
        let end = self.zone.iter().position(|b| *b == 0);
        let name = &self.zone[..end.unwrap_or(ZONE_NAME)];
        core::str::from_utf8(name).unwrap_or_default()
    }

    /// Sets the name of the zone; one of [`ZONE_NAME`] bytes or more is cut.
    pub fn set_zone(&mut self, name: &str) {
        self.zone = [0; ZONE_NAME];
        let end = name.floor_char_boundary(ZONE_NAME - 1);
        self.zone[..end].copy_from_slice(&name.as_bytes()[..end]);
    }
}

/// What was certain by one frame of bodies. Without events no message comes.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend, FromBytes, IntoBytes, Immutable)]
#[type_name("EdgecapEventFrameV1")]
#[repr(C)]
pub struct EventFrame {
    /// [`BodyFrame::sequence`](super::BodyFrame::sequence) of that frame.
    pub sequence: u64,
    /// [`BodyFrame::pose_ns`](super::BodyFrame::pose_ns) of that frame.
    pub time_ns: u64,
    /// When this message was published.
    pub publish_ns: u64,
    /// Events of this publisher before those of this message: where it is more than a reader has had, it has lost some.
    pub first: u64,
    /// `FLAG_*` bits.
    pub flags: u32,
    /// Valid entries of `events`.
    pub count: u32,
    /// People who are there now.
    pub present: u32,
    /// The main person now; 0: nobody.
    pub main_person: u32,
    /// The events, in the order in which they were certain.
    pub events: [Event; MAX_EVENTS],
}

impl Default for EventFrame {
    fn default() -> Self {
        Self {
            sequence: 0,
            time_ns: 0,
            publish_ns: 0,
            first: 0,
            flags: 0,
            count: 0,
            present: 0,
            main_person: 0,
            events: [Event::default(); MAX_EVENTS],
        }
    }
}

/// Who and what, in a line: `#3 zone_left door, 4.2 s`.
impl core::fmt::Display for Event {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.person {
            0 => write!(f, "nobody {:?}", self.kind)?,
            person => write!(f, "#{person} {:?}", self.kind)?,
        }
        if self.hand != Hand::NONE {
            write!(f, " {:?}", self.hand)?;
        }
        if !self.zone().is_empty() {
            write!(f, " {}", self.zone())?;
        }
        match self.seconds {
            0.0 => Ok(()),
            seconds => write!(f, ", {seconds:.1} s"),
        }
    }
}

impl EventFrame {
    /// The valid events.
    pub fn events(&self) -> &[Event] {
        &self.events[..(self.count as usize).min(MAX_EVENTS)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_zone_s_name_is_cut_between_letters_and_read_back() {
        let mut event = Event::default();
        assert_eq!(event.zone(), "");
        event.set_zone("door");
        assert_eq!(event.zone(), "door");
        (event.person, event.kind, event.seconds) = (3, EventKind::ZONE_LEFT, 4.2);
        assert_eq!(event.to_string(), "#3 zone_left door, 4.2 s");
        let long = "ü".repeat(40);
        event.set_zone(&long);
        assert_eq!(event.zone(), "ü".repeat(31));
        event.zone = [0xff; ZONE_NAME];
        assert_eq!(event.zone(), "", "any bits are valid");
    }
}
