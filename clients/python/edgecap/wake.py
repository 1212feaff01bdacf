"""Waiting for a file's next message."""

from __future__ import annotations

import ctypes
import os
import select
import time
from typing import Final

_STEP_S: Final = 0.005
"""How often it is looked where the kernel does not tell."""


class Wake:
    """Wakes when a file's attributes change (inotify): a publisher sets its file's times with each message.

    A user has so many of these (/proc/sys/fs/inotify): where there is none left, it wakes every few milliseconds.
    """

    _ATTRIB: Final = 0x4
    _NONBLOCK: Final = 0o4000
    _CLOEXEC: Final = 0o2000000

    def __init__(self) -> None:
        self._watched = -1
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._fd: int = self._libc.inotify_init1(self._NONBLOCK | self._CLOEXEC)
        self._is_told = self._fd >= 0

    def watch(self, path: str) -> None:
        """Watches this file instead of the one before."""
        if self._fd < 0:
            return
        if self._watched >= 0:
            self._libc.inotify_rm_watch(self._fd, self._watched)
        self._watched = self._libc.inotify_add_watch(self._fd, os.fsencode(path), self._ATTRIB)
        self._is_told = self._watched >= 0

    def wait(self, timeout_s: float) -> None:
        """Until something changes, at most so long."""
        if not self._is_told:
            time.sleep(min(timeout_s, _STEP_S))
            return
        # Unlike select, it takes numbers above 1023.
        poll = select.poll()
        poll.register(self._fd, select.POLLIN)
        if poll.poll(timeout_s * 1000):
            try:
                os.read(self._fd, 65536)
            except BlockingIOError:
                pass

    def close(self) -> None:
        """Lets go of it; closing twice does nothing."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1
