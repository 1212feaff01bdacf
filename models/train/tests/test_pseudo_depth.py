"""Depth that the program itself sees in photos of everyday life, lent to training. No data and no program needed."""

from __future__ import annotations

import json
import pathlib
import sys
import tempfile
import unittest

import numpy as np

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path[:0] = [str(KIT), str(KIT / "tests")]

import depth
import pseudo_depth
import terms
from skeleton import NJ
from test_depth import people_folder
from test_everyday import SIDE, STANDING, person

LENS = dict(fx=300.0, fy=300.0, cx=150.0, cy=150.0)
WEIGHTS = KIT.parent / "open/weights/stage2.safetensors"
ACADEMIC = KIT.parent / "weights/stage2.safetensors"


def report(joints: np.ndarray, joints3d: np.ndarray) -> dict:
    return dict(score=0.9, joints2d=[[*xy, 0.9] for xy in joints.tolist()], joints3d=joints3d.tolist())


def line(number: int, people: list[dict], side: int = SIDE) -> dict:
    return dict(source=f"photos/{number:06d}.jpg", width=side, height=side, intrinsics=LENS, people=people)


class Lent(unittest.TestCase):
    def setUp(self) -> None:
        self.temporary = tempfile.TemporaryDirectory()
        self.addCleanup(self.temporary.cleanup)
        two = [person((STANDING - [0, 150]) * 0.45 + [dx, 150], box=[0.5 * k, 0, 0.5 + 0.5 * k, 1]) for k, dx in enumerate((-75, 75))]
        self.folder = people_folder(pathlib.Path(self.temporary.name) / "packed", [two, two])
        self.joints = np.load(self.folder / "people.npz")["joints"]
        self.rel3d = np.random.default_rng(3).normal(0, 0.3, (4, 21, 3)).astype(np.float32)

    def lend(self, *frames: dict) -> tuple[np.ndarray, np.ndarray]:
        pseudo_depth.lend(self.folder, frames)
        return depth.read(self.folder, 4)

    def test_photos_keep_their_numbers(self) -> None:
        out = pathlib.Path(self.temporary.name) / "photos"
        self.assertEqual(pseudo_depth.pictures(self.folder, out), 2)
        self.assertEqual(sorted(p.name for p in out.iterdir()), ["000000.jpg", "000001.jpg"])

    def test_everybody_gets_the_depth_of_their_own_report(self) -> None:
        # the second photo alone, its people the other way round, one of them reported a second time where nobody is
        people = [report(self.joints[3], self.rel3d[3]), report(self.joints[2], self.rel3d[2]), report(self.joints[2] + 90, self.rel3d[0])]
        rel3d, lifted = self.lend(line(1, people))
        self.assertEqual(lifted.tolist(), [False, False, True, True])
        self.assertFalse(rel3d[:2].any())
        for row in (2, 3):
            ray = np.append((self.joints[row, 1] - 150) / 300, 1)
            turned = pseudo_depth.view_aligned(self.rel3d[row], self.joints[row, 1], LENS)
            np.testing.assert_allclose(rel3d[row].astype(np.float32), turned, atol=2e-3)
            # what lies along the neck's ray has no x and no y in view-aligned axes
            np.testing.assert_allclose(pseudo_depth.view_aligned(ray[None].astype(np.float32), self.joints[row, 1], LENS)[0, :2], 0, atol=1e-5)

    def test_who_is_elsewhere_than_labelled_lends_nothing(self) -> None:
        _, lifted = self.lend(line(0, [report(self.joints[0] + [40, 0], self.rel3d[0]), report(self.joints[1], self.rel3d[1])]))
        self.assertEqual(lifted.tolist(), [False, True, False, False])

    def test_a_report_lends_to_one_person_alone(self) -> None:
        label = np.concatenate([self.joints[0], np.ones((NJ, 1))], 1).astype(np.float32)
        twice = pseudo_depth.matched([report(self.joints[0], self.rel3d[0])], np.stack([label + [2, 0, 0], label]))
        self.assertEqual([row for row, _ in twice], [1])

    def test_other_pictures_are_told(self) -> None:
        with self.assertRaisesRegex(SystemExit, "write the pictures again"):
            self.lend(line(0, [], side=SIDE // 2))

    def test_photos_that_nobody_numbered_are_told(self) -> None:
        for source in ("photos/me.jpg", "photos/000002.jpg"):
            with self.assertRaisesRegex(SystemExit, "that folder of photos"):
                self.lend(line(0, []) | dict(source=source))

    def test_open_data_stays_open_by_open_weights_alone(self) -> None:
        people = pathlib.Path(self.temporary.name) / "people.jsonl"
        people.write_text(json.dumps(line(0, [report(self.joints[0], self.rel3d[0])])) + "\n")
        call = ["lend", str(self.folder), str(people)]
        with self.assertRaisesRegex(SystemExit, "trained on open data"):
            pseudo_depth.main([*call, "--weights", str(ACADEMIC)])
        self.assertFalse(depth.read(self.folder, 4)[1].any())
        terms.mark(self.folder, terms.ingredients(self.folder) | terms.DEPTH)
        pseudo_depth.main([*call, "--weights", str(WEIGHTS)])
        self.assertNotIn("BlazePose", " ".join(terms.ingredients(self.folder)))
        self.assertIn(pseudo_depth.OURS, terms.ingredients(self.folder))
        pseudo_depth.main(call)
        self.assertFalse(terms.is_open(self.folder))


if __name__ == "__main__":
    unittest.main()
