"""The messages, field for field as `clients/rust/src/message` lays them out.

A test of the Rust client compares sizes and offsets with these."""

from __future__ import annotations

import ctypes
from ctypes import c_float, c_uint8, c_uint32, c_uint64
from typing import TYPE_CHECKING, Any, ClassVar, Final

from . import arrays
from .names import ANGLE_NAMES, BODY_JOINTS, DOF, EVIDENCE_JOINTS, HUMANOID_BONES, JOINT_NAMES, index
from .world import Quaternion, Vector, World, WorldBody

if TYPE_CHECKING:
    from numpy.typing import NDArray

MAX_PEOPLE: Final = 32
APPEARANCE_BINS: Final = 30
FLAG_END_OF_STREAM: Final = 1
"""Bit of `flags`: the input has ended, this message holds nobody new."""
FLAG_FILE_TIME: Final = 2
"""Bit of `flags`: `capture_ns` is a file's presentation time, not CLOCK_MONOTONIC."""
STATES: Final = ("tentative", "tracked", "predicted")
JOINT_STATES: Final = ("predicted", "occluded", "observed")

Row = ctypes.Array[c_float]
Table = ctypes.Array[ctypes.Array[c_float]]


class Intrinsics(ctypes.Structure):
    """Pinhole camera of the original picture, pixels."""

    _fields_: ClassVar = [("fx", c_float), ("fy", c_float), ("cx", c_float), ("cy", c_float)]

    fx: float
    fy: float
    cx: float
    cy: float

    def __repr__(self) -> str:
        return f"Intrinsics(fx={self.fx:.1f}, fy={self.fy:.1f}, cx={self.cx:.1f}, cy={self.cy:.1f})"


class StageTimes(ctypes.Structure):
    """Microseconds spent per stage of `infer`."""

    _fields_: ClassVar = [(n, c_uint32) for n in ("preprocess_us", "stage1_us", "association_us", "stage2_us")]

    preprocess_us: int
    stage1_us: int
    association_us: int
    stage2_us: int

    def __repr__(self) -> str:
        return (
            f"StageTimes(preprocess={self.preprocess_us}, stage1={self.stage1_us}, association={self.association_us}, "
            f"stage2={self.stage2_us} us)"
        )


class _Person(ctypes.Structure):
    """What bodies and observations have in common."""

    def array(self, field: str) -> NDArray[Any]:
        """A field as a NumPy array over this message's memory: no copy.  `state` and `joint_states` give codes.

        Raises `UnknownName`; `ImportError` where NumPy is not installed.
        """
        return arrays.view(self, field)


class Observation(_Person):
    """One person as seen in one frame, before the fit."""

    _fields_: ClassVar = [
        ("score", c_float),
        ("joints2d", c_float * 3 * EVIDENCE_JOINTS),
        ("joints3d", c_float * 3 * BODY_JOINTS),
        ("hue", c_float * APPEARANCE_BINS),
        ("saturation", c_float * APPEARANCE_BINS),
    ]

    score: float
    """Probability that somebody is there, 0-1."""
    joints2d: Table
    """Evidence joints: u, v in pixels, confidence: the probability of being within 0.2 of the torso's length of the truth.
    Of confidence 0: not seen, u and v are where it is expected."""
    joints3d: Table
    """Body joints relative to the pelvis, camera axes, metres, of the person rescaled to 1.70 m."""
    hue: Row
    saturation: Row

    def __repr__(self) -> str:
        seen = sum(1 for joint in self.joints2d if joint[2] > 0)
        return f"Observation(score={self.score:.2f}, {seen} of {EVIDENCE_JOINTS} joints seen)"


class Body(_Person):
    """One person with an identity."""

    _fields_: ClassVar = [
        ("id", c_uint32),
        ("_state", c_uint32),
        ("score", c_float),
        ("position", c_float * 3),
        ("orientation", c_float * 4),
        ("velocity", c_float * 3),
        ("angles", c_float * DOF),
        ("joints3d", c_float * 3 * BODY_JOINTS),
        ("joints2d", c_float * 2 * BODY_JOINTS),
        ("confidence", c_float * BODY_JOINTS),
        ("height", c_float),
        ("bone_lengths", c_float * BODY_JOINTS),
        ("bone_rotations", c_float * 4 * len(HUMANOID_BONES)),
        ("_joint_states", c_uint8 * BODY_JOINTS),
        ("_reserved", c_uint8 * 3),
    ]

    id: int
    """Identity, from 1, never given twice while `run` runs, or `fit` alone."""
    score: float
    """Overall confidence, 0-1."""
    position: Row
    """Pelvis in camera space, metres."""
    orientation: Row
    """Of the pelvis, from rest axes (x to the person's left, y up, z to the front) to camera axes, xyzw."""
    velocity: Row
    """Of the pelvis in camera space, metres per second."""
    angles: Row
    """In the order of `ANGLE_NAMES`: metres, then radians."""
    joints3d: Table
    """Camera space, metres, in the order of `JOINT_NAMES`."""
    joints2d: Table
    """`joints3d` projected into the original picture, pixels; 0, 0 of joints behind the camera."""
    confidence: Row
    """Probability that a joint is within 150 mm of the truth, 0-1."""
    height: float
    """Stature, metres."""
    bone_lengths: Row
    """Of the bone that ends in each joint, metres; 0 for the pelvis."""
    bone_rotations: Table
    """Local, in the order of `HUMANOID_BONES`, xyzw, from a T-pose with axes x left, y up, z front."""
    _state: int
    _joint_states: ctypes.Array[c_uint8]

    @property
    def state(self) -> str:
        """`tracked`: seen in this frame; or `predicted`."""
        return STATES[self._state] if self._state < len(STATES) else STATES[0]

    @property
    def joint_states(self) -> tuple[str, ...]:
        """`observed`, `occluded` or `predicted`, in the order of `JOINT_NAMES`."""
        return tuple(map(_joint_state, self._joint_states))

    def joint(self, name: str) -> Vector:
        """A joint in camera space, metres."""
        x, y, z = self.joints3d[index("joint", name, JOINT_NAMES)]
        return (x, y, z)

    def joint2d(self, name: str) -> tuple[float, float]:
        """A joint in the original picture, pixels."""
        u, v = self.joints2d[index("joint", name, JOINT_NAMES)]
        return (u, v)

    def joint_state(self, name: str) -> str:
        """`observed`, `occluded` or `predicted`."""
        return _joint_state(self._joint_states[index("joint", name, JOINT_NAMES)])

    def joint_confidence(self, name: str) -> float:
        """Probability that a joint is within 150 mm of the truth, 0-1."""
        return float(self.confidence[index("joint", name, JOINT_NAMES)])

    def angle(self, name: str) -> float:
        """One of `ANGLE_NAMES`, radians; metres for `pelvis_tx`, `pelvis_ty`, `pelvis_tz`."""
        return float(self.angles[index("angle", name, ANGLE_NAMES)])

    def named_angles(self) -> dict[str, float]:
        """All of `ANGLE_NAMES`."""
        return dict(zip(ANGLE_NAMES, self.angles))

    def bone_length(self, name: str) -> float:
        """Length of the bone that ends in a joint, metres."""
        return float(self.bone_lengths[index("joint", name, JOINT_NAMES)])

    def bone_rotation(self, name: str) -> Quaternion:
        """Local rotation of a VRM / Unity humanoid bone, xyzw."""
        x, y, z, w = self.bone_rotations[index("bone", name, HUMANOID_BONES)]
        return (x, y, z, w)

    def __repr__(self) -> str:
        x, y, z = self.position
        return (
            f"Body(id={self.id}, {self.state}, score={self.score:.2f}, pelvis at ({x:.2f}, {y:.2f}, {z:.2f}) m, "
            f"height {self.height:.2f} m)"
        )


class ObservationFrame(ctypes.Structure):
    """Everyone seen in one frame."""

    _fields_: ClassVar = [
        ("sequence", c_uint64),
        ("capture_ns", c_uint64),
        ("publish_ns", c_uint64),
        ("width", c_uint32),
        ("height", c_uint32),
        ("intrinsics", Intrinsics),
        ("stage_times", StageTimes),
        ("flags", c_uint32),
        ("without_neck", c_uint32),
        ("count", c_uint32),
        ("frame_total", c_uint32),
        ("_people", Observation * MAX_PEOPLE),
    ]

    sequence: int
    """Counts the frames of the input from 0; gaps are dropped frames."""
    capture_ns: int
    publish_ns: int
    width: int
    height: int
    intrinsics: Intrinsics
    stage_times: StageTimes
    flags: int
    without_neck: int
    """People left out because their neck was not found: whole arms or legs that belong to nobody."""
    count: int
    frame_total: int
    """Frames of the input; 0 where not known."""
    _people: ctypes.Array[Observation]

    @staticmethod
    def type_name() -> str:
        """What iceoryx2 calls it."""
        return "EdgecapObservationFrameV1"

    def people(self) -> list[Observation]:
        """The valid people."""
        return list(self._people[: self.count])

    def array(self, field: str) -> NDArray[Any]:
        """A field of all people as one NumPy array over this message's memory, people along the first axis."""
        return arrays.view_of_all(self._people, self.count, field)

    def __repr__(self) -> str:
        return f"ObservationFrame(sequence={self.sequence}, {self.count} people, {self.width}x{self.height})"


class BodyFrame(ctypes.Structure):
    """Everyone with an identity."""

    _fields_: ClassVar = [
        ("sequence", c_uint64),
        ("capture_ns", c_uint64),
        ("pose_ns", c_uint64),
        ("publish_ns", c_uint64),
        ("width", c_uint32),
        ("height", c_uint32),
        ("intrinsics", Intrinsics),
        ("stage_times", StageTimes),
        ("fit_us", c_uint32),
        ("flags", c_uint32),
        ("count", c_uint32),
        ("frame_total", c_uint32),
        ("world", World),
        ("_bodies", Body * MAX_PEOPLE),
    ]

    sequence: int
    """Of the newest picture behind this frame, from 0; gaps are dropped frames."""
    capture_ns: int
    """When that picture was taken."""
    pose_ns: int
    """The time the bodies are given for."""
    publish_ns: int
    """When this frame was published; minus `capture_ns` it is the latency."""
    width: int
    height: int
    intrinsics: Intrinsics
    stage_times: StageTimes
    fit_us: int
    """Identity and fit, microseconds."""
    flags: int
    count: int
    frame_total: int
    """Frames of the input; 0 where not known."""
    world: World
    _bodies: ctypes.Array[Body]

    @staticmethod
    def type_name() -> str:
        """What iceoryx2 calls it."""
        return "EdgecapBodyFrameV2"

    def people(self) -> list[Body]:
        """The valid bodies, by rising id."""
        return list(self._bodies[: self.count])

    def array(self, field: str) -> NDArray[Any]:
        """A field of all bodies as one NumPy array over this message's memory, people along the first axis:
        `frame.array("joints3d")` is [people, 21, 3]."""
        return arrays.view_of_all(self._bodies, self.count, field)

    def in_world(self, body: Body) -> WorldBody | None:
        """A body of this frame in the floor-aligned world; None while there is no floor."""
        if self.world.state == "none":
            return None
        return WorldBody(
            position=self.world.point(body.position),
            orientation=self.world.orientation(body.orientation),
            velocity=self.world.direction(body.velocity),
            joints3d=[self.world.point(p) for p in body.joints3d],
        )

    def __repr__(self) -> str:
        ids = ", ".join(f"#{body.id}" for body in self.people()) or "nobody"
        return f"BodyFrame(sequence={self.sequence}, {ids}, {self.width}x{self.height}, {self.world!r})"


def _joint_state(code: int) -> str:
    return JOINT_STATES[code] if code < len(JOINT_STATES) else JOINT_STATES[0]
