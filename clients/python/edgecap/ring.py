"""The file that a stream's newest messages lie in; `clients/rust/src/ring/mod.rs` describes it."""

from __future__ import annotations

import ctypes
import os
import re
import stat
import struct
import time
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeVar

from .errors import AccessError, EdgecapError, VersionError

SLOTS: Final = 17
"""One more than can be read: it is being written."""
_SLOT_AT: Final = 64
_MAGIC: Final = b"EDGECAP\x01"
_HEADER: Final = struct.Struct("=8sIIIIQQQ")
_GONE_AFTER_NS: Final = 700_000_000

M = TypeVar("M", bound=ctypes.Structure)


class Kind(NamedTuple):
    """Which stream of which camera."""

    camera: str
    stream: str
    version: int
    message_size: int
    """Bytes."""

    @property
    def service(self) -> str:
        """Its name."""
        return f"edgecap/v{self.version}/{self.camera}/{self.stream}"

    @property
    def stem(self) -> str:
        """How the names of its files begin."""
        return f"{self.camera}.{self.stream}"


@dataclass(frozen=True)
class Header:
    """What the file begins with."""

    version: int
    size: int
    life: int
    """Another one is another publisher."""
    count: int
    """Messages written so far."""
    alive_ns: int
    """Last sign of life; 0 once the publisher has gone."""

    def is_alive(self) -> bool:
        """Whether the publisher gave a sign of life lately."""
        return self.alive_ns > 0 and abs(time.monotonic_ns() - self.alive_ns) < _GONE_AFTER_NS


class Ring:
    """One publisher's file, open for reading."""

    def __init__(self, fd: int, folder: str, path: str, header: Header):
        self._fd = fd
        self.folder, self.path = folder, path
        self.life = header.life
        self.was_alive = header.is_alive()
        """When it was opened."""
        self.first_count = header.count

    def header(self) -> Header | None:
        """None where the file was cut short."""
        return _read_header(self._fd)

    def count(self, otherwise: int) -> int:
        """Messages written so far."""
        header = self.header()
        return header.count if header else otherwise

    def is_published(self) -> bool:
        """Whether its publisher is alive, and others find this file where it was found."""
        header = self.header()
        return header is not None and header.is_alive() and self._is_in_place()

    def read(self, n: int, into: M) -> bool:
        """Copies message `n`; False where the writer came round to it meanwhile.

        Raises `EOFError` where somebody cut the file short.
        """
        size = ctypes.sizeof(into)
        if os.preadv(self._fd, [into], _SLOT_AT + n % SLOTS * size) < size:
            raise EOFError(self.path)
        return n + SLOTS > self.count(otherwise=n + SLOTS)

    def close(self) -> None:
        """Lets go of the file."""
        os.close(self._fd)

    def _is_in_place(self) -> bool:
        try:
            return os.path.samestat(os.fstat(self._fd), os.lstat(self.path))
        except OSError:
            return False


def open_in(folder: str, kind: Kind) -> Ring | None:
    """The stream's file of a folder; None where there is none.

    Raises `AccessError` and `VersionError`.
    """
    try:
        owner = os.lstat(folder)
    except OSError:
        return None
    if not stat.S_ISDIR(owner.st_mode) or owner.st_mode & 0o022:
        raise AccessError(
            f"runtime folder {folder}: expected a folder that only its owner may write; mend that (chmod 700), or name "
            "another one in EDGECAP_RUNTIME_DIR"
        )
    path = os.path.join(folder, f"{kind.stem}.v{kind.version}")
    try:
        fd = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except FileNotFoundError:
        _refuse_other_version(folder, kind)
        return None
    except PermissionError as e:
        raise AccessError(
            f"{kind.service} belongs to user {owner.st_uid}: expected that user or a member of group "
            f"{_group(path, owner.st_gid)}, found user {os.geteuid()}; add this user to the group"
        ) from e
    except OSError as e:
        raise EdgecapError(f"{path}: {e.strerror}; `edgecap doctor` looks closer") from e
    try:
        about = os.fstat(fd)
        if not stat.S_ISREG(about.st_mode) or about.st_uid != owner.st_uid or about.st_mode & 0o022:
            raise AccessError(
                f"{path}: expected a file of user {owner.st_uid} that nobody else may write; remove it, or name another "
                "folder in EDGECAP_RUNTIME_DIR"
            )
        header = _read_header(fd)
        if header is None or (header.version, header.size) != (kind.version, kind.message_size):
            return None
        ring, fd = Ring(fd, folder, path, header), -1
        return ring
    finally:
        if fd >= 0:
            os.close(fd)


def _group(path: str, otherwise: int) -> int:
    """The group that a file belongs to; `otherwise` where its folder may not be looked into."""
    try:
        return os.lstat(path).st_gid
    except OSError:
        return otherwise


def _read_header(fd: int) -> Header | None:
    """None where the file is none of ours."""
    data = os.pread(fd, _HEADER.size, 0)
    if len(data) < _HEADER.size:
        return None
    magic, version, size, slots, _, life, count, alive_ns = _HEADER.unpack(data)
    return Header(version, size, life, count, alive_ns) if (magic, slots) == (_MAGIC, SLOTS) else None


def _refuse_other_version(folder: str, kind: Kind) -> None:
    """Raises `VersionError` where the stream is published with messages that this client cannot read."""
    try:
        names = os.listdir(folder)
    except OSError:
        return
    for name in names:
        other = re.fullmatch(re.escape(kind.stem) + r"\.v(\d+)", name)
        # One of the reader's own version came just now: the next look finds it.
        if not other or int(other[1]) == kind.version:
            continue
        try:
            # A pipe would be waited for.
            flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
            fd = os.open(os.path.join(folder, name), flags)
        except OSError:
            continue
        try:
            header = _read_header(fd) if stat.S_ISREG(os.fstat(fd).st_mode) else None
        finally:
            os.close(fd)
        if header and header.is_alive():
            raise VersionError(
                f"{kind.service}: expected messages of version {kind.version}, found version {other[1]}; "
                "use an edgecap and a client of the same version"
            )
