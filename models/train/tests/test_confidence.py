"""Which reports count as right and which as wrong. No data needed."""

from __future__ import annotations

import gzip
import json
import pathlib
import sys
import tempfile
import unittest

import numpy as np

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(KIT))

from confidence import COCO, OURS, collect, similarity

SIDE = 400.0
NOW = dict(joint_bias=0.0, joint_slope=1.0, joint_size=0.0, person_bias=0.0, person_slope=1.0)
# Somebody upright in the middle of the photo, 200 px tall: the twelve joints of `OURS`.
BODY = np.array(
    [[180, 140], [170, 180], [165, 215], [220, 140], [230, 180], [235, 215], [188, 210], [186, 255], [184, 300], [212, 210], [214, 255], [216, 300]], float
)
BOX = [0.4, 0.25, 0.6, 0.775]


def label(agree: float = 0.9, moved: tuple[float, float] = (0, 0), sure_joints: int = 12) -> dict:
    kp = np.full((17, 3), 0.5)
    kp[COCO, :2], kp[:, 2] = (BODY + moved) / SIDE, 0.9
    kp[COCO[sure_joints:], 2] = 0.1
    box = (np.array(BOX) + np.tile(moved, 2) / SIDE).tolist()
    return dict(box=box, kp=kp.tolist(), spread=[0.01] * 17, agree=agree)


def report(moved: tuple[float, float] = (0, 0), folded: float = 0.0, score: float = 0.9) -> dict:
    """What the program writes of somebody; `folded`: share of the way from each joint to the body's middle."""
    joints = np.zeros((14, 3))
    joints[OURS, :2] = BODY + folded * (BODY.mean(0) - BODY) + moved
    joints[OURS, 2] = 0.8
    return dict(score=score, joints2d=joints.tolist())


def said(reports: list[dict], labels: list[dict], **photo: object) -> list[float]:
    """Of every report that counts whether it is right."""
    with tempfile.TemporaryDirectory() as d:
        people, truth = pathlib.Path(d) / "people.jsonl", pathlib.Path(d) / "labels.jsonl.gz"
        people.write_text(json.dumps(dict(source="a.jpg", people=reports)) + "\n")
        with gzip.open(truth, "wt") as f:
            f.write(json.dumps(dict(file="a.jpg", size=[SIDE, SIDE], split="train", people=labels) | photo) + "\n")
        return collect(people, truth, "train", NOW)[1].reshape(-1, 2)[:, 1].tolist()


class Reports(unittest.TestCase):
    def test_a_bad_report_of_somebody_surely_labelled_is_wrong(self) -> None:
        folded = report(folded=0.55)
        b = np.array(BOX) * SIDE
        similar = similarity(np.array(folded["joints2d"])[OURS], np.column_stack([BODY, np.full(12, 0.9)]), np.ones(12, bool), (b[2] - b[0]) * (b[3] - b[1]) * 0.53)
        self.assertTrue(0.2 < similar < 0.4, similar)
        self.assertEqual(said([folded], [label()]), [0])

    def test_a_second_report_of_somebody_is_wrong(self) -> None:
        self.assertEqual(said([report(), report(moved=(3, 0))], [label()]), [1, 0])

    def test_reports_on_somebody_unsure_are_right_or_left_out(self) -> None:
        for unsure in (label(agree=0.6), label(sure_joints=5), dict(box=BOX)):
            self.assertEqual(said([report(folded=0.9)], [unsure]), [])
        self.assertEqual(said([report()], [label(agree=0.6)]), [1])

    def test_who_stands_behind_somebody_surely_labelled_may_be_somebody_unsure(self) -> None:
        behind = label(agree=0.6, moved=(20, 0))
        self.assertEqual(said([report(), report(moved=(20, 0), folded=0.9)], [label(), behind]), [1])

    def test_a_report_beside_all_boxes_is_wrong_where_everybody_is_labelled(self) -> None:
        beside = report(moved=(140, 0))
        self.assertEqual(said([beside], [label(), label(agree=0.6)]), [0])
        self.assertEqual(said([beside], [label()], more=3), [])


if __name__ == "__main__":
    unittest.main()
