"""How likely reports are right: python confidence.py PEOPLE.jsonl LABELS.jsonl.gz [PEOPLE LABELS ...] --toml ../association.toml [--check].

`PEOPLE` is what `edgecap infer --quality balanced --jsonl` wrote of photos (of any quality with `--check`), `LABELS` what `everyday.py` reads. Fits
`[confidence]` of the TOML file on the photos of split `train`; with `--check` nothing is fitted, and the photos of split `test` are looked at. What the
program said is turned back into what it measured by the `[confidence]` that the file holds: it has to be the one that the program was built with. Prints the
expected calibration errors, and a line a bin.

A joint is right if it is within 0.2 of the torso of the label's: middle of the shoulders to middle of the hips, at least 0.15 of the box's height. Labels
whose two teachers agree (OKS 0.7) and have six sure joints count: of confidence 0.3 and spread 0.05. A person is right at OKS 0.5 with a label of their own,
sure or not; any other report is wrong, also a second one of somebody, and left out only where its middle lies in the box of somebody whose label is unsure.
Photos in which not everybody is labelled are left out.
"""

from __future__ import annotations

import argparse
import gzip
import json
import pathlib
import tomllib

import numpy as np

from person_score import written

OURS = [2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13]  # limb joints of the evidence joints
COCO = [6, 8, 10, 5, 7, 9, 12, 14, 16, 11, 13, 15]  # the same joints among COCO's 17
SIGMA = np.array([0.079, 0.072, 0.062, 0.079, 0.072, 0.062, 0.107, 0.087, 0.089, 0.107, 0.087, 0.089])
INPUTS = (512, 320), (368, 368), (256, 409.6)  # what a photo fits into with --quality balanced: landscape, square, upright
SQUARE = 1.15  # sides of a photo that is looked at as a square one, the longer over the shorter
LEAST, SIZE, SMALLEST = 0.01, 200.0, 20.0  # as src/detect/confidence.rs has them
KEYS = ("joint_bias", "joint_slope", "joint_size", "person_bias", "person_slope")
BINS = 10


def logit(p: np.ndarray) -> np.ndarray:
    p = np.clip(p, LEAST, 1 - LEAST)
    return np.log(p / (1 - p))


def exact_logit(p: np.ndarray) -> np.ndarray:
    p = np.clip(p, 1e-6, 1 - 1e-6)
    return np.log(p / (1 - p))


def logistic(x: np.ndarray) -> np.ndarray:
    return 1 / (1 + np.exp(-x))


def size_term(joints: np.ndarray, scale: float) -> float:
    """Logarithm of the size of a person, [14, 3] in pixels of the photo, over 200 px of the input."""
    seen = joints[joints[:, 2] > 0, :2] * scale
    return float(np.log(max(np.hypot(*np.ptp(seen, axis=0)), SMALLEST) / SIZE))


def similarity(report: np.ndarray, label: np.ndarray, counts: np.ndarray, area: float) -> float:
    """OKS of [12, 3] with [12, 3]."""
    if not counts.any():
        return 0.0
    square = np.square(report[:, :2] - label[:, :2]).sum(1)
    close = np.where(report[:, 2] > 0, np.exp(-square / (2 * np.square(2 * SIGMA) * area)), 0)
    return float(close[counts].mean())


def matched(similar: np.ndarray) -> dict[int, int]:
    """[labels, reports] -> report: label, the most similar first."""
    mine: dict[int, int] = {}
    for i, j in sorted(np.ndindex(*similar.shape), key=lambda t: -similar[t]):
        if similar[i, j] > 0.05 and j not in mine and i not in mine.values():
            mine[j] = i
    return mine


def sure(person: dict, counts: np.ndarray) -> bool:
    """Whether what does not fit this label is wrong; `counts` [12] says which of its joints are sure."""
    return person.get("agree", 0) >= 0.7 and counts.sum() >= 6


def within(box: list[float], at: np.ndarray) -> bool:
    return box[0] <= at[0] <= box[2] and box[1] <= at[1] <= box[3]


def collect(people: pathlib.Path, labels: pathlib.Path, split: str, now: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Joints [n, 3] (logit of the peak, term of the size, right) and people [m, 2] (logit of the similarity, right)."""
    found = {}
    with open(people) as lines:
        for row in map(json.loads, lines):
            found[pathlib.Path(row["source"]).name] = [(p["score"], np.array(p["joints2d"])) for p in row["people"]]
    joints, persons = [], []
    with gzip.open(labels, "rt") as lines:
        for photo in map(json.loads, lines):
            if photo.get("split") != split or photo["file"] not in found or photo.get("more"):
                continue
            size, reports = np.array(photo["size"], float), found[photo["file"]]
            wide, high = INPUTS[0 if size[0] > SQUARE * size[1] else 2 if size[1] > SQUARE * size[0] else 1]
            scale = min(wide / size[0], high / size[1])
            truth = []
            for p in (p for p in photo["people"] if "kp" in p):
                at = np.array(p["kp"])[COCO] * [*size, 1]
                truth.append((p, at, (at[:, 2] >= 0.3) & (np.array(p["spread"])[COCO] <= 0.05)))
            doubted = [p["box"] for p in photo["people"] if "kp" not in p] + [p["box"] for p, _, counts in truth if not sure(p, counts)]
            similar = np.zeros((len(truth), len(reports)))
            for i, (p, at, counts) in enumerate(truth):
                x0, y0, x1, y1 = p["box"]
                for j, (_, r) in enumerate(reports):
                    similar[i, j] = similarity(r[OURS], at, counts, (x1 - x0) * (y1 - y0) * size.prod() * 0.53)
            mine = matched(similar)
            for j, (score, r) in enumerate(reports):
                right = j in mine and similar[mine[j], j] >= 0.5
                middle = r[OURS][r[OURS][:, 2] > 0, :2].mean(0) / size
                if right or not any(within(b, middle) for b in doubted):
                    persons.append(((exact_logit(score) - now["person_bias"]) / now["person_slope"], right))
            for j, i in mine.items():
                p, at, counts = truth[i]
                if not sure(p, counts):
                    continue
                torso = np.hypot(*(at[[0, 3], :2].mean(0) - at[[6, 9], :2].mean(0)))
                torso = max(torso, 0.15 * (p["box"][3] - p["box"][1]) * size[1])
                term = size_term(reports[j][1], scale)
                for k, o in enumerate(reports[j][1][OURS]):
                    if counts[k] and o[2] > 0:
                        peak = (exact_logit(o[2]) - now["joint_bias"] - now["joint_size"] * term) / now["joint_slope"]
                        joints.append((peak, term, np.hypot(*(o[:2] - at[k, :2])) < 0.2 * torso))
    return np.array(joints, float), np.array(persons, float)


def fit(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Logistic regression by Newton's steps: bias and weights."""
    x = np.column_stack([np.ones(len(x)), x])
    w = np.zeros(x.shape[1])
    for _ in range(50):
        p = logistic(x @ w)
        step = np.linalg.solve((x * (p * (1 - p))[:, None]).T @ x + 1e-6 * np.eye(len(w)), x.T @ (y - p))
        w += step
        if np.abs(step).max() < 1e-9:
            break
    return w


def expected_error(p: np.ndarray, y: np.ndarray) -> tuple[float, list[str]]:
    """Expected calibration error over ten bins, and a line a bin."""
    which = np.minimum((p * BINS).astype(int), BINS - 1)
    error, lines = 0.0, []
    for k in range(BINS):
        m = which == k
        if m.any():
            error += m.mean() * abs(p[m].mean() - y[m].mean())
            lines.append(f"  said {p[m].mean():.2f}, right {y[m].mean():.2f}, of {m.sum()}")
    return error, lines


def main() -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("files", nargs="+", type=pathlib.Path, metavar="PEOPLE LABELS")
    ap.add_argument("--toml", required=True, type=pathlib.Path)
    ap.add_argument("--check", action="store_true")
    a = ap.parse_args()
    if len(a.files) % 2:
        ap.error(f"expected a file of labels for every file of people, found {len(a.files)} files")
    now = tomllib.loads(a.toml.read_text())["confidence"]
    pairs = list(zip(a.files[::2], a.files[1::2]))
    sets = [collect(people, labels, "test" if a.check else "train", now) for people, labels in pairs]
    joints, persons = (np.concatenate([s[k] for s in sets]) for k in (0, 1))
    if not a.check:
        # The program takes heights nearer to 0 and 1 than `LEAST` for that.
        w = np.concatenate([fit(np.column_stack([logit(logistic(joints[:, 0])), joints[:, 1]]), joints[:, 2]), fit(logit(logistic(persons[:, :1])), persons[:, 1])])
        now = {key: round(float(v), 3) for key, v in zip(KEYS, w)}
        a.toml.write_text(written(a.toml.read_text(), now))
        print("\n".join(f"{k} = {v}" for k, v in now.items()))

    def said(joints: np.ndarray, persons: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        of_joints = now["joint_bias"] + now["joint_slope"] * logit(logistic(joints[:, 0])) + now["joint_size"] * joints[:, 1]
        return logistic(of_joints), logistic(now["person_bias"] + now["person_slope"] * logit(logistic(persons[:, 0])))

    for what, k in (("joints", 0), ("people", 1)):
        p = said(joints, persons)[k]
        error, lines = expected_error(p, (joints, persons)[k][:, -1])
        each = ", ".join(f"{expected_error(said(*s)[k], s[k][:, -1])[0]:.3f}" for s in sets)
        print(f"{what}: expected calibration error {error:.3f} ({each}), said {p.mean():.3f}, right {(joints, persons)[k][:, -1].mean():.3f}")
        print("\n".join(lines))


if __name__ == "__main__":
    main()
