"""The floor-aligned world: x to the camera's right along the floor, y up, z towards the viewer, metres, origin on the
floor below the camera."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from ctypes import c_float, c_uint32
from dataclasses import dataclass
from typing import ClassVar, Final

from .names import JOINT_NAMES, index

WORLD_STATES: Final = ("none", "estimated", "given")

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class World(ctypes.Structure):
    """From camera axes to the floor's: world = rotation * camera + translation."""

    _fields_: ClassVar = [("rotation", c_float * 4), ("translation", c_float * 3), ("_state", c_uint32)]

    rotation: ctypes.Array[c_float]
    """xyzw."""
    translation: ctypes.Array[c_float]
    """The camera in the world: 0, its height above the floor, 0; metres.  Of a room of several cameras, whose axes are
    the calibration's, zeros."""
    _state: int

    @property
    def state(self) -> str:
        """`none`, `estimated` (from standing feet) or `given` (by the settings)."""
        return WORLD_STATES[self._state] if self._state < len(WORLD_STATES) else "none"

    def direction(self, v: Iterable[float]) -> Vector:
        """A direction or velocity given in camera axes."""
        a, b, c = v
        x, y, z, w = self.rotation
        ix, iy, iz = _cross((x, y, z), (a, b, c))
        ox, oy, oz = _cross((x, y, z), (ix + w * a, iy + w * b, iz + w * c))
        return (a + 2.0 * ox, b + 2.0 * oy, c + 2.0 * oz)

    def point(self, p: Iterable[float]) -> Vector:
        """A camera-space point, metres."""
        (x, y, z), t = self.direction(p), self.translation
        return (x + t[0], y + t[1], z + t[2])

    def orientation(self, q: Iterable[float]) -> Quaternion:
        """An orientation given in camera axes, xyzw."""
        ax, ay, az, aw = self.rotation
        bx, by, bz, bw = q
        return (
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        )

    def __repr__(self) -> str:
        if self.state == "none":
            return "World(no floor is known)"
        height = self.translation[1]
        # Of several cameras as one room there is no one camera.
        return f"World({self.state}, camera {height:.2f} m above the floor)" if height else f"World({self.state})"


@dataclass(frozen=True, repr=False)
class WorldBody:
    """A body in the floor-aligned world, metres."""

    position: Vector
    """Pelvis."""
    orientation: Quaternion
    """Of the pelvis, from the skeleton's rest axes to world axes, xyzw; upright and facing the camera: identity."""
    velocity: Vector
    """Of the pelvis, metres per second."""
    joints3d: list[Vector]

    def joint(self, name: str) -> Vector:
        """A joint, metres."""
        return self.joints3d[index("joint", name, JOINT_NAMES)]

    def __repr__(self) -> str:
        x, y, z = self.position
        return f"WorldBody(pelvis at ({x:.2f}, {y:.2f}, {z:.2f}) m)"


def _cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
