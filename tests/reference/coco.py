"""Compares `edgecap eval` with pycocotools on the same predictions.

    pip install pycocotools
    python coco.py EDGECAP [--truth COCO.json --predictions P.jsonl]

Without truth and predictions: random ones, with joints that are missing or not seen, crowds, people without labels, false and doubled predictions.
Exits with 1 when a figure differs by more than 1e-6.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import io
import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

NAMES = ["nose", "left_eye", "right_eye", "left_ear", "right_ear"]
NAMES += [f"{s}_{j}" for j in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle") for s in ("left", "right")]
OURS = [None] * 5 + [5, 2, 6, 3, 7, 4, 11, 8, 12, 9, 13, 10]
SIGMAS = np.array([26, 25, 25, 35, 35, 79, 79, 72, 72, 62, 62, 107, 107, 87, 87, 89, 89]) / 1000
NOWHERE = -1e6


def random_case(seed: int, pictures: int = 60) -> tuple[dict, list[dict]]:
    g = np.random.default_rng(seed)
    truth = dict(images=[], annotations=[], categories=[dict(id=1, name="person", keypoints=NAMES)])
    lines = []
    for i in range(pictures):
        name = f"{i:05}.jpg"
        truth["images"].append(dict(id=i + 1, file_name=name, width=640, height=480))
        people = []
        for _ in range(g.integers(0, 5)):
            size = g.uniform(40, 300)
            at = g.uniform([50, 50], [590, 430])
            xy = at + size * g.uniform(-0.5, 0.5, (17, 2))
            v = g.choice([0, 1, 2], 17, p=[0.2, 0.2, 0.6]) if g.random() > 0.1 else np.zeros(17, int)
            low, high = xy.min(0), xy.max(0)
            truth["annotations"].append(
                dict(
                    id=len(truth["annotations"]) + 1,
                    image_id=i + 1,
                    category_id=1,
                    iscrowd=int(g.random() < 0.08),
                    area=float(size**2 * 0.5),
                    bbox=[*map(float, low), *map(float, high - low)],
                    num_keypoints=int((v > 0).sum()),
                    keypoints=[float(x) for p, s in zip(xy, v) for x in (*(p * (s > 0)), s)],
                )
            )
            for _ in range(g.choice([0, 1, 2], p=[0.2, 0.7, 0.1])):
                noise = size * g.choice([0.01, 0.04, 0.15])
                joints = np.zeros((14, 3))
                for k, j in enumerate(OURS):
                    if j is not None and g.random() > 0.15:
                        joints[j] = *(xy[k] + noise * g.normal(size=2)), g.choice([0, g.uniform(0.3, 1)], p=[0.1, 0.9])
                people.append(joints)
        for _ in range(g.integers(0, 2)):
            people.append(np.column_stack([g.uniform(0, 480, (14, 2)), np.full(14, 0.5)]))
        lines.append(
            dict(
                frame=i,
                time_ns=0,
                source=f"somewhere/{name}",
                width=640,
                height=480,
                people=[dict(score=float(g.random()), joints2d=p.tolist(), joints3d=np.zeros((21, 3)).tolist()) for p in people],
            )
        )
    return truth, lines


def theirs(truth: dict, lines: list[dict], keep: list[int]) -> dict[str, float]:
    """pycocotools over the keypoints `keep`; a joint that was not predicted is put far away."""
    truth = copy.deepcopy(truth)
    for a in truth["annotations"]:
        k = np.array(a["keypoints"]).reshape(17, 3)[keep]
        a["keypoints"], a["num_keypoints"] = k.flatten().tolist(), int((k[:, 2] > 0).sum())
    ids = {i["file_name"]: i["id"] for i in truth["images"]}
    found = []
    for line in lines:
        name = line["source"].rsplit("/", 1)[-1]
        for p in line["people"] if name in ids else []:
            q = np.full((17, 3), NOWHERE)
            for k, j in enumerate(OURS):
                if j is not None and any(p["joints2d"][j]):
                    # as single precision, which the predictions are read in
                    q[k] = np.float32(p["joints2d"][j])
            found.append(dict(image_id=ids[name], category_id=1, score=p["score"], keypoints=q[keep].flatten().tolist()))
    with contextlib.redirect_stdout(io.StringIO()):
        gt = COCO()
        gt.dataset = truth
        gt.createIndex()
        e = COCOeval(gt, gt.loadRes(found), "keypoints")
        e.params.kpt_oks_sigmas = SIGMAS[keep]
        e.params.areaRng, e.params.areaRngLbl = [[0, 1e30]], ["all"]  # far joints make boxes huge
        e.evaluate()
        e.accumulate()
    p, r = e.eval["precision"][..., 0, 0], e.eval["recall"][:, 0, 0, 0]
    return dict(ap=p.mean(), ap50=p[0].mean(), ap75=p[5].mean(), ar=r.mean(), ar50=r[0])


def ours(binary: str, truth: dict, lines: list[dict], joints: str) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as d:
        t, p = pathlib.Path(d, "truth.json"), pathlib.Path(d, "p.jsonl")
        t.write_text(json.dumps(truth))
        p.write_text("\n".join(map(json.dumps, lines)))
        out = subprocess.run(
            [binary, "eval", "--truth", t, "--predictions", p, "--joints", joints, "--json", "-"],
            check=True,
            capture_output=True,
        )
    return json.loads(out.stdout)["coco"]


def main() -> int:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("edgecap")
    ap.add_argument("--truth", type=pathlib.Path)
    ap.add_argument("--predictions", type=pathlib.Path)
    a = ap.parse_args()
    if a.truth:
        cases = [(json.loads(a.truth.read_text()), [json.loads(x) for x in a.predictions.read_text().splitlines() if x])]
    else:
        cases = [random_case(seed) for seed in range(8)]
    worst = 0.0
    for truth, lines in cases:
        for joints, keep in (("shared", list(range(5, 17))), ("all", list(range(17)))):
            t, o = theirs(truth, lines, keep), ours(a.edgecap, truth, lines, joints)
            worst = max(worst, *(abs(t[k] - o[k]) for k in t))
            print(joints, {k: (round(float(t[k]), 6), round(o[k], 6)) for k in t})
    print("largest difference", worst)
    return int(worst > 1e-6)


if __name__ == "__main__":
    sys.exit(main())
