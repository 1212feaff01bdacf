"""Photos of one labelled person each as whole camera frames, to measure with: python framed.py DATA/people2d OUT [--tall 150].

`edgecap infer` scales every picture to the network's input, so a small photo makes a large person. Here every photo lies on a grey frame of the
network's size, scaled so that its person is `--tall` pixels: `edgecap infer --input OUT/lsp`, then `edgecap eval --truth OUT/annotations.json --split test`.
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


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("people", type=pathlib.Path, help="folder with annotations.json (file, split, joints)")
    ap.add_argument("out", type=pathlib.Path)
    ap.add_argument("--tall", type=float, default=150, help="pixels from head top to ankle")
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
        picture, moved = frame(Image.open(a.people / x["file"]).convert("RGB"), joints, a.tall)
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
