"""Depth that the finished system itself sees in photos of everyday life, lent like BlazePose's (depth.py).

    python pseudo_depth.py pictures EVERYDAY PHOTOS       # everybody whom depth.py would ask of, photos under numbers
    edgecap infer --quality best --input PHOTOS --jsonl PEOPLE.jsonl
    python pseudo_depth.py lend EVERYDAY PEOPLE.jsonl [--weights STAGE1.safetensors]

EVERYDAY is a folder of everyday.py and gets `depth.npz` (depth.py says what it holds). Stage II knows what poses people take and so corrects
Stage I, whose encodings of real people are shallow: what it answers is what Stage I is to say at once (self-training). Only people whose
reported joints agree with their labels lend. An open folder stays open where `--weights` are those of the program that was asked and open, too.
"""

from __future__ import annotations

import argparse
import json
import pathlib
import sys
from collections.abc import Iterable

import numpy as np
import torch

import body
import depth
import teacher
import terms
from coco17 import LABELLED
from skeleton import NECK, NJ

OURS = "depth of people in photos by edgecap itself"


def pictures(folder: pathlib.Path, out: pathlib.Path) -> int:
    """Writes every photo that somebody asked of is in as NUMBER.jpg; returns how many."""
    z = dict(np.load(folder / "people.npz"))
    files = np.memmap(folder / "pictures.bin", np.uint8, "r")
    photo = np.repeat(np.arange(len(z["size"])), np.diff(z["start"]))
    out.mkdir(parents=True, exist_ok=True)
    wanted = np.unique(photo[depth.asked(z)])
    for i in wanted:
        (out / f"{i:06d}.jpg").write_bytes(files[z["offset"][i] : z["offset"][i + 1]].tobytes())
    return len(wanted)


def view_aligned(joints: np.ndarray, neck: np.ndarray, lens: dict[str, float]) -> np.ndarray:
    """Joints [21, 3] in camera axes, turned so that z runs along the ray through the neck's pixel [2]."""
    ray = torch.tensor([[(neck[0] - lens["cx"]) / lens["fx"], (neck[1] - lens["cy"]) / lens["fy"], 1.0]], dtype=torch.float32)
    turned = joints @ body.ray_rotation(ray)[0].numpy().T
    return np.asarray(turned, np.float32)


def matched(people: list[dict], labels: np.ndarray) -> list[tuple[int, dict]]:
    """Rows of `labels` [n, 14, 3] (x, y, known) with the report that agrees best and closely enough to lend its depth; a report lends once."""
    found = []
    for row, label in enumerate(labels):
        for at, person in enumerate(people):
            share, mean = teacher.agreement(np.asarray(person["joints2d"], np.float32)[:NJ], label)
            if teacher.lends(share, mean, body.CANONICAL_STATURE_M):
                found.append((mean, row, at))
    used_rows: set[int] = set()
    used: set[int] = set()
    out = []
    for _, row, at in sorted(found):
        if row not in used_rows and at not in used:
            used_rows.add(row)
            used.add(at)
            out.append((row, people[at]))
    return out


def lend(folder: pathlib.Path, frames: Iterable[dict]) -> tuple[int, int]:
    """Writes depth.npz; returns how many people were asked of and how many lend."""
    z = dict(np.load(folder / "people.npz"))
    who, people = depth.asked(z), len(z["state"])
    rel3d, lifted = np.zeros((people, 21, 3), np.float16), np.zeros(people, bool)
    labels = np.concatenate([z["joints"], (z["state"] == LABELLED)[..., None]], 2).astype(np.float32)
    for frame in frames:
        name = pathlib.Path(frame["source"]).stem
        if not name.isdecimal() or int(name) >= len(z["size"]):
            raise SystemExit(f"expected a photo that `pictures` wrote of {folder}, found {frame['source']}: give infer that folder of photos")
        i = int(name)
        rows = who[(who >= z["start"][i]) & (who < z["start"][i + 1])]
        scale = np.array([frame["width"], frame["height"]]) / z["size"][i]
        if not np.allclose(scale, 1, atol=0.01):
            raise SystemExit(f"expected {frame['source']} of {tuple(z['size'][i])} pixels, found {frame['width']} x {frame['height']}: write the pictures again")
        for k, person in matched(frame["people"], labels[rows]):
            rel3d[rows[k]] = view_aligned(np.asarray(person["joints3d"], np.float32), np.asarray(person["joints2d"][NECK][:2]), frame["intrinsics"])
            lifted[rows[k]] = True
    depth.write(folder, rel3d, lifted)
    return len(who), int(lifted.sum())


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    sub = ap.add_subparsers(dest="what", required=True)
    p = sub.add_parser("pictures")
    p.add_argument("folder", type=pathlib.Path)
    p.add_argument("photos", type=pathlib.Path)
    q = sub.add_parser("lend")
    q.add_argument("folder", type=pathlib.Path)
    q.add_argument("people", type=pathlib.Path, help="what edgecap infer --jsonl wrote")
    q.add_argument("--weights", type=pathlib.Path, help="open ones that were asked, for a folder that is to stay open")
    a = ap.parse_args(argv)
    if a.what == "pictures":
        print(f"{pictures(a.folder, a.photos)} photos")
        return
    if a.weights:
        terms.require_open_weights(a.weights)
    with open(a.people) as lines:
        asked, lent = lend(a.folder, map(json.loads, lines))
    print(f"{asked} people asked of, {lent} lend depth")
    if terms.is_open(a.folder) and a.weights:
        rest = {k: v for k, v in terms.ingredients(a.folder).items() if k not in terms.DEPTH}
        terms.mark(a.folder, rest | {OURS: terms.OPEN + a.weights.name})
    elif terms.is_open(a.folder):
        terms.unmark(a.folder)
        print(f"{a.folder} is no longer open: no open --weights were named")


if __name__ == "__main__":
    main(sys.argv[1:])
