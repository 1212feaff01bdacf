"""`python3 -m edgecap [CAMERA]`: everybody of a camera, a line a frame."""

from __future__ import annotations

import os
import sys

from . import EdgecapError, bodies


def main() -> int:
    try:
        for frame in bodies(sys.argv[1] if len(sys.argv) > 1 else "camera0"):
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
