"""Photos in which everybody is labelled: joints, masks, splits. No data needed."""

from __future__ import annotations

import gzip
import json
import pathlib
import sys
import tempfile
import unittest

import numpy as np
import torch
from PIL import Image

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(KIT))

import targets
from coco17 import ABSENT, HEAD_TOP, LABELLED, LIMB_JOINTS, NECK, UNKNOWN, to14
from everyday import pack, states, wanted
from everyday_tiles import Everyday, stature
from skeleton import FLIP14, LIMBS, NB, NJ, NL

FLIP17 = [0, 2, 1, 4, 3, 6, 5, 8, 7, 10, 9, 12, 11, 14, 13, 16, 15]
# Somebody upright who faces the camera, 290 px tall: nose, eyes, ears, shoulders, elbows, wrists, hips, knees, ankles; left before right.
STANDING = np.array(
    [[0, 30], [6, 24], [-6, 24], [14, 27], [-14, 27], [36, 60], [-36, 60], [48, 110], [-48, 110], [52, 152], [-52, 152]]
    + [[20, 150], [-20, 150], [22, 220], [-22, 220], [24, 290], [-24, 290]],
    np.float32,
)
WAVING = STANDING.copy()
WAVING[[7, 9]] = [[60, 30], [62, 0]]
ALL = np.full(17, LABELLED, np.uint8)
SIDE = 300


def person(joints: np.ndarray = STANDING, confidence: float = 0.9, **more: object) -> dict:
    """A label as the teachers write it, of somebody in a photo of `SIDE` pixels."""
    xy = (joints + [150, 5]) / SIDE
    low, high = xy.min(0) - [0, 0.1], xy.max(0)  # a head's joints are below its top
    kp = [[*p, confidence] for p in xy.tolist()]
    return dict(box=[*low.tolist(), *high.tolist()], det=0.9, given=0, kp=kp, spread=[0.01] * 17, gap=[0.02] * 17, agree=0.9) | more


class Joints(unittest.TestCase):
    def test_limbs_stay_and_the_head_stands_on_the_neck(self) -> None:
        j, s = to14(STANDING[None], ALL[None])
        self.assertTrue((s == LABELLED).all())
        for ours, theirs in LIMB_JOINTS.items():
            self.assertLess(np.linalg.norm(j[0, ours] - STANDING[theirs]), 6)
        self.assertTrue(27 < j[0, NECK, 1] < 60)
        self.assertTrue(-15 < j[0, HEAD_TOP, 1] < 24)

    def test_mirrored_moved_and_turned_people_have_mirrored_moved_and_turned_joints(self) -> None:
        j, _ = to14(STANDING[None], ALL[None])
        mirrored, _ = to14((STANDING * [-1, 1])[None, FLIP17], ALL[None])
        np.testing.assert_allclose(mirrored[0], (j[0] * [-1, 1])[FLIP14], atol=1e-3)
        c, s = np.cos(0.7), np.sin(0.7)
        turn, shift = np.array([[c, -s], [s, c]]), np.array([40.0, -9.0])
        turned, _ = to14((STANDING @ turn.T * 1.5 + shift)[None].astype(np.float32), ALL[None])
        np.testing.assert_allclose(turned[0], j[0] @ turn.T * 1.5 + shift, atol=1e-3)

    def test_what_is_made_of_doubtful_joints_is_doubtful(self) -> None:
        back = ALL.copy()
        back[:3] = UNKNOWN  # seen from behind: no face
        _, s = to14(STANDING[None], back[None])
        self.assertEqual((s[0, HEAD_TOP], s[0, NECK]), (UNKNOWN, LABELLED))
        headless = ALL.copy()
        headless[:5] = ABSENT
        _, s = to14(STANDING[None], headless[None])
        self.assertEqual((s[0, HEAD_TOP], s[0, NECK]), (ABSENT, UNKNOWN))
        odd = STANDING.copy()
        odd[0] += [40, 0]  # a nose beside the face
        _, s = to14(odd[None], ALL[None])
        self.assertEqual(s[0, HEAD_TOP], UNKNOWN)


class Trust(unittest.TestCase):
    def test_teachers_who_agree_are_believed_joint_by_joint(self) -> None:
        p = person()
        p["kp"][9][2], p["kp"][10][2], p["spread"][7], p["gap"][8] = 0.2, 0.02, 0.2, 0.6
        xy, s = states(p, SIDE, SIDE)
        np.testing.assert_allclose(xy, STANDING + [150, 5], atol=1e-3)
        self.assertEqual(s[[7, 8, 9, 10]].tolist(), [UNKNOWN, UNKNOWN, UNKNOWN, ABSENT])
        self.assertEqual((s == LABELLED).sum(), 13)

    def test_the_less_they_agree_the_closer_a_joint_must_be(self) -> None:
        gaps = [0.2] * 17
        self.assertTrue((states(person(gap=gaps), SIDE, SIDE)[1] == LABELLED).all())
        self.assertTrue((states(person(gap=gaps, agree=0.6), SIDE, SIDE)[1] == UNKNOWN).all())
        self.assertTrue((states(person(agree=0.4), SIDE, SIDE)[1] == UNKNOWN).all())

    def test_labels_by_hand_overrule_the_teachers(self) -> None:
        true = [[0.5, 0.25, 2]] * 16 + [[0, 0, 0]]
        xy, s = states(person(true=true, agree=0.1), SIDE, SIDE)
        self.assertEqual(s.tolist(), [LABELLED] * 16 + [UNKNOWN])
        np.testing.assert_allclose(xy[0], [150, 75])

    def test_somebody_without_joints_is_unsure(self) -> None:
        self.assertTrue((states(dict(box=[0, 0, 0.1, 0.1], det=0.4, given=0), SIDE, SIDE)[1] == UNKNOWN).all())


class Splits(unittest.TestCase):
    def test_neither_the_test_split_nor_crowds_nor_closed_terms_where_open_ones_are_wanted(self) -> None:
        some = dict(open="origin openimages")
        row = dict(split="train", more=0, origin="coco")
        self.assertTrue(wanted(row, some, False))
        self.assertFalse(wanted(row | dict(split="test"), some, False))
        self.assertFalse(wanted(row | dict(more=3), some, False))
        self.assertFalse(wanted(row, some, True))
        self.assertTrue(wanted(row | dict(origin="openimages"), some, True))
        self.assertFalse(wanted(row | dict(origin="openimages"), dict(open=False), True))
        self.assertTrue(wanted(row, dict(open=True), True))


class Tiles(unittest.TestCase):
    def folder(self, where: pathlib.Path, rows: list[dict], only_open: bool = False) -> pathlib.Path:
        """A pack of photos with a white rectangle where each person's trunk is, on black."""
        (where / "labels").mkdir()
        sources = dict(stanford40=dict(open=False), free_exercise=dict(open=True, repo="somebody/exercises", terms="public domain"))
        (where / "sources.json").write_text(json.dumps(sources))
        for name in ("stanford40", "free_exercise"):
            (where / name).mkdir()
            mine = [r for r in rows if r["source"] == name]
            with gzip.open(where / "labels" / f"{name}.jsonl.gz", "wt") as f:
                f.writelines(json.dumps(r) + "\n" for r in mine)
            for r in mine:
                image = np.zeros((SIDE, SIDE, 3), np.uint8)
                for p in r["people"]:
                    corners = np.array(p["kp"])[[5, 6, 11, 12], :2] * SIDE
                    (x0, y0), (x1, y1) = corners.min(0).astype(int), corners.max(0).astype(int)
                    image[y0:y1, x0:x1] = 255
                Image.fromarray(image).save(where / name / r["file"], quality=95)
        pack(where, where / "labels", where / "out", only_open)
        return where / "out"

    def row(self, file: str, people: list[dict], source: str = "stanford40", split: str = "train") -> dict:
        return dict(source=source, file=file, src=file, size=[SIDE, SIDE], split=split, more=0, people=people)

    def test_only_photos_of_the_split_with_somebody_sure_or_nobody_are_packed(self) -> None:
        rows = [
            self.row("a.jpg", [person()]),
            self.row("b.jpg", [person(WAVING)], split="test"),
            self.row("c.jpg", [person(agree=0.1)]),
            self.row("d.jpg", []),
            self.row("e.jpg", [person()], source="free_exercise"),
        ]
        for only_open, count in ((False, 3), (True, 1)):
            with tempfile.TemporaryDirectory() as d:
                z = np.load(self.folder(pathlib.Path(d), rows, only_open) / "people.npz")
                self.assertEqual(len(z["size"]), count)

    def packed(self, rows: list[dict]) -> list[str]:
        """Where the photos are from that are taken of these, all open but those of the test split."""
        with tempfile.TemporaryDirectory() as d:
            lines = (self.folder(pathlib.Path(d), rows, only_open=True) / "attribution.txt").read_text().splitlines()
        return [line.removeprefix("free_exercise exercises/") for line in lines]

    def exercise(self, src: str, joints: np.ndarray, **more: object) -> dict:
        return self.row(src.replace("/", "_"), [person(joints)], "free_exercise") | dict(src=f"exercises/{src}") | more

    def test_photos_beside_one_of_the_test_split_are_left_out(self) -> None:
        crouching = STANDING * [1, 0.6]
        rows = [self.exercise("Squat/0.jpg", WAVING), self.exercise("Squat_Jump/0.jpg", crouching)]
        self.assertEqual(len(self.packed(rows)), 2)
        self.assertEqual(self.packed([*rows, self.exercise("Squat/1.jpg", STANDING, split="test")]), ["Squat_Jump/0.jpg"])
        rows = [self.exercise("Row/0.jpg", STANDING, coco=241), self.exercise("Jump/0.jpg", WAVING, coco=9)]
        self.assertEqual(self.packed([*rows, self.row("a.jpg", [person(crouching)], split="test") | dict(coco=241)]), ["Jump/0.jpg"])

    def test_copies_of_one_of_the_test_split_are_left_out(self) -> None:
        mirrored, quarter = (WAVING * [-1, 1])[FLIP17], np.array([[0, -1], [1, 0]])
        other = self.exercise("Other/0.jpg", STANDING)
        for copy in (WAVING, mirrored, WAVING * 0.6 + [20, 30], WAVING @ quarter, mirrored @ quarter):
            rows = [self.exercise("Copy/0.jpg", copy), other]
            self.assertEqual(len(self.packed(rows)), 2)
            self.assertEqual(self.packed([*rows, self.row("a.jpg", [person(WAVING)], split="test")]), ["Other/0.jpg"])

    def test_what_ends_halfway_leaves_no_people_of_other_pictures(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            where = pathlib.Path(d)
            out = self.folder(where, [self.row("a.jpg", [person()]), self.row("b.jpg", [])])
            (where / "stanford40/b.jpg").unlink()
            with self.assertRaises(FileNotFoundError):
                pack(where, where / "labels", out, False)
            with self.assertRaises(FileNotFoundError):
                Everyday(out, 3)

    def test_joints_lie_where_the_picture_shows_them(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            e = Everyday(self.folder(pathlib.Path(d), [self.row("a.jpg", [person()])]), 3)
            b = e.batch(12, 256, 320, (0.7, 1.2))
            self.assertEqual(b.image.shape, (12, 3, 256, 320))
            for k in range(12):
                self.assertTrue(b.labelled[k, 0].all())
                for share in (0.2, 0.8):  # of the way from shoulders to hips: inside the trunk
                    x, y = ((1 - share) * b.joints2d[k, 0, [2, 5]].mean(0) + share * b.joints2d[k, 0, [8, 11]].mean(0)).tolist()
                    if 3 < x < 316 and 3 < y < 252:
                        self.assertGreater(b.image[k, :, round(y), round(x)].min(), 0.7)
                x, y = b.joints2d[k, 0, 4].tolist()  # beside it
                if 3 < x < 316 and 3 < y < 252:
                    self.assertLess(b.image[k, 0, round(y), round(x)], 0.3)
                self.assertTrue((b.joints2d[k, 0, 2] - b.joints2d[k, 0, 5]).norm() > 20)
                seen = (b.joints2d[k, 0] >= 4).all(-1) & (b.joints2d[k, 0] < torch.tensor([316.0, 252.0])).all(-1)
                cells = (b.joints2d[k, 0][seen] / 8).long()
                self.assertTrue(b.box[k, 0, cells[:, 1], cells[:, 0]].all())

    def test_tiles_of_people_are_turned_by_any_angle_and_whole_frames_hardly(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            e = Everyday(self.folder(pathlib.Path(d), [self.row("a.jpg", [person()])]), 3)
            angles = {}
            for W in (256, 288):
                b = e.batch(200, 256, W, (0.6, 0.7))
                trunk = b.joints2d[:, 0, [8, 11]].mean(1) - b.joints2d[:, 0, [2, 5]].mean(1)
                angles[W] = torch.atan2(trunk[:, 0], trunk[:, 1]).abs()
                for k in range(len(trunk)):
                    x, y = b.joints2d[k, 0, [2, 5, 8, 11]].mean(0).tolist()
                    if 3 < x < W - 4 and 3 < y < 252:
                        self.assertGreater(b.image[k, :, round(y), round(x)].min(), 0.7)
        self.assertLess(angles[288].max(), 0.45)
        self.assertTrue(0.05 < (angles[256] > 0.7).float().mean() < 0.25)
        self.assertGreater(angles[256].max(), 2.5)

    def test_statures_follow_the_zoom_and_are_those_of_whole_people(self) -> None:
        j, s = to14(STANDING[None], ALL[None])
        t = torch.from_numpy(j)
        whole = stature(t, torch.from_numpy(s) == LABELLED, torch.tensor([1.0]))
        self.assertTrue(240 < whole < 340, whole)
        half = torch.from_numpy(s) == LABELLED
        half[:, [3, 4, 6, 7, 8, 9, 10, 11, 12, 13]] = False
        self.assertTrue(200 < stature(t, half, torch.tensor([1.0])) < 340)
        self.assertEqual(stature(t, half & False, torch.tensor([77.0])), 77)

    def test_who_is_unsure_is_neither_demanded_nor_background(self) -> None:
        beside = person()
        other = person(agree=0.1)
        for p, dx in ((beside, -0.25), (other, 0.25)):
            p["box"] = [p["box"][0] + dx, p["box"][1], p["box"][2] + dx, p["box"][3]]
            p["kp"] = [[x + dx, y, c] for x, y, c in p["kp"]]
        with tempfile.TemporaryDirectory() as d:
            e = Everyday(self.folder(pathlib.Path(d), [self.row("a.jpg", [beside, other])]), 3)
            b = e.batch(8, 320, 320, (0.9, 1.0))
        self.assertEqual(b.size_px.shape[1], 1)
        self.assertTrue(b.hazy.flatten(1).any(1).all())
        self.assertLess(b.hazy.float().mean(), 0.5)


class Masks(unittest.TestCase):
    def setUp(self) -> None:
        j, _ = to14((STANDING + [128, 10])[None], ALL[None])
        self.joints = torch.from_numpy(j)[None]
        self.box = torch.zeros(1, 1, 40, 32, dtype=torch.bool)
        self.box[..., 1:38, 8:24] = True
        self.hazy = torch.zeros(1, 40, 32, dtype=torch.bool)
        self.size = torch.tensor([[280.0]])

    def answer(self, labelled: torch.Tensor, unknown: torch.Tensor) -> targets.Targets:
        nobody = torch.zeros(1, 1, dtype=torch.bool)
        return targets.everyday(self.joints, labelled, unknown, self.size, self.box, self.hazy, torch.zeros(1, 1, NB, 3), nobody)

    def test_everything_counts_where_everything_is_known(self) -> None:
        t = self.answer(torch.ones(1, 1, NJ, dtype=torch.bool), torch.zeros(1, 1, NJ, dtype=torch.bool))
        self.assertTrue((t.weight == 1).all())
        self.assertEqual(t.enc_weight.sum(), 0)
        self.assertGreater(t.maps[:, :NJ].amax((2, 3)).min(), 0.8)

    def test_unknown_joints_are_open_in_the_box_and_absent_ones_are_not(self) -> None:
        labelled = torch.ones(1, 1, NJ, dtype=torch.bool)
        unknown = torch.zeros(1, 1, NJ, dtype=torch.bool)
        labelled[..., [4, 10]] = False
        unknown[..., 4] = True  # a wrist nobody is sure of; an ankle out of the picture
        t = self.answer(labelled, unknown)
        self.assertTrue((t.weight[0, 4][self.box[0, 0]] == 0).all())
        self.assertTrue((t.weight[0, 4][~self.box[0, 0]] == 1).all())
        self.assertTrue((t.weight[0, 10] == 1).all())
        self.assertTrue((t.maps[0, 10] == 0).all())
        for child, parent in ((4, 3), (10, 9)):  # a limb of which one end is not known may be there or not
            limb = NJ + 2 * LIMBS.index((child, parent))
            self.assertTrue((t.weight[0, limb : limb + 2][:, self.box[0, 0]] == 0).all())

    def test_haze_hides_background_but_nobody_who_is_labelled(self) -> None:
        self.hazy[:, :, :16] = True
        t = self.answer(torch.ones(1, 1, NJ, dtype=torch.bool), torch.zeros(1, 1, NJ, dtype=torch.bool))
        strong = torch.cat([t.maps[:, :NJ], t.maps[:, NJ:].unflatten(1, (NL, 2)).norm(dim=2).repeat_interleave(2, 1)], 1) > 0.05
        self.assertTrue((t.weight[strong] == 1).all())
        self.assertTrue((t.weight[:, :, :, :16][~strong[:, :, :, :16]] == 0).all())
        self.assertTrue((t.weight[:, :, :, 16:] == 1).all())


if __name__ == "__main__":
    unittest.main()
