"""Photos of one labelled person each as whole camera frames, to measure with: python framed.py DATA/people2d OUT [--tall 150 | --cut hips].

`edgecap infer` scales every picture to the network's input, so a small photo makes a large person. Here every photo lies on a grey frame of the
network's size, scaled so that its person is `--tall` pixels: `edgecap infer --input OUT/lsp`, then `edgecap eval --truth OUT/annotations.json --split test`.

`--cut` takes upright people as somebody before a screen is seen: the frame ends below their hips or in the middle of their thighs, and a quarter of it
lies above their heads. These photos are enlarged several times for that, so they are blurred.
"""

from __future__ import annotations

import argparse
import json
import pathlib
import sys

import numpy as np
from PIL import Image

from skeleton import limb_chain

FRAME = (512, 320)
GREY = (114, 114, 114)
CUTS = {"hips": 0.1, "thighs": 0.5}  # where the frame ends, as a share of the way from hips to knees
ABOVE = 0.25  # share of the frame above the head
UPRIGHT = 0.9  # cosine of the most that somebody leans


def frame(picture: Image.Image, joints: np.ndarray, tall: float) -> tuple[Image.Image, np.ndarray]:
    """The photo in the middle of a grey frame, and its joints [14, 3] there. The person, from head top to ankle along the limbs, is `tall` pixels,
    or less where the photo would not fit."""
    w, h = picture.size
    scale = min(tall / float(limb_chain(joints[None])[0]), FRAME[0] / w, FRAME[1] / h)
    size = (max(1, round(w * scale)), max(1, round(h * scale)))
    at = ((FRAME[0] - size[0]) // 2, (FRAME[1] - size[1]) // 2)
    out = Image.new("RGB", FRAME, GREY)
    out.paste(picture.resize(size, Image.Resampling.BICUBIC), at)
    moved = joints.copy()
    for k in range(2):  # pixel centres at integers: scale about the photo's corner, not about pixel 0
        moved[:, k] = (joints[:, k] + 0.5) * size[k] / picture.size[k] - 0.5 + at[k]
    return out, moved


def cut_off(picture: Image.Image, joints: np.ndarray, where: str) -> tuple[Image.Image, np.ndarray] | None:
    """A frame of which somebody fills three quarters down to a cut, and the joints [14, 3] there, those beyond it without label; `None` for people who do
    not stand or sit upright."""
    top, hips, knees = joints[0, :2], joints[[8, 11], :2].mean(0), joints[[9, 12], :2].mean(0)
    down = hips - top
    if down[1] < UPRIGHT * np.hypot(*down):
        return None
    end = hips[1] + CUTS[where] * max(knees[1] - hips[1], 0.2 * down[1])
    scale = (1 - ABOVE) * FRAME[1] / (end - top[1])
    at = np.array([0.5 * (top[0] + hips[0]) + 0.5 - 0.5 * FRAME[0] / scale, end + 0.5 - FRAME[1] / scale])  # the frame's corner in the photo
    # Pillow takes pixel centres at halves
    out = picture.transform(FRAME, Image.Transform.AFFINE, (1 / scale, 0, at[0], 0, 1 / scale, at[1]), Image.Resampling.BICUBIC, fillcolor=GREY)
    moved = joints.copy()
    moved[:, :2] = (joints[:, :2] + 0.5 - at) * scale - 0.5
    moved[:, 2] *= ((moved[:, :2] >= 0) & (moved[:, :2] < FRAME)).all(1)
    return out, moved


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("people", type=pathlib.Path, help="folder with annotations.json (file, split, joints)")
    ap.add_argument("out", type=pathlib.Path)
    ap.add_argument("--tall", type=float, default=150, help="pixels from head top to ankle")
    ap.add_argument("--cut", choices=CUTS, help="people close to the camera instead")
    ap.add_argument("--split", default="test")
    a = ap.parse_args(argv)
    if a.tall <= 0:
        ap.error(f"expected a person of more than 0 pixels, found {a.tall}")
    rows, heights, left_out = [], [], 0
    for x in json.loads((a.people / "annotations.json").read_text()):
        joints = np.array(x["joints"], np.float32)
        if x["split"] != a.split:
            continue
        if (joints[:, 2] == 0).any():
            left_out += 1
            continue
        photo = Image.open(a.people / x["file"]).convert("RGB")
        framed = cut_off(photo, joints, a.cut) if a.cut else frame(photo, joints, a.tall)
        if framed is None:
            continue
        picture, moved = framed
        file = pathlib.Path(x["file"]).with_suffix(".png")
        (a.out / file).parent.mkdir(parents=True, exist_ok=True)
        picture.save(a.out / file, compress_level=1)
        rows.append({"file": str(file), "split": a.split, "joints": moved.round(2).tolist()})
        heights.append(float(limb_chain(moved[None])[0]))
    if not rows:
        raise SystemExit(f"expected photos of split {a.split} with all joints labelled in {a.people}, found none")
    (a.out / "annotations.json").write_text(json.dumps(rows))
    print(f"{len(rows)} frames, people of {min(heights):.0f} to {max(heights):.0f} px, median {np.median(heights):.0f}; {left_out} photos without all joints labelled left out")


if __name__ == "__main__":
    main(sys.argv[1:])
