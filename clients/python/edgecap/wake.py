"""Waiting for a file's next message."""

from __future__ import annotations

import ctypes
import os
import select
from typing import Final


class Wake:
    """Wakes when a file's attributes change (inotify): a publisher sets its file's times with each message."""

    _ATTRIB: Final = 0x4
    _NONBLOCK: Final = 0o4000
    _CLOEXEC: Final = 0o2000000

    def __init__(self) -> None:
        self._watched = -1
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._fd: int = self._libc.inotify_init1(self._NONBLOCK | self._CLOEXEC)
        if self._fd < 0:
            errno = ctypes.get_errno()
            most = "/proc/sys/fs/inotify/max_user_instances"
            raise OSError(errno, f"inotify: {os.strerror(errno)}; {most} says how many readers a user may have")

    def watch(self, path: str) -> None:
        """Watches this file instead of the one before."""
        if self._watched >= 0:
            self._libc.inotify_rm_watch(self._fd, self._watched)
        self._watched = self._libc.inotify_add_watch(self._fd, os.fsencode(path), self._ATTRIB)

    def wait(self, timeout_s: float) -> None:
        """Until something changes, at most so long."""
        if select.select([self._fd], [], [], timeout_s)[0]:
            try:
                os.read(self._fd, 65536)
            except BlockingIOError:
                pass

    def close(self) -> None:
        """Lets go of it; closing twice does nothing."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1
