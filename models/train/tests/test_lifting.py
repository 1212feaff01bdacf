"""Stage II: its input, and the people that it learns from. No data needed."""

from __future__ import annotations

import json
import pathlib
import sys
import tempfile
import unittest

import torch

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(KIT))

from measure import errors, naive, procrustes
from model import channel_mask, stage2_input
from posed import Posed
from skeleton import NB, NJ, PARENTS21, ROOT
from stage2 import People3D, imitate


class Lifting(unittest.TestCase):
    def test_procrustes_undoes_a_similarity(self) -> None:
        x = torch.randn(5, 21, 3)
        r = torch.linalg.qr(torch.randn(5, 3, 3))[0]
        r = r * torch.det(r).sign()[:, None, None]
        self.assertLess(float((procrustes(x @ r * 1.7 + 3, x) - x).abs().max()), 1e-3)

    def test_bones_chain_to_the_person(self) -> None:
        rel = torch.randn(6, 21, 3)
        rel = rel - rel[:, ROOT : ROOT + 1]
        bones = (rel - rel[:, PARENTS21]).flatten(1)[:, None].expand(-1, NJ, -1)
        self.assertLess(errors(naive(torch.ones(6, NJ), bones * channel_mask()), rel)["mpjpe"], 0.1)

    def test_input_knows_neither_place_nor_size(self) -> None:
        uv, conf, enc = torch.randn(3, NJ, 2) * 40, torch.rand(3, NJ) + 0.1, torch.randn(3, NJ, 63)
        a = stage2_input(uv, conf, enc, channel_mask())
        b = stage2_input(uv * 2.5 + 90, conf, enc, channel_mask())
        self.assertEqual(tuple(a.shape), (3, 924))
        self.assertLess(float((a - b).abs().max()), 1e-3)

    def test_unseen_joints_are_zero(self) -> None:
        g = torch.Generator().manual_seed(1)
        uv, conf, enc = imitate(torch.randn(300, NJ, 2) * 40, torch.randn(300, 21, 3) * 0.3, g, channel_mask())
        x = stage2_input(uv, conf, enc, channel_mask()).view(300, NJ, 66)
        gone = conf == 0
        self.assertGreater(int(gone.sum()), 20)
        self.assertEqual(float(x[gone].abs().max()), 0.0)
        self.assertTrue(bool((conf[:, 1] > 0).all()))  # nobody is found without a neck


    def test_limbs_taken_for_each_other_bring_each_other_s_encodings(self) -> None:
        g = torch.Generator().manual_seed(3)
        rel = torch.randn(1, 21, 3).expand(4000, -1, -1) * 0.3
        uv = torch.randn(1, NJ, 2).expand(4000, -1, -1) * 40
        noisy, conf, enc = imitate(uv, rel, g, channel_mask())
        elbow, other = 3, 6
        swapped = (noisy[:, elbow] - uv[:, other]).norm(dim=1) < 0.2 * (uv[:, elbow] - uv[:, other]).norm(dim=1)
        swapped &= (noisy[:, other] - uv[:, elbow]).norm(dim=1) < 0.2 * (uv[:, elbow] - uv[:, other]).norm(dim=1)
        self.assertGreater(int(swapped.sum()), 20)
        bone = rel[0] - rel[0, PARENTS21]
        said = enc.view(4000, NJ, NB, 3)[swapped][:, elbow, elbow].median(0).values
        self.assertLess(float((said - bone[other]).norm()), float((said - bone[elbow]).norm()))


class Upright:
    """A body that stands: 21 joints in body space (x left, y up, z forward), of somebody 1.70 m tall, turned as asked."""

    JOINTS = (
        [[0, 1.68, 0], [0, 1.45, 0]]
        + [[s * x, y, 0] for s in (-1, 1) for x, y in ((0.18, 1.4), (0.25, 1.12), (0.28, 0.87))]
        + [[s * 0.1, y, 0] for s in (-1, 1) for y in (0.9, 0.48, 0.08)]
        + [[0, 0.95, 0], [0, 1.15, 0], [0, 1.55, 0], [-0.28, 0.78, 0], [0.28, 0.78, 0], [-0.1, 0.02, 0.15], [0.1, 0.02, 0.15]]
    )

    def random_shapes(self, n: int, g: torch.Generator) -> tuple[torch.Tensor, torch.Tensor]:
        return torch.zeros(n, 1), 1.5 + 0.4 * torch.rand(n, generator=g)

    def shaped(self, w: torch.Tensor, stature: torch.Tensor, with_verts: bool = True) -> tuple[None, torch.Tensor]:
        return None, torch.tensor(self.JOINTS) * (stature / 1.7)[:, None, None]

    def random_poses(self, *_: object, **__: object) -> None:
        return None

    def kinematics(self, q: None, rest: torch.Tensor, yaw: torch.Tensor) -> tuple[None, None, torch.Tensor]:
        c, s = yaw.cos()[:, None], yaw.sin()[:, None]
        x, y, z = rest.unbind(-1)
        return None, None, torch.stack([c * x + s * z, y, c * z - s * x], -1)


class PeopleBeforeACamera(unittest.TestCase):
    @classmethod
    def setUpClass(cls) -> None:
        cls.people = People3D.__new__(People3D)
        cls.people.body, cls.people.device, cls.people.held = Upright(), torch.device("cpu"), True
        cls.people.clips, cls.people.g = None, torch.Generator().manual_seed(1)

    def test_some_stand_right_before_it_and_are_cut_off(self) -> None:
        uv, rel, size, inside = self.people.sample(4000)
        self.assertEqual([tuple(t.shape) for t in (uv, rel, size, inside)], [(4000, NJ, 2), (4000, NB, 3), (4000,), (4000, NJ)])
        self.assertTrue(bool(inside[:, 1].all()) and int(inside.sum(1).min()) >= 4)
        self.assertGreater(float((size > 400).float().mean()), 0.1)
        close = inside[size > 400]
        self.assertGreater(float((~close[:, 8:].any(1)).float().mean()), 0.1)
        self.assertGreater(float(inside[size < 200].float().mean()), 0.95)


class PosedPeople(unittest.TestCase):
    def person(self, x: float, n: int) -> dict[str, object]:
        joints3d = [[x + 0.01 * j, 0.02 * j, 4.0 + 0.001 * n] for j in range(21)]
        joints2d = [[256 + 400 * p[0] / p[2], 160 + 400 * p[1] / p[2]] for p in joints3d]
        return dict(stature=1.7, joints3d=joints3d, joints2d=joints2d, visibility=[1] * 18 + [0] * 3)

    def load(self, people: list[dict[str, object]]) -> Posed:
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "truth.json"
            frames = [dict(camera=dict(fx=400.0), people=[p]) for p in people]
            path.write_text(json.dumps(dict(format="edgecap-truth", version=1, frames=frames)))
            return Posed(path, torch.device("cpu"), 1)

    def test_those_measured_with_are_never_drawn(self) -> None:
        posed = self.load([self.person(0.3, n) for n in range(100)])
        self.assertEqual(len(posed), 100)
        held = {round(float(s), 4) for s in posed.held()[2]}
        drawn = {round(float(s), 4) for s in posed.sample(4000)[2]}
        self.assertEqual((len(held), len(drawn)), (7, 93))
        self.assertFalse(held & drawn)

    def test_mirror_images_are_people_too(self) -> None:
        posed = self.load([self.person(0.3, n) for n in range(32)])
        uv, rel, _, inside = posed.sample(200)
        turned = uv[:, 1, 0] < 0
        self.assertTrue(0.3 < float(turned.float().mean()) < 0.7)
        self.assertEqual((rel[:, 2, 0] > rel[:, 5, 0]).tolist(), [False] * 200)  # the right shoulder stays right of the left one
        lean = rel[:, 0, 0] - rel[:, ROOT, 0]
        self.assertTrue(bool(((lean > 0) == turned).all()))
        self.assertTrue(bool(inside.all()))

    def test_who_is_hardly_in_the_picture_is_left_out(self) -> None:
        gone = self.person(0.3, 1) | dict(visibility=[1, 0] + [1] * 19)  # without a neck
        few = self.person(0.3, 2) | dict(visibility=[1, 1, 1] + [0] * 18)
        enough = [self.person(0.3, n) for n in range(3, 23)]
        self.assertEqual(len(self.load([gone, few, *enough])), 20)
        with self.assertRaisesRegex(SystemExit, "expected more than 16 people of 4 joints"):
            self.load([gone, few] * 10)


if __name__ == "__main__":
    unittest.main()
