"""Reading a stream: waits in the kernel for the next message, follows publishers that go and come back."""

from __future__ import annotations

import contextlib
import ctypes
import itertools
import logging
import os
import re
import threading
import time
import weakref
from collections.abc import Iterable, Iterator
from typing import Any, Final, Generic, NoReturn

from .errors import EdgecapError, NoFrame, UnknownName
from .event import EventFrame
from .health_frame import HealthFrame
from .message import FLAG_END_OF_STREAM, FLAG_FILE_TIME, BodyFrame, ObservationFrame
from .place import BODIES_VERSION, cameras, closed_service, reading_dirs
from .ring import SLOTS, Kind, M, Ring, open_in
from .wake import Wake

_LOOK_EVERY_S: Final = 0.2
_SEARCH_EVERY_S: Final = 0.02
_SEARCH_EAGERLY_S: Final = 1.0
"""How long a run is searched for so often: at a start side by side.  Later every `_LOOK_EVERY_S` is soon enough."""
_RETURN_EVERY_S: Final = 1.0
"""How often a reader of a later folder looks whether somebody publishes in one before it again."""
_STALE_AFTER_NS: Final = 2_000_000_000
"""A message of what was so for so long ago may be all that a camera that is away has left."""
_END_OF_FILE: Final = FLAG_END_OF_STREAM | FLAG_FILE_TIME
_SILENT_FOR_S: Final = 1.0
"""How long nobody may publish before a loop says that it waits."""

log = logging.getLogger("edgecap")


class Stream(Generic[M]):
    """A reader of one camera's stream, which need not be there yet: a loop over it ends where a file does.

    Where it is there it begins with the newest message; one of bodies, observations or health with the next where that
    is more than two seconds old and does not end the stream.

    Any thread and any signal's handler may close it, and that ends a loop over it; messages are taken by one thread at
    a time.

    Raises `AccessError` where the stream may not be read, `VersionError` where it has messages of another version.
    """

    def __init__(
        self, camera: str, stream: str, version: int, message: type[M], timeout_s: float | None = None
    ) -> None:
        self._lock = threading.RLock()
        self._is_at_work, self._is_closing = False, False
        self._ring: Ring | None = None
        self._left: tuple[int, int] | None = None
        """Life of the publisher that was read before, and number of its message that comes next."""
        self._wake: Wake | None = None
        self._alive, self._is_followed = False, False
        if not re.fullmatch(r"[a-zA-Z0-9_-]{1,64}", camera):
            raise UnknownName(
                f"camera name {camera!r}: expected 1 to 64 of a-z, A-Z, 0-9, '-' and '_', as given to `edgecap run --name`"
            )
        self._kind = Kind(camera, stream, version, ctypes.sizeof(message))
        self._message, self._timeout_s = message, timeout_s
        self._wake = Wake()
        self._next, self._looked, self._searches_since = 0, 0.0, time.monotonic()
        self._looked_before = self._searches_since
        _streams.add(self)
        self._search(first=True)

    @property
    def camera(self) -> str:
        """The camera's name."""
        return self._kind.camera

    def next(self, timeout_s: float | None = 1.0) -> M | None:
        """The oldest message not yet read, waiting up to `timeout_s` (None: for ever) for one; None when none came.

        A reader that is more than 16 messages behind loses the oldest.
        """
        self._open_wake()
        return self._take(timeout_s)

    def newest(self, timeout_s: float | None = 1.0) -> M | None:
        """The newest message, leaving out older ones and all of a publisher that another one has followed; waits up to
        `timeout_s` (None: for ever) where all are read."""
        with self._work():
            self._open_wake()
            self._look(leave=True)
            self._skip()
        newest = self._take(timeout_s)
        while newest is not None:
            with self._work():
                self._skip()
                newer = self._read()
            if newer is None:
                break
            newest = newer
        return newest

    def publishers(self) -> int:
        """Processes that publish this stream now, 0 or 1.  One that died is gone within a second."""
        with self._work():
            self._open_wake()
            self._look()
            return int(self._alive)

    def fileno(self) -> int:
        """For event loops: readable when a message has come, until `next(0)` has given None.

        It tells nothing of a run that begins: call `next(0)` once a second as well.  Raises `EdgecapError` where the
        kernel has none left for this user, or none that watches one file more.
        """
        with self._work():
            wake = self._open_wake()
            fd = wake.fileno()
            if fd < 0:
                self._refuse("instance", "max_user_instances")
            if self._ring and not wake.watches():
                self._refuse("watch", "max_user_watches")
            return fd

    def _refuse(self, lacks: str, limit: str) -> NoReturn:
        raise EdgecapError(
            f"{self._kind.service}: this user has no inotify {lacks} left; call next() with a timeout instead, or "
            f"raise fs.inotify.{limit} (sysctl)"
        )

    def __iter__(self) -> Iterator[M]:
        """Every message until a file ends or the stream is closed.  A camera's run that has stopped is waited for:
        `edgecap`, the logger, says so.

        Raises `NoFrame` after `timeout_s` without a message, if the stream was opened with one.
        """
        self._open_wake()
        watch = _Watch(self._kind, self._timeout_s)
        while self._wake is not None:
            message = self._take(watch.patience())
            with self._work():
                if self._wake is None:
                    return
                is_alive = self.publishers() > 0
                life = self._ring.life if self._ring else None
            watch.saw(is_alive, life, message is not None)
            if message is None:
                continue
            yield message
            watch.begin()
            if getattr(message, "flags", 0) & _END_OF_FILE == _END_OF_FILE:
                return

    def close(self) -> None:
        """Lets go of everything; a stream that is let go of does it itself.  A thread that waits for a message is woken
        and gets none."""
        self._is_closing = True
        with self._lock:
            # A signal's handler, or what it calls: what this thread was at ends first.
            if self._is_at_work:
                return
            self._forget()
            if self._wake:
                self._wake.close()
                self._wake = None

    @contextlib.contextmanager
    def _work(self) -> Iterator[None]:
        """Has the stream for itself.  What a signal's handler closes meanwhile is closed at the end."""
        try:
            with self._lock:
                was_at_work = self._is_at_work
                try:
                    self._is_at_work = True
                    yield
                finally:
                    self._is_at_work = was_at_work
        finally:
            if self._is_closing:
                self.close()

    def __enter__(self) -> Stream[M]:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __del__(self) -> None:
        self.close()

    def __repr__(self) -> str:
        how = "published now" if self._alive else "nobody publishes it"
        return f"Stream({self._kind.service}: {'closed' if self._wake is None else how}, at message {self._next})"

    def _renew_locks(self) -> None:
        """For a child that was forked: the threads that had them locked are not in it."""
        self._lock, self._is_at_work = threading.RLock(), False
        if self._wake:
            self._wake.renew_lock()

    def _open_wake(self) -> Wake:
        with self._work():
            if self._wake is None:
                raise EdgecapError(f"{self._kind.service}: this stream was closed; open another one")
            if not self._wake.is_of_this_process():
                self._wake.close()
                self._wake = Wake()
                if self._ring:
                    self._wake.watch(self._ring.path)
            return self._wake

    def _take(self, timeout_s: float | None) -> M | None:
        """As `next`; None, too, where another thread closes the stream meanwhile."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            with self._work():
                if self._wake is None:
                    return None
                wake = self._open_wake()
                # Also of who always finds a message there: a publisher in an earlier folder would never be seen.
                self._look()
                message = self._read()
                every = self._every()
                left = every if deadline is None else deadline - time.monotonic()
                if message is None and left <= 0:
                    # Nothing is there, and nothing says so: what comes between both is read.
                    wake.forget()
                    message = self._read()
            if message is not None or left <= 0:
                return message
            wake.wait(min(left, every))

    def _every(self) -> float:
        is_new = time.monotonic() - self._searches_since < _SEARCH_EAGERLY_S
        return _SEARCH_EVERY_S if self._ring is None and is_new else _LOOK_EVERY_S

    def _look(self, leave: bool = False) -> None:
        """Looks whether the publisher is alive, if that was not done lately, and goes over to another one that is.

        What the dead left is read first; with `leave` it is left where somebody else publishes.
        """
        if time.monotonic() - self._looked < self._every() and not (leave and self._is_followed):
            return
        self._looked = time.monotonic()
        if self._ring:
            self._alive, self._is_followed = self._ring.is_published(), False
            self._open_wake().watches()
            if self._alive:
                self._return_to_those_before(self._ring)
                return
            if self._ring.count(self._next) > self._next:
                self._look_past(self._ring, leave)
                return
        self._search(first=False)

    def _return_to_those_before(self, ring: Ring) -> None:
        """Goes over to a publisher in a folder before that of the open file, whose own is alive."""
        if time.monotonic() - self._looked_before < _RETURN_EVERY_S:
            return
        self._looked_before = time.monotonic()
        try:
            found = self._find(itertools.takewhile(lambda folder: folder != ring.folder, reading_dirs()))
        except EdgecapError:
            # It is told where nothing else can be read.
            return
        if found and found.was_alive and found.life != ring.life:
            self._follow(found, first=False)
        elif found:
            found.close()

    def _look_past(self, dead: Ring, leave: bool) -> None:
        """Whether somebody else publishes while messages of the dead are unread."""
        try:
            found = self._find(reading_dirs())
        except EdgecapError:
            # It is told once those are read.
            return
        if found is None:
            return
        self._alive = found.was_alive
        self._is_followed = found.was_alive and found.life != dead.life
        if self._is_followed and leave:
            self._follow(found, first=False)
        else:
            found.close()

    def _search(self, first: bool) -> None:
        """Goes over to the first file whose publisher is alive, else to the first that is there."""
        found = self._find(reading_dirs())
        if found is None:
            return
        if self._ring and found.life == self._ring.life:
            self._alive = found.was_alive
            found.close()
        else:
            self._follow(found, first)

    def _find(self, folders: Iterable[str]) -> Ring | None:
        """Opens the first file whose publisher is alive, else the first that is there."""
        found: Ring | None = None
        refused: EdgecapError | None = None
        for folder in folders:
            try:
                ring = open_in(folder, self._kind)
            except EdgecapError as e:
                refused = e
                continue
            if ring and found and not ring.was_alive:
                ring.close()
            elif ring:
                if found:
                    found.close()
                found = ring
            if found and found.was_alive:
                break
        if found is None and refused:
            raise refused
        return found

    def _follow(self, ring: Ring, first: bool) -> None:
        left, known, count = self._ring, self._left, ring.first_count
        # A publisher in another folder may have been there for long.
        may_be_old = first or (left is not None and left.folder != ring.folder)
        # The last words of the dead are old; a publisher that was waited for is read from its first message.
        if not ring.was_alive or (may_be_old and self._is_stale(ring)):
            begin = count
        elif known and known[0] == ring.life:
            begin = min(max(known[1], count - (SLOTS - 1)), count)
        else:
            begin = max(0, count - (1 if first else SLOTS - 1))
        # A child that is forked in between finds no file, or one with its place.
        if left:
            self._left = left.life, self._next
        self._ring = None
        self._next = begin
        self._ring, self._alive, self._is_followed = ring, ring.was_alive, False
        self._open_wake().watch(ring.path)
        if left:
            left.close()

    def _is_stale(self, ring: Ring) -> bool:
        """Whether the newest message tells what was so a while ago and may not be any more.  What has happened has
        happened, and the end of a stream stays one."""
        if self._kind.stream == "events" or ring.first_count == 0:
            return False
        message = self._message()
        try:
            ring.read(ring.first_count - 1, message)
        except EOFError:
            return False
        told, flags = getattr(message, "publish_ns", 0), getattr(message, "flags", 0)
        return 0 < told < time.monotonic_ns() - _STALE_AFTER_NS and not flags & FLAG_END_OF_STREAM

    def _forget(self) -> None:
        """Lets go of the file, and looks for one anew."""
        left = self._ring
        if left:
            self._left = left.life, self._next
        self._ring = None
        if self._wake:
            self._wake.leave()
        if left:
            left.close()
            self._searches_since = time.monotonic()
        self._alive, self._is_followed = False, False

    def _skip(self) -> None:
        """Goes over to the newest message."""
        if self._ring:
            self._next = max(self._next, self._ring.count(self._next) - 1)

    def _read(self) -> M | None:
        while self._ring:
            count = self._ring.count(self._next)
            if self._next > count:
                # A writer only counts up.  Somebody else wrote into it: as good as not there.
                self._forget()
                return None
            if self._next == count:
                return None
            self._next = max(self._next, count - (SLOTS - 1))
            message = self._message()
            try:
                if self._ring.read(self._next, message):
                    self._next += 1
                    return message
            except EOFError:
                # Somebody cut it short: as good as not there.
                self._forget()
        return None


_streams: Final[weakref.WeakSet[Stream[Any]]] = weakref.WeakSet()
"""All that there are."""


def _renew_locks() -> None:
    for stream in list(_streams):
        stream._renew_locks()


os.register_at_fork(after_in_child=_renew_locks)


class _Watch:
    """What a loop over a stream has to say about its publisher, and how long it goes on without messages."""

    def __init__(self, kind: Kind, timeout_s: float | None):
        self._kind, self._timeout_s = kind, timeout_s
        self._life: int | None = None
        self._waits = False
        self.begin()

    def begin(self) -> None:
        """From here on a message is waited for."""
        self._since = time.monotonic()

    def patience(self) -> float:
        """How long to wait before looking who is there."""
        if self._timeout_s is None:
            return _SILENT_FOR_S
        return max(0.0, min(_SILENT_FOR_S, self._since + self._timeout_s - time.monotonic()))

    def saw(self, is_alive: bool, life: int | None, got: bool) -> None:
        """What came of the wait."""
        service, was = self._kind.service, self._life
        if not got and self._timeout_s is not None and time.monotonic() - self._since >= self._timeout_s:
            if is_alive:
                raise NoFrame(
                    f"{service}: it is published, but no frame came within {self._timeout_s:g} s; look at what its run "
                    "says, or wait longer"
                )
            raise NoFrame(
                f"{service}: no frame came within {self._timeout_s:g} s; start `edgecap run --name {self._kind.camera}`, "
                f"or look with `edgecap status`{self._elsewhere()}"
            )
        if is_alive or got:
            if self._waits or (was is not None and life != was):
                log.warning("%s is published%s", service, "" if was is None else " again")
            self._life, self._waits = life, False
        elif not self._waits:
            gone = "nobody publishes it yet" if was is None else "its publisher has gone"
            camera = self._kind.camera
            log.warning("%s: %s; waiting for `edgecap run --name %s`%s", service, gone, camera, self._elsewhere())
            self._waits = True

    def _elsewhere(self) -> str:
        """Where the frames could be instead."""
        others = [c for c in cameras() if c != self._kind.camera]
        bodies_of = f"; there are bodies of {', '.join(others)}" if others else ""
        closed = closed_service()
        return bodies_of + (f"; {closed}" if closed else "")


def bodies(camera: str = "camera0", timeout_s: float | None = None) -> Stream[BodyFrame]:
    """Every body frame, oldest unread first, until a file ends.

    A loop over it waits where nobody publishes; with `timeout_s` it raises `NoFrame` after so long without a frame.
    """
    return Stream(camera, "bodies", BODIES_VERSION, BodyFrame, timeout_s)


def observations(camera: str = "camera0", timeout_s: float | None = None) -> Stream[ObservationFrame]:
    """Every observation frame, oldest unread first, until a file ends; otherwise as `bodies`."""
    return Stream(camera, "observations", 1, ObservationFrame, timeout_s)


def events(camera: str = "camera0", timeout_s: float | None = None) -> Stream[EventFrame]:
    """Whatever happens, oldest unread first, until a file ends; otherwise as `bodies`.

    A message comes when something has happened, so silence is no sign of a failure.
    """
    return Stream(camera, "events", 1, EventFrame, timeout_s)


def health(camera: str = "camera0", timeout_s: float | None = None) -> Stream[HealthFrame]:
    """How a camera is doing, at every change of its state and about once a second; otherwise as `bodies`."""
    return Stream(camera, "health", 1, HealthFrame, timeout_s)
