"""What has happened in front of a camera: the message of events, as `clients/rust/src/message/event.rs` lays it out."""

from __future__ import annotations

import ctypes
from ctypes import c_char, c_float, c_uint32, c_uint64
from typing import ClassVar, Final

MAX_EVENTS: Final = 32
ZONE_NAME: Final = 64
EVENTS: Final = (
    "entered",
    "left",
    "came_back",
    "zone_entered",
    "zone_left",
    "dwelt",
    "hand_raised",
    "hand_lowered",
    "waved",
    "main_person",
)
"""What can happen; `docs/events.md` says when each does."""
HANDS: Final = ("none", "left", "right")


class Event(ctypes.Structure):
    """Something that has happened."""

    _fields_: ClassVar = [
        ("_kind", c_uint32),
        ("_person", c_uint32),
        ("seconds", c_float),
        ("_hand", c_uint32),
        ("_zone", c_char * ZONE_NAME),
    ]

    _kind: int
    _person: int
    seconds: float
    """How long they were there, away or in the zone; 0 where the event says nothing of it."""
    _hand: int
    _zone: bytes

    @property
    def event(self) -> str:
        """One of `EVENTS`; `unknown` of a later version."""
        return EVENTS[self._kind] if self._kind < len(EVENTS) else "unknown"

    @property
    def person(self) -> int | None:
        """Whom it is about, the `id` of a body; None where nobody is the main person any more."""
        return self._person or None

    @property
    def hand(self) -> str | None:
        """The person's own `left` or `right`, of what hands do."""
        return HANDS[self._hand] if 0 < self._hand < len(HANDS) else None

    @property
    def zone(self) -> str | None:
        """The zone's name, of what happens in zones."""
        return self._zone.decode(errors="replace") or None

    def __repr__(self) -> str:
        of = "".join(f", {part}" for part in (self.zone, self.hand) if part)
        long = f", {self.seconds:.1f} s" if self.seconds else ""
        return f"Event({self.event}, person {self.person}{of}{long})"


class EventFrame(ctypes.Structure):
    """What was certain by one frame of bodies.  Where nothing happens no message comes."""

    _fields_: ClassVar = [
        ("sequence", c_uint64),
        ("time_ns", c_uint64),
        ("publish_ns", c_uint64),
        ("first", c_uint64),
        ("flags", c_uint32),
        ("count", c_uint32),
        ("present", c_uint32),
        ("_main_person", c_uint32),
        ("_events", Event * MAX_EVENTS),
    ]

    sequence: int
    """`BodyFrame.sequence` of that frame."""
    time_ns: int
    """`BodyFrame.pose_ns` of that frame."""
    publish_ns: int
    first: int
    """Events of this publisher before these; where it is more than a reader has had, it has lost some."""
    flags: int
    count: int
    present: int
    """People who are there now."""
    _main_person: int
    _events: ctypes.Array[Event]

    @staticmethod
    def type_name() -> str:
        """What iceoryx2 calls it."""
        return "EdgecapEventFrameV1"

    @property
    def main_person(self) -> int | None:
        """The `id` of the main person now; None where nobody is."""
        return self._main_person or None

    def events(self) -> list[Event]:
        """The events, in the order in which they were certain."""
        return list(self._events[: self.count])

    def __repr__(self) -> str:
        return f"EventFrame(sequence={self.sequence}, {self.events()}, {self.present} present)"
