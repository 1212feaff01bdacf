"""How a camera is doing: the message of health, as `clients/rust/src/message/health.rs` lays it out."""

from __future__ import annotations

import ctypes
from ctypes import c_float, c_uint32, c_uint64
from typing import ClassVar, Final

HEALTH_STATES: Final = ("starting", "live", "idle", "stalled", "away", "ended")
"""What can have become of the pictures; `docs/clients.md` says what each means."""
PACES: Final = ("unknown", "keeps_up", "behind")


class HealthFrame(ctypes.Structure):
    """How a camera is doing, or a room of several, or a film.  `publish_ns`, `started_ns` and `since_ns` are
    CLOCK_MONOTONIC nanoseconds, of files, too."""

    _fields_: ClassVar = [
        ("publish_ns", c_uint64),
        ("started_ns", c_uint64),
        ("since_ns", c_uint64),
        ("sequence", c_uint64),
        ("capture_ns", c_uint64),
        ("observed", c_uint64),
        ("left_out", c_uint64),
        ("_state", c_uint32),
        ("flags", c_uint32),
        ("source_hz", c_float),
        ("observed_hz", c_float),
        ("look_hz", c_float),
        ("latency_us", c_uint32),
        ("_pace", c_uint32),
        ("people", c_uint32),
        ("input_width", c_uint32),
        ("input_height", c_uint32),
        ("reconnects", c_uint32),
        ("restarts", c_uint32),
        ("cameras", c_uint32),
        ("cameras_live", c_uint32),
    ]

    publish_ns: int
    """While somebody publishes and none has come for several seconds, that process hangs."""
    started_ns: int
    """When the process that tells began to: what is counted is counted from then on."""
    since_ns: int
    """Since when the state is what it is."""
    sequence: int
    """Of the newest picture."""
    capture_ns: int
    """When that was taken; 0 before the first."""
    observed: int
    """Pictures of which was published who is in them."""
    left_out: int
    """Pictures that the camera took between those: dropped, or left out on purpose; 0 of files."""
    _state: int
    flags: int
    source_hz: float
    """Pictures a second that the camera takes; 0 where that is not known."""
    observed_hz: float
    """Pictures a second of which is published who is in them."""
    look_hz: float
    """Pictures a second that the network looks at."""
    latency_us: int
    """From capture to the publication of observations, of a room to that of bodies, microseconds, median; 0 where that
    is not known."""
    _pace: int
    people: int
    """People in the newest picture; 0 while none comes."""
    input_width: int
    """Of the network's input for a whole picture, pixels; 0 before the first look."""
    input_height: int
    reconnects: int
    """How often the camera came back."""
    restarts: int
    """How often `run` has started this process again."""
    cameras: int
    """Cameras that this is about: of a room all that belong to it."""
    cameras_live: int
    """Those of them whose pictures come."""

    @staticmethod
    def type_name() -> str:
        """What iceoryx2 calls it."""
        return "EdgecapHealthFrameV1"

    @property
    def state(self) -> str:
        """One of `HEALTH_STATES`; `unknown` of a later version."""
        return HEALTH_STATES[self._state] if self._state < len(HEALTH_STATES) else "unknown"

    @property
    def pace(self) -> str:
        """`keeps_up` or `behind`; `unknown` where that is not told."""
        return PACES[self._pace] if self._pace < len(PACES) else "unknown"

    @property
    def state_seconds(self) -> float:
        """For how long the state is what it is by the time of this message."""
        return max(0, self.publish_ns - self.since_ns) * 1e-9

    def __str__(self) -> str:
        told = f"{self.state} for {self.state_seconds:.0f} s"
        if self.state not in ("live", "idle"):
            return told
        of = f" of {self.source_hz:.1f}" if self.source_hz > 0 else ""
        behind = " (behind)" if self.pace == "behind" else ""
        latency = f", {self.latency_us / 1000:.0f} ms" if self.latency_us else ""
        people = "person" if self.people == 1 else "people"
        return f"{told}, {self.observed_hz:.1f}{of} pictures a second{behind}{latency}, {self.people} {people}"

    def __repr__(self) -> str:
        return f"HealthFrame({self})"
