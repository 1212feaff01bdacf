"""Waiting for a file's next message."""

from __future__ import annotations

import ctypes
import errno
import os
import select
import threading
import time
from typing import Final

_STEP_S: Final = 0.005
"""How often it is looked where the kernel does not tell."""


class Wake:
    """Wakes when a file's attributes change (inotify): a publisher sets its file's times with each message.

    A user has so many of these (/proc/sys/fs/inotify): where there is none left for a file that is read, it wakes every
    few milliseconds.
    """

    _ATTRIB: Final = 0x4
    _NONBLOCK: Final = 0o4000
    _CLOEXEC: Final = 0o2000000

    def __init__(self) -> None:
        # A signal's handler may close it while its own thread has it locked.
        self._lock = threading.RLock()
        self._waiting, self._is_closed = 0, False
        self._process = os.getpid()
        self._path: str | None = None
        self._watched = -1
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._fd: int = self._libc.inotify_init1(self._NONBLOCK | self._CLOEXEC)
        self._is_refused = False

    def is_of_this_process(self) -> bool:
        """False in a child that was forked: what wakes one of both the other would not get."""
        return self._process == os.getpid()

    def renew_lock(self) -> None:
        """For a child that was forked: the thread that had it locked may not be in it."""
        self._lock = threading.RLock()

    def fileno(self) -> int:
        """Readable when something has changed; negative where the kernel does not tell."""
        return self._fd

    def watch(self, path: str) -> None:
        """Watches this file instead of the one before."""
        self._unwatch()
        self._path = path
        self._add()

    def leave(self) -> None:
        """Watches no file any more.  What wakes the process that a child was forked from stays as it is."""
        if self.is_of_this_process():
            self._unwatch()
        self._path, self._is_refused = None, False

    def watches(self) -> bool:
        """Tries again to watch the file where the kernel refused it; whether it refuses no more."""
        if self._is_refused:
            self._add()
        return not self._is_refused

    def wait(self, timeout_s: float) -> None:
        """Until something changes or another thread closes it, at most so long."""
        # From here on nobody closes the descriptor.
        with self._lock:
            self._waiting += 1
        try:
            if self._is_closed:
                return
            if self._is_refused:
                time.sleep(min(timeout_s, _STEP_S))
                return
            if self._fd < 0:
                # No file is there that a message could come in.
                time.sleep(timeout_s)
                return
            # Unlike select, it takes numbers above 1023.
            poll = select.poll()
            poll.register(self._fd, select.POLLIN)
            if poll.poll(timeout_s * 1000):
                self.forget()
        finally:
            with self._lock:
                self._waiting -= 1
                self._let_go()

    def forget(self) -> None:
        """The next wait waits for what comes after this."""
        if self._fd >= 0:
            try:
                os.read(self._fd, 65536)
            except BlockingIOError:
                pass

    def close(self) -> None:
        """Lets go of it; closing twice does nothing.  A thread that waits is woken."""
        with self._lock:
            self._is_closed = True
            if self._waiting and self.is_of_this_process():
                self._unwatch()
            self._let_go()

    def _add(self) -> None:
        assert self._path is not None
        if self._fd < 0:
            self._is_refused = True
            return
        ctypes.set_errno(0)
        self._watched = self._libc.inotify_add_watch(self._fd, os.fsencode(self._path), self._ATTRIB)
        # In a file that has gone meanwhile nothing comes, and nothing was refused.
        self._is_refused = self._watched < 0 and ctypes.get_errno() != errno.ENOENT

    def _unwatch(self) -> None:
        if self._watched >= 0:
            # The kernel tells that, too, so that who waits wakes.
            self._libc.inotify_rm_watch(self._fd, self._watched)
            self._watched = -1

    def _let_go(self) -> None:
        # Who still waits would read from whatever gets the number next; in a forked child nobody waits.
        if self._is_closed and not (self._waiting and self.is_of_this_process()):
            # In this order, or a child that is forked in between closes whatever has the number by then.
            fd, self._fd = self._fd, -1
            if fd >= 0:
                os.close(fd)
