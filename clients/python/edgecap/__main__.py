"""`python3 -m edgecap [CAMERA]`: everybody of a camera, a line a frame."""

from __future__ import annotations

import os
import sys

from . import EdgecapError, bodies


_USAGE = """usage: python3 -m edgecap [CAMERA]

Prints everybody of a camera (camera0 when not given), a line a frame, and waits for a run that is not there yet.
`edgecap status` lists the cameras."""


def main() -> int:
    given = sys.argv[1:]
    if given in (["-h"], ["--help"]):
        print(_USAGE)
        return 0
    # A camera's name may begin with a dash, but who writes one first means an option.
    if len(given) > 1 or any(word.startswith("-") for word in given):
        print(_USAGE, file=sys.stderr)
        return 2
    try:
        for frame in bodies(given[0] if given else "camera0"):
            print(frame.sequence, *frame.people(), flush=True)
    except EdgecapError as e:
        print(f"edgecap: {e}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        pass
    except BrokenPipeError:
        # What is left in the buffer would be written, and fail, once more at the end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


sys.exit(main())
