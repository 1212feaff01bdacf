"""People close to the camera: windows of larger pictures with truth, to choose and measure with: python windows.py SYNTH OUT.

`edgecap synth --stills --width 1024 --height 640` renders people as tall as a frame and less; a window round somebody's head shows what a camera
at a desk or a kiosk sees. One window a picture, scaled to the network's size; truth comes along, what lies beyond the window is outside.
`--film` keeps one window for all pictures of a folder, round whoever shows their head most often: a film of a camera close by.
"""

from __future__ import annotations

import argparse
import json
import math
import pathlib
import sys

import numpy as np
from PIL import Image

from skeleton import NJ, ROOT
from truth import load

FRAME = (512, 320)
HEAD, NECK = 0, 1
OUTSIDE = 0
LARGEST = 1.3  # enlarging further blurs


def stature(person: dict, camera: dict) -> float:
    """Pixels that somebody would measure, standing upright where they are."""
    return camera["fx"] * person["stature"] / person["joints3d"][ROOT][2]


def window(person: dict, camera: dict, picture: tuple[int, int], tall: tuple[float, float], rng: np.random.Generator) -> tuple[float, float, float]:
    """Left and upper edge in pixels of the picture, and the scale that makes the person as tall as drawn from `tall`, as far as scale and picture allow."""
    wanted = math.exp(rng.uniform(math.log(tall[0]), math.log(tall[1])))
    scale = min(max(wanted / stature(person, camera), FRAME[0] / picture[0], FRAME[1] / picture[1]), LARGEST)
    size = (FRAME[0] / scale, FRAME[1] / scale)
    head = np.mean([person["joints2d"][HEAD], person["joints2d"][NECK]], 0)
    at = head - np.array(size) * [rng.uniform(0.25, 0.75), rng.uniform(0.15, 0.5)]
    left, upper = (float(min(max(at[k], 0.0), picture[k] - size[k])) for k in range(2))
    return left, upper, scale


def faces(frame: dict, least: float) -> list[dict]:
    """Those whose heads can be seen and who can be made `least` pixels tall."""
    return [p for p in frame["people"] if all(p["visibility"][: NECK + 1]) and stature(p, frame["camera"]) * LARGEST > least]


def most_seen(frames: list[dict], least: float) -> tuple[dict, dict] | None:
    """Whoever shows their head in most frames, as they are in the middle one of these, and its camera."""
    seen: dict[int, list[tuple[dict, dict]]] = {}
    for f in frames:
        for p in faces(f, least):
            seen.setdefault(p["id"], []).append((p, f["camera"]))
    if not seen:
        return None
    longest = max(seen.values(), key=len)
    return longest[len(longest) // 2]


def seen_through(people: list[dict], left: float, upper: float, scale: float) -> list[dict]:
    """The same people in a window's pixels; nobody is left of whom nothing shows."""
    out = []
    for p in people:
        # pixel centres lie at integers
        joints = (np.array(p["joints2d"]) + 0.5 - [left, upper]) * scale - 0.5
        inside = ((joints > -0.5) & (joints < np.array(FRAME) - 0.5)).all(1)
        codes = np.where(inside, p["visibility"], OUTSIDE).tolist()
        if not any(codes[:NJ]):
            continue
        q = p | dict(joints2d=joints.round(2).tolist(), visibility=codes)
        if "box" in p:
            box = (np.array(p["box"]).reshape(2, 2) - [left, upper]) * scale
            cut = box.clip(0, FRAME)
            share = float(np.prod(cut[1] - cut[0]) / max(np.prod(box[1] - box[0]), 1e-6))
            q |= dict(box=cut.round(1).ravel().tolist(), pixels=round(p["pixels"] * scale * scale * share, 2))
        out.append(q)
    return out


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("synth", type=pathlib.Path, nargs="+")
    ap.add_argument("out", type=pathlib.Path)
    ap.add_argument("--tall", type=float, nargs=2, default=(300, 900), help="stature in pixels of who stands before the camera")
    ap.add_argument("--seed", type=int, default=1)
    ap.add_argument("--film", action="store_true", help="one window for all pictures of a folder")
    a = ap.parse_args(argv)
    if not 0 < a.tall[0] <= a.tall[1]:
        ap.error(f"expected --tall LEAST MOST above 0, found {a.tall[0]:g} {a.tall[1]:g}")
    if a.film and len(a.synth) > 1:
        ap.error("expected one folder for a film, found several")
    rng = np.random.default_rng(a.seed)
    a.out.mkdir(parents=True, exist_ok=True)
    frames: list[dict] = []
    truth: dict = {}
    for folder in a.synth:
        truth = load(folder / "truth.json")
        picture = (truth["width"], truth["height"])
        kept = None
        if a.film:
            chosen = most_seen(truth["frames"], a.tall[0])
            if chosen is None:
                continue
            kept = window(*chosen, picture, tuple(a.tall), rng)
        for f in truth["frames"]:
            camera = f["camera"]
            there = faces(f, a.tall[0])
            if not (kept or there):
                continue
            left, upper, scale = kept or window(there[rng.integers(len(there))], camera, picture, tuple(a.tall), rng)
            edges = (left, upper, left + FRAME[0] / scale, upper + FRAME[1] / scale)
            file = f"{len(frames):06d}.png"
            shown = Image.open(folder / f["file"]).convert("RGB").resize(FRAME, Image.Resampling.BICUBIC, box=edges)
            shown.save(a.out / file, compress_level=1)
            through = camera | dict(
                fx=camera["fx"] * scale,
                fy=camera["fy"] * scale,
                cx=(camera["cx"] + 0.5 - left) * scale - 0.5,
                cy=(camera["cy"] + 0.5 - upper) * scale - 0.5,
            )
            frames.append(dict(frame=len(frames), time_ns=f["time_ns"] if a.film else 0, file=file, camera=through, people=seen_through(f["people"], left, upper, scale)))
    if not frames:
        raise SystemExit(f"expected people of at least {a.tall[0] / LARGEST:.0f} px with their heads in the picture, found none: render larger ones")
    (a.out / "truth.json").write_text(json.dumps(truth | dict(width=FRAME[0], height=FRAME[1], frames=frames)))
    print(f"{len(frames)} windows, {sum(len(f['people']) for f in frames)} people")


if __name__ == "__main__":
    main(sys.argv[1:])
