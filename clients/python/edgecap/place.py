"""Where the shared memory of an installation lies: the same search as in `clients/rust/src/place.rs`."""

from __future__ import annotations

import functools
import grp
import os
import re
import stat
from typing import Final

SERVICE_DIR: Final = "/run/edgecap"
BODIES_VERSION: Final = 2
"""Of the messages that hold bodies; part of their files' names."""


def runtime_dir() -> str:
    """The folder that this user's processes publish in."""
    if named := os.environ.get("EDGECAP_RUNTIME_DIR"):
        return _from_here(named)
    if _is_own(SERVICE_DIR):
        return SERVICE_DIR
    for session in (os.environ.get("XDG_RUNTIME_DIR"), f"/run/user/{os.geteuid()}"):
        if session and _is_own(session):
            return os.path.join(session, "edgecap")
    memory, home = _without_session(), os.path.expanduser("~")
    is_taken = os.path.lexists(memory) and os.lstat(memory).st_uid != os.geteuid()
    return os.path.join(home, ".cache/edgecap/run") if is_taken and _is_own(home) else memory


def reading_dirs() -> list[str]:
    """The folders that a reader looks in, this user's own first; then the service's where it may be read, and that of
    a publisher of this user who began without a session."""
    dirs = [runtime_dir()]
    if os.environ.get("EDGECAP_RUNTIME_DIR"):
        return dirs
    if os.access(SERVICE_DIR, os.R_OK | os.X_OK):
        dirs.append(SERVICE_DIR)
    if _is_own_itself(_without_session()):
        dirs.append(_without_session())
    return list(dict.fromkeys(dirs))


def closed_service() -> str | None:
    """Why this user does not look in the service's folder, which is there, and what to do; None where nothing keeps it
    from looking."""
    if os.environ.get("EDGECAP_RUNTIME_DIR") or os.access(SERVICE_DIR, os.R_OK | os.X_OK):
        return None
    try:
        folder = os.stat(SERVICE_DIR)
    except OSError:
        return None
    if not stat.S_ISDIR(folder.st_mode):
        return None
    if folder.st_mode & 0o050 != 0o050:
        return f"{SERVICE_DIR} is closed to this user: only user {folder.st_uid} may read there"
    group = _group(folder.st_gid)
    return (
        f"{SERVICE_DIR} is closed to this user: add this user to the group {group} (sudo usermod -aG {group} $USER) "
        "and log in again"
    )


def _group(number: int) -> str:
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)


@functools.lru_cache(maxsize=None)
def _from_here(folder: str) -> str:
    """The same folder for as long as the process runs, wherever that goes meanwhile."""
    try:
        return folder if os.path.isabs(folder) else os.path.join(os.getcwd(), folder)
    except FileNotFoundError:
        # The process runs in a folder that was removed: nothing is in it.
        return folder


def _without_session() -> str:
    return f"/dev/shm/edgecap-{os.geteuid()}"


def cameras() -> list[str]:
    """The cameras whose bodies this user and this client may read, by name.  One whose publisher was killed is among
    them; ask `publishers()` of its stream."""
    found = set()
    for folder in reading_dirs():
        for name in _names(folder):
            if camera := re.fullmatch(rf"([a-zA-Z0-9_-]{{1,64}})\.bodies\.v{BODIES_VERSION}", name):
                found.add(camera[1])
    return sorted(found)


def _names(folder: str) -> list[str]:
    try:
        return os.listdir(folder)
    except OSError:
        return []


def _is_own(folder: str) -> bool:
    try:
        return os.path.isdir(folder) and os.stat(folder).st_uid == os.geteuid()
    except OSError:
        return False


def _is_own_itself(folder: str) -> bool:
    """As `_is_own`, in a folder for everybody, where a link of somebody else's may lead here."""
    return _is_own(folder) and not os.path.islink(folder)
