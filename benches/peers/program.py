"""A peer as a whole program: a folder of photos or a film goes in, people as JSON lines come out.

    program.py SYSTEM MODELS INPUT OUT

The last thing printed is {"version", "frames", "networks_s"}: networks_s is the processor time inside the networks,
null where the system does not let one look.
"""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

# What is made out of the peers' files.
MADE = Path(__file__).resolve().parent / ".cache"


def system(name: str, models: Path, film: bool):
    """Imports only what that system needs: every one may have its own environment."""
    kind, _, size = name.partition("-")
    if kind == "yolox":
        from whole.yolox_tinypose import Chain

        return Chain(models, int(size))
    if kind == "movenet":
        from whole.movenet import MultiPose

        return MultiPose(MADE / "movenet-multipose.pb")
    from whole import mediapipe_pose

    return mediapipe_pose.One(film) if size == "one" else mediapipe_pose.Many(film, MADE / "pose_full.task")


def pictures(source: Path) -> Iterator[tuple[str, np.ndarray]]:
    """Names and BGR bytes."""
    if source.is_dir():
        for file in sorted(source.iterdir()):
            picture = cv2.imread(str(file))
            if picture is not None:
                yield file.name, picture
        return
    film = cv2.VideoCapture(str(source))
    while (got := film.read())[0]:
        yield source.name, got[1]


def main() -> None:
    name, models, source, out = sys.argv[1], *map(Path, sys.argv[2:5])
    cv2.setNumThreads(1)
    peer = system(name, models, film=not source.is_dir())
    frames = 0
    with out.open("w") as lines:
        for picture_name, picture in pictures(source):
            limbs = [p.round(2).tolist() for p in peer.people(picture)]
            lines.write(json.dumps({"source": picture_name, "limbs": limbs}) + "\n")
            frames += 1
    networks = peer.networks_s() if hasattr(peer, "networks_s") else None
    print(json.dumps({"version": peer.version, "frames": frames, "networks_s": networks}))


if __name__ == "__main__":
    main()
