"""Files of labels go in, the labelled people of every picture come out. Three formats, told apart by their looks:

- COCO's keypoints (`images`, `annotations`, `categories`);
- a list of pictures of one person each with `file`, `split` and 14 `joints` (Leeds Sports Pose);
- JSON lines, perhaps gzipped, of `file`, `split`, `size` and `people` with `box`, `kp`, `spread` and `agree`, labels of
  two teachers, and with `true`, where COCO's own are known; `more` people are there without labels. Coordinates are
  shares of width and height.
"""

import gzip
import json
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np

# The joints that are compared, by COCO's names and in its order; its nose, eyes and ears come before them.
PARTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
LIMBS = [f"{side}_{part}" for part in PARTS for side in ("left", "right")]
FACE = 5
# Where LIMBS stand among the 14 joints of the project and of Leeds Sports Pose here: head top, neck, right arm, left
# arm, right leg, left leg.
FROM_EVIDENCE = [5, 2, 6, 3, 7, 4, 11, 8, 12, 9, 13, 10]
# Area of a person over that of its box, where no area is given: COCO's mean.
AREA_OF_BOX = 0.53
# Labelled joints from which on a person is judged.
ENOUGH = 6
# Teachers' labels: least confidence and largest spread of a joint, least agreement of the two on a person.
CONFIDENCE, SPREAD, AGREE = 0.3, 0.05, 0.7


@dataclass
class Person:
    """LIMBS in pixels, which of them are labelled, area in square pixels, box as left, top, right, bottom."""

    joints: np.ndarray
    labelled: np.ndarray
    area: float
    box: np.ndarray
    judged: bool


@dataclass
class Picture:
    """A file's name and who is labelled in it: `everybody`, or some, and other reports cannot be judged."""

    name: str
    people: list[Person]
    everybody: bool = True


def read(file: Path, split: str = "test", true: bool = False) -> list[Picture]:
    """`split` is the part wanted where the format has parts; `true` wants COCO's own labels of JSON lines."""
    raw = file.read_bytes()
    text = (gzip.decompress(raw) if file.suffix == ".gz" else raw).decode()
    first = text.lstrip()[:1]
    if first == "[":
        return [_sports(d) for d in json.loads(text) if d["split"] == split]
    if '"annotations"' in text:
        return _coco(json.loads(text))
    lines = [d for d in map(json.loads, text.splitlines()) if d["split"] == split]
    if true:
        lines = [d for d in lines if any("true" in p for p in d["people"])]
    return [_shares(d, true) for d in lines]


def _person(joints: np.ndarray, labelled: np.ndarray, box: np.ndarray, sure: bool = True, area: float = 0.0) -> Person:
    width, height = np.maximum(box[2:] - box[:2], 0)
    area = area or max(float(width * height) * AREA_OF_BOX, 1.0)
    return Person(joints[:, :2], labelled, area, box, sure and int(labelled.sum()) >= ENOUGH)


def _sports(entry: dict) -> Picture:
    every = np.array(entry["joints"], float)
    known = every[every[:, 2] > 0, :2]
    joints = every[FROM_EVIDENCE]
    box = np.concatenate([known.min(0), known.max(0)])
    return Picture(Path(entry["file"]).name, [_person(joints, joints[:, 2] > 0, box)], everybody=False)


def _coco(file: dict) -> list[Picture]:
    order = {c["id"]: [c["keypoints"].index(name) for name in LIMBS] for c in file["categories"] if c.get("keypoints")}
    people = defaultdict(list)
    for a in file["annotations"]:
        if a["category_id"] not in order:
            continue
        joints = np.array(a["keypoints"], float).reshape(-1, 3)[order[a["category_id"]]]
        left, top, width, height = a["bbox"]
        labelled = (joints[:, 2] > 0) & (not a.get("iscrowd"))
        box = np.array([left, top, left + width, top + height])
        people[a["image_id"]].append(_person(joints, labelled, box, area=a.get("area") or 0.0))
    return [Picture(Path(i["file_name"]).name, people[i["id"]]) for i in file["images"]]


def _shares(line: dict, true: bool) -> Picture:
    size = np.array(line["size"], float)
    people = [_labelled_by_teachers_or_coco(p, size, true) for p in line["people"]]
    return Picture(line["file"], people, everybody=not line.get("more"))


def _labelled_by_teachers_or_coco(person: dict, size: np.ndarray, true: bool) -> Person:
    box = np.array(person["box"]) * np.tile(size, 2)
    nothing = np.zeros((len(LIMBS), 3))
    if true:
        joints = np.array(person["true"], float)[FACE:] if "true" in person else nothing
        return _person(joints[:, :2] * size, joints[:, 2] > 0, box)
    if "kp" not in person:
        return _person(nothing, nothing[:, 0] > 0, box)
    joints, spread = np.array(person["kp"])[FACE:], np.array(person["spread"])[FACE:]
    labelled = (joints[:, 2] >= CONFIDENCE) & (spread <= SPREAD)
    return _person(joints[:, :2] * size, labelled, box, sure=person.get("agree", 0) >= AGREE)
