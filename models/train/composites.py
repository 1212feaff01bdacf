"""Real people pasted together into whole frames, as pictures with truth: python composites.py PACK FOLDER [--n 700] [--seed 5] [--close 0.25].

What training tiles are made of, written as `truth.json` of `edgecap synth`: pictures of several real people in which everybody is labelled, so
that whatever else is found is nobody.  So photos are never shown whole: bystanders are not labelled in them.  There is no 3D truth (zeros).
"""

from __future__ import annotations

import argparse
import json
import pathlib
import sys

import numpy as np
import torch
from PIL import Image

from augment import photometric
from real import People, load_photos
from skeleton import NB, NJ

WIDTH, HEIGHT = 512, 320
SIZE = (45, 480)  # stature in pixels; the tallest are cut off by the frame
PEOPLE = [0.0, 0.4, 0.3, 0.2, 0.1]  # probabilities of 0, 1, 2, ... people
CLOSE_SIZE, CLOSE_PEOPLE = (300, 900), [0.0, 0.7, 0.2, 0.1]  # as somebody before a screen is seen
VISIBLE, HIDDEN, OUTSIDE = 1, 3, 0


def visibility(joints: np.ndarray, labelled: np.ndarray, hidden: np.ndarray) -> np.ndarray:
    """[P, 14, 2] pixels, [P, 14] whether there is a label, and whether there is one of a joint behind somebody else
    -> the codes of `truth.json`. Where joints without a label lie means nothing: they are as those outside."""
    inside = (joints >= 0).all(-1) & (joints[..., 0] < WIDTH) & (joints[..., 1] < HEIGHT)
    return np.where(inside & labelled, VISIBLE, np.where(inside & hidden, HIDDEN, OUTSIDE))


def person(id_: int, joints: np.ndarray, codes: np.ndarray) -> dict[str, object]:
    """One person of `truth.json`; the joints that are no evidence joints lie at the neck, unseen."""
    at = np.concatenate([joints, np.repeat(joints[1:2], NB - NJ, 0)])
    return dict(
        id=id_,
        stature=1.7,
        joints3d=[[0.0] * 3] * NB,
        joints2d=np.round(at, 1).tolist(),
        visibility=codes.tolist() + [HIDDEN] * (NB - NJ),
    )


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("pack", type=pathlib.Path)
    ap.add_argument("folder", type=pathlib.Path)
    ap.add_argument("--n", type=int, default=700)
    ap.add_argument("--seed", type=int, default=5)
    ap.add_argument("--close", type=float, default=0.25, help="share of pictures of people close to the camera")
    ap.add_argument("--cache", type=pathlib.Path, help="folder for decoded photos")
    ap.add_argument("--tiny", action="store_true", help="few photos, to see that it runs")
    a = ap.parse_args(argv)
    a.folder.mkdir(parents=True, exist_ok=True)
    cpu = torch.device("cpu")
    photos = load_photos(a.pack, cpu, 20 if a.tiny else 0)
    people = People(a.pack, cpu, photos, a.seed, limit=40 if a.tiny else 0, cache=a.cache)
    g = torch.Generator().manual_seed(a.seed + 1)
    frames = []
    for i in range(0, a.n, 2):
        close = float(torch.rand((), generator=g)) < a.close
        b = people.batch(2, HEIGHT, WIDTH, CLOSE_SIZE if close else SIZE, CLOSE_PEOPLE if close else PEOPLE, close, whole=0.0)
        images = (photometric(b.image, g) * 255).round().to(torch.uint8).permute(0, 2, 3, 1).numpy()
        for k, image in enumerate(images):
            name = f"{i + k:06}.jpg"
            Image.fromarray(image).save(a.folder / name, quality=92)
            joints = b.joints2d[k].numpy()
            codes = visibility(joints, b.labelled[k].numpy(), b.hidden[k].numpy())
            there = [p for p in range(len(joints)) if b.size_px[k, p] > 0 and codes[p].any()]
            frames.append(
                dict(
                    frame=i + k,
                    time_ns=0,
                    file=name,
                    camera=dict(fx=WIDTH, fy=WIDTH, cx=(WIDTH - 1) / 2, cy=(HEIGHT - 1) / 2),
                    people=[person(p + 1, joints[p], codes[p]) for p in there],
                )
            )
    truth = dict(format="edgecap-truth", version=1, seed=a.seed, width=WIDTH, height=HEIGHT, fps=0, frames=frames)
    (a.folder / "truth.json").write_text(json.dumps(truth))
    print(f"{len(frames)} pictures, {sum(len(f['people']) for f in frames)} people")


if __name__ == "__main__":
    main(sys.argv[1:])
