"""What can go wrong with a stream or a name.  Every text says what was expected, what was found and what to do."""

from __future__ import annotations


class EdgecapError(RuntimeError):
    """A stream that cannot be read, or a name that cannot be."""


class UnknownName(EdgecapError, ValueError):
    """A camera's name that cannot be one, or no joint, angle, bone or field of that name."""


class VersionError(EdgecapError):
    """The stream is published with messages of another version than this client reads."""


class AccessError(EdgecapError):
    """This user may not read the stream, or others may write where it lies."""


class NoFrame(EdgecapError, TimeoutError):
    """No frame came within the time that the reader had given."""
