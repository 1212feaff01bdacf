"""Writes a stream's file as a publisher does (`clients/rust/src/ring/mod.rs`), for tests without one."""

from __future__ import annotations

import ctypes
import os
import pathlib
import random
import struct
import sys
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))

import edgecap  # noqa: E402

SLOTS = 17
END_OF_FILE = edgecap.FLAG_END_OF_STREAM | edgecap.FLAG_FILE_TIME


class Writer:
    """A publisher that gives signs of life until it is closed or killed."""

    def __init__(
        self,
        folder: pathlib.Path,
        camera: str = "camera0",
        version: int = 2,
        stream: str = "bodies",
        message: type[ctypes.Structure] = edgecap.BodyFrame,
    ):
        size = ctypes.sizeof(message)
        self.path = folder / f"{camera}.{stream}.v{version}"
        new = self.path.with_suffix(".new")
        header = struct.pack("=8sIIIIQQQ", b"EDGECAP\x01", version, size, SLOTS, 0, random.getrandbits(64), 0, 0)
        new.write_bytes(header + bytes(64 - len(header) + SLOTS * size))
        new.chmod(0o600)
        self.fd = os.open(new, os.O_RDWR)
        self.count, self.size = 0, size
        self._sign()
        os.replace(new, self.path)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._live, daemon=True)
        self._thread.start()

    def _sign(self) -> None:
        os.pwrite(self.fd, struct.pack("=Q", time.monotonic_ns()), 40)

    def _live(self) -> None:
        while not self._stop.wait(0.1):
            self._sign()

    def publish(self, frame: ctypes.Structure) -> None:
        os.pwrite(self.fd, bytes(frame), 64 + self.count % SLOTS * self.size)
        self.count += 1
        os.pwrite(self.fd, struct.pack("=Q", self.count), 32)
        os.utime(self.fd)

    def kill(self) -> None:
        """Ends without a word."""
        self._stop.set()
        self._thread.join()
        os.close(self.fd)

    def close(self) -> None:
        """Ends as a publisher that stops does."""
        self._stop.set()
        self._thread.join()
        os.pwrite(self.fd, bytes(8), 40)
        self.path.unlink()
        os.close(self.fd)


def frame(sequence: int, ids: tuple[int, ...] = (3,), flags: int = 0) -> edgecap.BodyFrame:
    """A frame in which every body's numbers tell whose they are."""
    made = edgecap.BodyFrame(sequence=sequence, flags=flags, count=len(ids), width=1280, height=720)
    for body, number in zip(made._bodies, ids):
        body.id, body._state, body.score, body.height = number, 1, 0.875, 1.75
        body.position[:] = (0.5, -0.25, float(number))
        for i in range(edgecap.DOF):
            body.angles[i] = i / 16
        for j in range(edgecap.BODY_JOINTS):
            body.joints3d[j][:] = (number, j, sequence)
            body.joints2d[j][:] = (j, number)
            body.confidence[j], body.bone_lengths[j], body._joint_states[j] = j / 32, j / 64, j % 3
        for b in range(len(edgecap.HUMANOID_BONES)):
            body.bone_rotations[b][:] = (b, 0, 0, 1)
    return made
