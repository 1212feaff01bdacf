"""Read edgecap's bodies from shared memory: `pip install iceoryx2==0.10.0`, then

    import edgecap
    for frame in edgecap.bodies("camera0"):
        for body in frame.people():
            print(body.id, list(body.position), body.joint("r_wrist"))

Where frames may fail to come, take them one by one: `stream = edgecap.bodies("camera0")`, `stream.next(timeout_s)` gives one
or None, and `stream.publishers` says whether anybody publishes (0 within a second of the publisher's death, 1 once it is back).

`frame.in_world(body)` gives a body in the floor-aligned world (y up, floor at y = 0) once a floor is known, else None.

Camera frame: x right, y down, z forward, metres; pixels of the original picture; quaternions xyzw; times CLOCK_MONOTONIC
nanoseconds.  The structures mirror `clients/rust/src/message.rs`, whose tests compare sizes and offsets with this file.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import time
from collections.abc import Iterator
from ctypes import c_float, c_uint8, c_uint32, c_uint64
from dataclasses import dataclass

MAX_PEOPLE, EVIDENCE_JOINTS, BODY_JOINTS, DOF, BINS, BONES = 32, 14, 21, 29, 30, 16
FLAG_END_OF_STREAM, FLAG_FILE_TIME = 1, 2
JOINT_NAMES = (
    "head_top neck r_shoulder r_elbow r_wrist l_shoulder l_elbow l_wrist r_hip r_knee r_ankle l_hip l_knee l_ankle "
    "pelvis spine head r_hand l_hand r_foot_tip l_foot_tip"
).split()
HUMANOID_BONES = (
    "hips spine neck head rightUpperArm rightLowerArm rightHand leftUpperArm leftLowerArm leftHand "
    "rightUpperLeg rightLowerLeg rightFoot leftUpperLeg leftLowerLeg leftFoot"
).split()
STATES = ("tentative", "tracked", "predicted")
JOINT_STATES = ("predicted", "occluded", "observed")
WORLD_STATES = ("none", "estimated", "given")


class Intrinsics(ctypes.Structure):
    """Pinhole camera of the original picture, pixels."""

    _fields_ = [("fx", c_float), ("fy", c_float), ("cx", c_float), ("cy", c_float)]


class StageTimes(ctypes.Structure):
    """Microseconds spent per stage of `infer`."""

    _fields_ = [(n, c_uint32) for n in ("preprocess_us", "stage1_us", "association_us", "stage2_us")]


class Observation(ctypes.Structure):
    """One person as seen in one frame, before the fit. A joint of confidence 0 was not seen: u, v are where it is expected."""

    _fields_ = [
        ("score", c_float),
        ("joints2d", c_float * 3 * EVIDENCE_JOINTS),
        ("joints3d", c_float * 3 * BODY_JOINTS),
        ("hue", c_float * BINS),
        ("saturation", c_float * BINS),
    ]


class ObservationFrame(ctypes.Structure):
    """Everyone seen in one frame."""

    _fields_ = [
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

    @staticmethod
    def type_name() -> str:
        return "EdgecapObservationFrameV1"

    def people(self) -> list[Observation]:
        """The valid people."""
        return list(self._people[: self.count])


class Body(ctypes.Structure):
    """One person with an identity."""

    _fields_ = [
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
        ("bone_rotations", c_float * 4 * BONES),
        ("_joint_states", c_uint8 * (BODY_JOINTS + 3)),
    ]

    @property
    def state(self) -> str:
        """`tracked` or `predicted`."""
        return STATES[self._state]

    def joint(self, name: str) -> tuple[float, float, float]:
        """A joint in camera space, metres."""
        return tuple(self.joints3d[JOINT_NAMES.index(name)])

    def joint_state(self, name: str) -> str:
        """`observed`, `occluded` or `predicted`."""
        return JOINT_STATES[self._joint_states[JOINT_NAMES.index(name)]]

    def bone_rotation(self, name: str) -> tuple[float, float, float, float]:
        """Local rotation of a VRM / Unity humanoid bone, xyzw."""
        return tuple(self.bone_rotations[HUMANOID_BONES.index(name)])


@dataclass(frozen=True)
class WorldBody:
    """A body in the floor-aligned world: x to the camera's right, y up, z towards the viewer, metres."""

    position: tuple[float, ...]
    """Pelvis."""
    orientation: tuple[float, ...]
    """Rotation of the pelvis from the skeleton's rest axes to world axes, xyzw; upright and facing the camera: identity."""
    velocity: tuple[float, ...]
    """Pelvis velocity, metres per second."""
    joints3d: list[tuple[float, ...]]

    def joint(self, name: str) -> tuple[float, ...]:
        """A joint, metres."""
        return self.joints3d[JOINT_NAMES.index(name)]


class World(ctypes.Structure):
    """The floor-aligned world: world = rotation * camera + translation, origin on the floor below the camera."""

    _fields_ = [("rotation", c_float * 4), ("translation", c_float * 3), ("_state", c_uint32)]

    @property
    def state(self) -> str:
        """`none`, `estimated` (from standing feet) or `given` (by the settings)."""
        return WORLD_STATES[self._state]

    def direction(self, v) -> tuple[float, ...]:
        """A direction or velocity given in camera axes."""
        x, y, z, w = self.rotation
        q = (x, y, z)
        inner = [c + w * a for c, a in zip(_cross(q, v), v)]
        return tuple(a + 2.0 * c for a, c in zip(v, _cross(q, inner)))

    def point(self, p) -> tuple[float, ...]:
        """A camera-space point, metres."""
        return tuple(a + t for a, t in zip(self.direction(p), self.translation))

    def orientation(self, q) -> tuple[float, ...]:
        """An orientation given in camera axes, xyzw."""
        ax, ay, az, aw = self.rotation
        bx, by, bz, bw = q
        return (
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        )


def _cross(a, b) -> tuple[float, float, float]:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


class BodyFrame(ctypes.Structure):
    """Everyone with an identity."""

    _fields_ = [
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

    @staticmethod
    def type_name() -> str:
        return "EdgecapBodyFrameV2"

    def people(self) -> list[Body]:
        """The valid bodies."""
        return list(self._bodies[: self.count])

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


def runtime_dir() -> str:
    """The folder that edgecap's processes of this user share; the same search as in the Rust client."""
    if named := os.environ.get("EDGECAP_RUNTIME_DIR"):
        return named
    user = os.geteuid()

    def is_mine(folder: str) -> bool:
        try:
            return os.path.isdir(folder) and os.stat(folder).st_uid == user
        except OSError:
            return False

    if is_mine("/run/edgecap"):
        return "/run/edgecap"
    own = os.environ.get("XDG_RUNTIME_DIR", "")
    return os.path.join(own, "edgecap") if own and is_mine(own) else f"/tmp/edgecap-{user}"


class Stream:
    """A reader of one camera's stream: an iterator that ends with the input.  `RuntimeError` where nothing was ever published."""

    def __init__(self, camera: str, stream: str, version: int, payload: type[ctypes.Structure], timeout_s: float):
        import iceoryx2 as iox2

        folder = os.path.realpath(runtime_dir())
        try:
            # Held as long as the stream, so that nobody clears the folder below it.
            self._lock = open(os.path.join(folder, "lock"), "r+b")
            fcntl.flock(self._lock, fcntl.LOCK_SH)
            with open(os.path.join(folder, "prefix")) as f:
                prefix = f.read()
        except OSError as e:
            raise RuntimeError(f"{folder}: {e.strerror}; start edgecap as this user, or set EDGECAP_RUNTIME_DIR") from e
        config = iox2.config.default()
        config.global_cfg.root_path = iox2.Path.new(folder)
        config.global_cfg.prefix = iox2.FileName.new(prefix)
        self._iox2, self._payload, self._timeout_s, self._looked = iox2, payload, timeout_s, 0.0
        self._node = iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)
        name = f"edgecap/v{version}/{camera}/{stream}"
        try:
            self._messages = self._node.service_builder(iox2.ServiceName.new(name)).publish_subscribe(payload).open()
            self._wake = self._node.service_builder(iox2.ServiceName.new(name + "/wake")).event().open()
        except Exception as e:
            raise RuntimeError(f"{name}: {e}; is 'edgecap run' or 'edgecap fit' running, of the same version?") from e
        self._subscriber = self._messages.subscriber_builder().create()
        self._listener = self._wake.listener_builder().create()

    def next(self, timeout_s: float = 1.0) -> ctypes.Structure | None:
        """The oldest message not yet read, waiting up to `timeout_s` for one; None when none came."""
        deadline = time.monotonic() + timeout_s
        while True:
            sample = self._subscriber.receive()
            if sample is not None:
                frame = self._payload.from_buffer_copy(sample.payload().contents)
                sample.delete()
                return frame
            left = deadline - time.monotonic()
            if left <= 1e-5:
                return None
            self._listener.timed_wait(self._iox2.Duration.from_secs_f64(left))

    @property
    def publishers(self) -> int:
        """Processes that publish this stream now, 0 or 1.  One that was killed is gone within a quarter of a second of asking."""
        if time.monotonic() - self._looked > 0.25:
            self._node.try_cleanup_dead_nodes()
            self._looked = time.monotonic()
        return self._messages.dynamic_config.number_of_publishers

    def __iter__(self) -> Iterator[ctypes.Structure]:
        while True:
            frame = self.next(self._timeout_s)
            if frame is None:
                continue
            yield frame
            if frame.flags & FLAG_END_OF_STREAM:
                return


def bodies(camera: str = "camera0", timeout_s: float = 1.0) -> Stream:
    """Every body frame, oldest unread first, until the input ends.  `edgecap run` or `edgecap fit` must have been started."""
    return Stream(camera, "bodies", 2, BodyFrame, timeout_s)


def observations(camera: str = "camera0", timeout_s: float = 1.0) -> Stream:
    """Every observation frame, oldest unread first, until the input ends."""
    return Stream(camera, "observations", 1, ObservationFrame, timeout_s)


if __name__ == "__main__":
    import sys

    for f in bodies(*sys.argv[1:2]):
        print(f.sequence, [(b.id, b.state, [round(v, 2) for v in b.position]) for b in f.people()])
