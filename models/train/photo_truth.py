"""Photos of `everyday.py`, as files with truth: python photo_truth.py EVERYDAY FOLDER [--n 900] [--seed 5].

Written as `truth.json` of `edgecap synth`, for `examples/association_candidates`: whoever is labelled counts, people of
whom nothing is sure neither count nor are wrong, and whatever else is found is nobody. There is no 3D truth (zeros),
and photos are of any size (0).
"""

from __future__ import annotations

import argparse
import json
import pathlib
import sys

import numpy as np

from coco17 import ABSENT, LABELLED, UNKNOWN, to14
from composites import HIDDEN, OUTSIDE, VISIBLE, person
from everyday import LEAST, STANDING
from everyday_tiles import Everyday


def codes(state: np.ndarray, joints: np.ndarray, box: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What is known of joints [P, 14], at pixels [P, 14, 2] of people in boxes [P, 4] -> joints [P, 14, 2], pixels,
    and the codes of `truth.json` [P, 14].

    A joint that is not known is hidden where its place is a guess inside the person's box. A place elsewhere means
    nothing, as COCO's 0, 0 of joints without a label: it would make the person as large as the way there. People of
    whom too little is known have nothing visible and nothing outside, so that they have a place in the picture: what
    is not in their box is put where somebody upright has it.
    """
    inside = ((joints >= box[:, None, :2]) & (joints <= box[:, None, 2:])).all(-1)
    guess = np.where(inside, HIDDEN, OUTSIDE)
    c = np.where(state == LABELLED, VISIBLE, np.where(state == ABSENT, OUTSIDE, guess))
    enough = (state == LABELLED).sum(-1, keepdims=True) >= LEAST
    size = box[:, 2:] - box[:, :2]
    standing = box[:, None, :2] + STANDING * size[:, None]
    standing, _ = to14(standing, np.full(standing.shape[:2], UNKNOWN, np.uint8))
    joints = np.where(enough[..., None] | inside[..., None], joints, standing)
    return joints, np.where(enough, c, HIDDEN)


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("everyday", type=pathlib.Path)
    ap.add_argument("folder", type=pathlib.Path)
    ap.add_argument("--n", type=int, default=900)
    ap.add_argument("--seed", type=int, default=5)
    a = ap.parse_args(argv)
    e = Everyday(a.everyday, a.seed)
    a.folder.mkdir(parents=True, exist_ok=True)
    share = e.weight.numpy() / e.weight.sum().item()
    ids = np.sort(np.random.default_rng(a.seed).choice(len(share), min(a.n, len(share)), replace=False, p=share.astype(np.float64) / share.sum(dtype=np.float64)))
    frames = []
    for k, i in enumerate(ids):
        name = f"{k:06}.jpg"
        (a.folder / name).write_bytes(e.pictures[e.offset[i] : e.offset[i + 1]].tobytes())
        own = slice(e.start[i], e.start[i + 1])
        joints, known = codes(e.state[own].numpy(), e.joints[own].numpy(), e.box[own].numpy())
        people = [person(p + 1, joints[p], known[p]) for p in range(len(joints))]
        frames.append(dict(frame=k, time_ns=0, file=name, camera=dict(fx=512, fy=512, cx=255.5, cy=159.5), people=people))
    truth = dict(format="edgecap-truth", version=1, seed=a.seed, width=0, height=0, fps=0, frames=frames)
    (a.folder / "truth.json").write_text(json.dumps(truth))
    print(f"{len(frames)} photos, {sum(len(f['people']) for f in frames)} people")


if __name__ == "__main__":
    main(sys.argv[1:])
