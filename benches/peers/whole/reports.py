"""What a system wrote goes in; the people that it reported come out, by picture: arrays of LIMBS, [12, 2] pixels.

Ours are the JSON lines of `edgecap infer`; a peer's are `{"source": ..., "limbs": [...]}`.
"""

import json
from pathlib import Path

import numpy as np

from whole.labels import FROM_EVIDENCE


def read(file: Path) -> dict[str, list[np.ndarray]]:
    """People by the picture's file name."""
    found = {}
    for line in file.read_text().splitlines():
        told = json.loads(line)
        if "limbs" in told:
            people = [np.array(p, float) for p in told["limbs"]]
        else:
            people = [_ours(np.array(p["joints2d"], float)) for p in told["people"]]
        found[Path(str(told["source"])).name] = people
    return found


def _ours(joints: np.ndarray) -> np.ndarray:
    """A joint that says nothing is 0, 0 with confidence 0."""
    limbs = joints[FROM_EVIDENCE]
    return np.where(limbs.any(1, keepdims=True), limbs[:, :2], np.nan)


def people(lines: list[str]) -> int:
    """People reported in all these lines."""
    told = map(json.loads, lines)
    return sum(len(t["limbs"] if "limbs" in t else t["people"]) for t in told)
