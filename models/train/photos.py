"""Photos of several people with public labels (COCO, CrowdPose, OCHuman, MPII), to measure on: the 12 joints they share with ours."""

from __future__ import annotations

import json
import pathlib
from dataclasses import dataclass, field

import numpy as np
from PIL import Image

# Shared joints in our order: shoulder, elbow, wrist right and left, hip, knee, ankle right and left.
SHARED = [2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13]
NAMES = ["right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist"]
NAMES += ["right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle"]
# COCO's per-joint constants (twice its sigmas enter as 2 sigma) for those joints
SIGMA = np.array([0.079, 0.072, 0.062] * 2 + [0.107, 0.087, 0.089] * 2, np.float32)
MPII = [12, 11, 10, 13, 14, 15, 2, 1, 0, 3, 4, 5]  # r/l shoulder.. in the 16-joint order


@dataclass
class Person:
    """`joints` [12, 3] pixels and label (0 none, 1 hidden, 2 visible); `area` pixels²; `box` x, y, width, height."""

    joints: np.ndarray
    area: float
    box: np.ndarray


@dataclass
class Photo:
    name: str
    image: np.ndarray
    people: list[Person]
    complete: bool  # everybody is labelled: what is found elsewhere is false, but where somebody is `ignored`
    # x, y, width, height of crowds and of people without labels.
    ignored: list[np.ndarray] = field(default_factory=list)


def _coco(folder: pathlib.Path) -> list[Photo]:
    d = json.loads((folder / "annotations.json").read_text())
    names = d["categories"][0]["keypoints"]
    order = [names.index(f"{side}_{part}") for side, part in (n.split("_") for n in NAMES)]
    out = []
    for im in d["images"]:
        people, ignored = [], []
        for a in d["annotations"]:
            if a["image_id"] != im["id"]:
                continue
            k = np.array(a.get("keypoints") or [0] * 3 * len(names), np.float32).reshape(-1, 3)[order]
            box = np.array(a["bbox"], np.float32)
            if a.get("iscrowd") or not (k[:, 2] > 0).any():
                ignored.append(box)
            else:
                people.append(Person(k, float(a.get("area") or 0.53 * box[2] * box[3]), box))
        image = np.asarray(Image.open(folder / im["file_name"]).convert("RGB"))
        out.append(Photo(im["file_name"], image, people, True, ignored))
    return out


def _mpii(folder: pathlib.Path) -> list[Photo]:
    found: dict[str, list[Person]] = {}
    for a in json.loads((folder / "annotations.json").read_text()):
        # MATLAB's numbers: its first pixel is 1, ours 0
        j = np.array(a["joints"], np.float32)[MPII] - 1
        v = np.array(a["joints_vis"], np.float32)[MPII]
        s = 200 * a["scale"]
        lo, hi = j[v > 0].min(0), j[v > 0].max(0)
        people = found.setdefault(a["image"], [])
        people.append(Person(np.concatenate([j, 2 * v[:, None]], 1), 0.25 * s * s, np.concatenate([lo, hi - lo])))
    # MPII labels some of the people in a photo
    return [Photo(n, np.asarray(Image.open(folder / n).convert("RGB")), p, False) for n, p in sorted(found.items())]


def load(folder: pathlib.Path) -> list[Photo]:
    return [p for n in ("coco", "crowdpose", "ochuman") for p in _coco(folder / n)] + _mpii(folder / "mpii")


def oks(found: np.ndarray, person: Person) -> float:
    """Object keypoint similarity over the labelled shared joints; `found` [14, 3], joints that were not found count as 0."""
    q, k = found[SHARED], person.joints
    on = k[:, 2] > 0
    d2 = ((q[:, :2] - k[:, :2]) ** 2).sum(1)
    e = np.exp(-d2 / (2 * person.area * (2 * SIGMA) ** 2 + 1e-9)) * (q[:, 2] > 0)
    return float(e[on].mean()) if on.any() else 0.0


def excused(found: np.ndarray, photo: Photo) -> bool:
    """Whether the middle of the joints found, of [14, 3], lies in the box of somebody who may be found or not."""
    seen = found[found[:, 2] > 0, :2]
    if not len(seen):
        return False
    u, v = seen.mean(0)
    return any(x <= u <= x + w and y <= v <= y + h for x, y, w, h in photo.ignored)


def match(pred: list[np.ndarray], photo: Photo, least: float = 0.1) -> tuple[np.ndarray, int]:
    """Similarity of every person's own report, 0 where it is below `least`, and how many reports are nobody's.

    The nearest pairs go first.
    """
    table = np.array([[oks(q, p) for p in photo.people] for q in pred]).reshape(len(pred), len(photo.people))
    best, own = np.zeros(len(photo.people)), np.zeros(len(pred), bool)
    while table.size and table.max() >= least:
        a, k = np.unravel_index(table.argmax(), table.shape)
        best[k], own[a] = table[a, k], True
        table[a], table[:, k] = 0, 0
    return best, sum(not excused(q, photo) for q, is_own in zip(pred, own) if not is_own)
