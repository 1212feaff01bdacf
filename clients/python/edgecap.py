"""Read edgecap's bodies from shared memory; nothing to install, this file is all:

    import edgecap
    for frame in edgecap.bodies("camera0"):
        for body in frame.people():
            print(body.id, list(body.position), body.joint("r_wrist"))

Where frames may fail to come, take them one by one: `stream = edgecap.bodies("camera0")`, `stream.next(timeout_s)` gives one
or None, and `stream.publishers` says whether anybody publishes (0 within a second of the publisher's death, 1 once it is back).

`frame.in_world(body)` gives a body in the floor-aligned world (y up, floor at y = 0) once a floor is known, else None.

Camera frame: x right, y down, z forward, metres; pixels of the original picture; quaternions xyzw; times CLOCK_MONOTONIC
nanoseconds.  The structures mirror `clients/rust/src/message.rs`, whose tests compare sizes and offsets with this file; the
file that frames are read from is described in `clients/rust/src/ring/mod.rs`.
"""

from __future__ import annotations

import ctypes
import os
import re
import select
import stat
import struct
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


SERVICE_DIR = "/run/edgecap"


def _is_own(folder: str) -> bool:
    try:
        return os.path.isdir(folder) and os.stat(folder).st_uid == os.geteuid()
    except OSError:
        return False


def runtime_dir() -> str:
    """The folder that this user's processes publish in; the same search as in the Rust client."""
    if named := os.environ.get("EDGECAP_RUNTIME_DIR"):
        return named
    if _is_own(SERVICE_DIR):
        return SERVICE_DIR
    user = os.geteuid()
    for session in (os.environ.get("XDG_RUNTIME_DIR"), f"/run/user/{user}"):
        if session and _is_own(session):
            return os.path.join(session, "edgecap")
    memory, home = f"/dev/shm/edgecap-{user}", os.path.expanduser("~")
    is_taken = os.path.lexists(memory) and os.lstat(memory).st_uid != user
    return os.path.join(home, ".cache/edgecap/run") if is_taken and _is_own(home) else memory


def reading_dirs() -> list[str]:
    """The folders that a reader looks in, this user's own first; the service's where it may be read."""
    dirs = [runtime_dir()]
    if not os.environ.get("EDGECAP_RUNTIME_DIR") and dirs[0] != SERVICE_DIR and os.access(SERVICE_DIR, os.R_OK | os.X_OK):
        dirs.append(SERVICE_DIR)
    return dirs


class _Watch:
    """Wakes when a file's attributes change (inotify): a publisher sets its file's times with each frame."""

    _ATTRIB, _NONBLOCK, _CLOEXEC = 0x4, 0o4000, 0o2000000

    def __init__(self):
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._fd = self._libc.inotify_init1(self._NONBLOCK | self._CLOEXEC)
        if self._fd < 0:
            errno = ctypes.get_errno()
            raise OSError(errno, f"inotify: {os.strerror(errno)}")
        self._watched = -1

    def watch(self, path: str) -> None:
        if self._watched >= 0:
            self._libc.inotify_rm_watch(self._fd, self._watched)
        self._watched = self._libc.inotify_add_watch(self._fd, os.fsencode(path), self._ATTRIB)

    def wait(self, timeout_s: float) -> None:
        if select.select([self._fd], [], [], timeout_s)[0]:
            try:
                os.read(self._fd, 65536)
            except BlockingIOError:
                pass

    def __del__(self):
        if getattr(self, "_fd", -1) >= 0:
            os.close(self._fd)


class Stream:
    """A reader of one camera's stream, which need not be there yet: an iterator that ends with the input.

    `RuntimeError` where the stream may not be read, or has messages of another version.
    """

    _HEADER = struct.Struct("=8sIIIIQQQ")
    _MAGIC, _SLOTS, _SLOT_AT = b"EDGECAP\x01", 17, 64
    _GONE_AFTER_NS, _LOOK_EVERY_S, _SEARCH_EVERY_S = 700_000_000, 0.2, 0.02

    def __init__(self, camera: str, stream: str, version: int, payload: type[ctypes.Structure], timeout_s: float):
        if not re.fullmatch(r"[a-zA-Z0-9_-]{1,64}", camera):
            raise RuntimeError(f"camera name {camera!r}: expected 1 to 64 of a-z, A-Z, 0-9, '-' and '_'")
        self._name = f"edgecap/v{version}/{camera}/{stream}"
        self._stem, self._version, self._payload, self._timeout_s = f"{camera}.{stream}", version, payload, timeout_s
        self._size = ctypes.sizeof(payload)
        self._watch = _Watch()
        self._fd, self._path, self._life, self._next, self._alive, self._looked = -1, "", None, 0, False, 0.0
        self._search(first=True)

    def next(self, timeout_s: float = 1.0) -> ctypes.Structure | None:
        """The oldest message not yet read, waiting up to `timeout_s` for one; None when none came."""
        deadline = time.monotonic() + timeout_s
        while True:
            frame = self._read()
            if frame is None:
                self._look()
                frame = self._read()
            left = deadline - time.monotonic()
            if frame is not None or left <= 0:
                return frame
            self._watch.wait(min(left, self._every()))

    @property
    def publishers(self) -> int:
        """Processes that publish this stream now, 0 or 1.  One that died is gone within a second."""
        self._look()
        return int(self._alive)

    def __iter__(self) -> Iterator[ctypes.Structure]:
        while True:
            frame = self.next(self._timeout_s)
            if frame is None:
                continue
            yield frame
            if frame.flags & FLAG_END_OF_STREAM:
                return

    def __del__(self):
        if getattr(self, "_fd", -1) >= 0:
            os.close(self._fd)

    def _every(self) -> float:
        return self._SEARCH_EVERY_S if self._fd < 0 else self._LOOK_EVERY_S

    def _header(self, fd: int):
        """Version, size, life, count and last sign of life; None where the file is none of ours."""
        data = os.pread(fd, self._HEADER.size, 0)
        if len(data) < self._HEADER.size:
            return None
        magic, version, size, slots, _, life, count, alive = self._HEADER.unpack(data)
        return (version, size, life, count, alive) if (magic, slots) == (self._MAGIC, self._SLOTS) else None

    def _is_alive(self, fd: int) -> bool:
        header = self._header(fd)
        return bool(header and header[4]) and abs(time.monotonic_ns() - header[4]) < self._GONE_AFTER_NS

    @staticmethod
    def _is_at(fd: int, path: str) -> bool:
        try:
            return os.path.samestat(os.fstat(fd), os.lstat(path))
        except OSError:
            return False

    def _look(self) -> None:
        if time.monotonic() - self._looked < self._every():
            return
        self._looked = time.monotonic()
        if self._fd >= 0:
            self._alive = self._is_at(self._fd, self._path) and self._is_alive(self._fd)
            if self._alive or self._count() > self._next:
                return
        self._search(first=False)

    def _count(self) -> int:
        header = self._header(self._fd) if self._fd >= 0 else None
        return header[3] if header else self._next

    def _search(self, first: bool) -> None:
        """Opens the first file whose publisher is alive, else the first that is there."""
        found, refused = None, None
        for folder in reading_dirs():
            try:
                opened = self._open_in(folder)
            except RuntimeError as e:
                refused = e
                continue
            if opened and (opened[2] or not found):
                if found:
                    os.close(found[0])
                found = opened
            elif opened:
                os.close(opened[0])
            if found and found[2]:
                break
        if found is None:
            if refused and self._fd < 0:
                raise refused
            return
        fd, path, alive = found
        _, _, life, count, _ = self._header(fd)
        if life == self._life:
            os.close(fd)
            self._alive = alive
            return
        if self._fd >= 0:
            os.close(self._fd)
        self._fd, self._path, self._life, self._alive = fd, path, life, alive
        # The last words of the dead are old; a publisher that was waited for is read from its first message.
        self._next = count if not alive else max(0, count - 1 if first else count - (self._SLOTS - 1))
        self._watch.watch(path)

    def _open_in(self, folder: str) -> tuple[int, str, bool] | None:
        try:
            owner = os.lstat(folder)
        except OSError:
            return None
        if not stat.S_ISDIR(owner.st_mode) or owner.st_mode & 0o022:
            raise RuntimeError(f"runtime folder {folder}: expected a folder that only its owner may write")
        path = os.path.join(folder, f"{self._stem}.v{self._version}")
        try:
            fd = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        except FileNotFoundError:
            return self._other_version(folder)
        except PermissionError as e:
            raise RuntimeError(
                f"{self._name} belongs to user {owner.st_uid}: expected that user or a member of group {owner.st_gid}, "
                f"found user {os.geteuid()}; add this user to the group"
            ) from e
        except OSError as e:
            raise RuntimeError(f"{path}: {e.strerror}") from e
        about, header = os.fstat(fd), self._header(fd)
        trusted = stat.S_ISREG(about.st_mode) and about.st_uid == owner.st_uid and not about.st_mode & 0o022
        if not trusted or not header or header[:2] != (self._version, self._size):
            os.close(fd)
            return None
        return fd, path, self._is_alive(fd)

    def _other_version(self, folder: str) -> None:
        """Tells when the stream is published with messages that this file cannot read."""
        try:
            names = os.listdir(folder)
        except OSError:
            return
        for name in names:
            other = re.fullmatch(re.escape(self._stem) + r"\.v(\d+)", name)
            if not other:
                continue
            try:
                fd = os.open(os.path.join(folder, name), os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
            except OSError:
                continue
            alive = self._is_alive(fd)
            os.close(fd)
            if alive:
                raise RuntimeError(
                    f"{self._name}: expected messages of version {self._version}, found version {other[1]}; "
                    "use an edgecap and a client of the same version"
                )

    def _read(self) -> ctypes.Structure | None:
        while self._fd >= 0:
            count = self._count()
            if self._next >= count:
                return None
            self._next = max(self._next, count - (self._SLOTS - 1))
            data = os.pread(self._fd, self._size, self._SLOT_AT + self._next % self._SLOTS * self._size)
            if len(data) < self._size:
                return None
            # Whole only if the writer has not come round to it meanwhile.
            if self._next + self._SLOTS > self._count():
                self._next += 1
                return self._payload.from_buffer_copy(data)
        return None


def bodies(camera: str = "camera0", timeout_s: float = 1.0) -> Stream:
    """Every body frame, oldest unread first, until the input ends; waits where nobody publishes yet."""
    return Stream(camera, "bodies", 2, BodyFrame, timeout_s)


def observations(camera: str = "camera0", timeout_s: float = 1.0) -> Stream:
    """Every observation frame, oldest unread first, until the input ends."""
    return Stream(camera, "observations", 1, ObservationFrame, timeout_s)


if __name__ == "__main__":
    import sys

    for f in bodies(*sys.argv[1:2]):
        print(f.sequence, [(b.id, b.state, [round(v, 2) for v in b.position]) for b in f.people()])
