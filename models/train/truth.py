"""Pictures and truth of `edgecap synth` -> a folder of scenes like prerender.py's: python truth.py SYNTH [SYNTH ...] FOLDER [--limit N] [--size 512x320].

Joint orders, visibility codes and camera axes are the same on both sides, so only shapes change.  Pictures of another size are scaled to
fit and padded.
"""

from __future__ import annotations

import argparse
import json
import pathlib
import sys

import numpy as np
import torch
from PIL import Image

import terms
from body import canonical
from letterbox import letterbox
from pool import FIELDS, clear
from skeleton import NB, NJ, ROOT


def load(path: pathlib.Path) -> dict:
    """What a truth.json of `edgecap synth` says."""
    truth = json.loads(path.read_text())
    if (truth["format"], truth["version"]) != ("edgecap-truth", 1):
        raise SystemExit(f"expected edgecap-truth version 1, found {truth['format']} version {truth['version']} in {path}: write it again with `edgecap synth`")
    return truth


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("synth", type=pathlib.Path, nargs="+")
    ap.add_argument("folder", type=pathlib.Path)
    ap.add_argument("--limit", type=int, default=0)
    ap.add_argument("--size", type=lambda s: tuple(map(int, s.split("x"))), default=(512, 320), help="of the scenes; larger ones for people close by")
    a = ap.parse_args(argv)
    width, height = a.size
    # with where their picture is
    frames = [dict(f, file=folder / f["file"]) for folder in a.synth for f in load(folder / "truth.json")["frames"] if f.get("file")][: a.limit or None]
    if not frames:
        raise SystemExit(f"expected frames with pictures in {', '.join(map(str, a.synth))}, found none: run `edgecap synth` without --clip")
    # composites.py and photo_truth.py write the same format, of pictures under other terms than those of scenes
    if flat := next((f for f in frames for p in f["people"] if not np.any(p["joints3d"])), None):
        raise SystemExit(f"expected people in 3D, as `edgecap synth` renders them, found some without in {flat['file'].parent}: photos and composites are no scenes")
    # those in front of the camera with anything to see
    people = [[p for p in f["people"] if any(p["visibility"][:NJ]) and p["joints3d"][ROOT][2] > 0.3] for f in frames]
    n, room = len(frames), max(1, *map(len, people))
    shapes = dict(
        image=((3, height, width), np.uint8),
        joints2d=((room, NJ, 2), np.float32),
        visible=((room, NJ), np.uint8),
        joints3d=((room, NB, 3), np.float32),
        rel3d=((room, NB, 3), np.float32),
        size_px=((room,), np.float32),
        K=((3, 3), np.float32),
    )
    clear(a.folder)  # training would take what is still black for scenes
    out = {k: np.lib.format.open_memmap(a.folder / f"{k}.npy", "w+", shapes[k][1], (n, *shapes[k][0])) for k in FIELDS}
    for i, f in enumerate(frames):
        image, s, du, dv = letterbox(np.asarray(Image.open(f["file"]).convert("RGB")), width, height)
        out["image"][i] = image[0].round().to(torch.uint8).numpy()
        c = f["camera"]
        out["K"][i] = [[c["fx"] * s, 0, c["cx"] * s + du], [0, c["fy"] * s, c["cy"] * s + dv], [0, 0, 1]]
        for k, p in enumerate(people[i]):
            j3 = torch.tensor(p["joints3d"], dtype=torch.float32)
            out["joints2d"][i, k] = np.array(p["joints2d"][:NJ], np.float32) * s + np.array([du, dv], np.float32)
            out["visible"][i, k] = p["visibility"][:NJ]
            out["joints3d"][i, k] = j3.numpy()
            out["rel3d"][i, k] = canonical(j3[None], torch.tensor([p["stature"]]))[0].numpy()
            out["size_px"][i, k] = c["fx"] * s * p["stature"] / p["joints3d"][ROOT][2]
    for v in out.values():
        v.flush()
    (a.folder / "filled").write_text(str(n))
    terms.mark(a.folder, terms.RENDERED)
    print(f"{n} scenes, {(out['size_px'] > 0).sum()} people, at most {room} in one")


if __name__ == "__main__":
    main(sys.argv[1:])
