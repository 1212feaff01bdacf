"""Tables of the skeleton, maps that are made of people, and people found in maps. No data needed."""

from __future__ import annotations

import pathlib
import sys
import unittest

import numpy as np
import torch

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path[:0] = [str(KIT), str(KIT / "tests")]

import targets
from crowd import crowd
from group import argmax_joints, people
from mistakes import thresholds
from skeleton import BONES_AT, FLIP14, FLIP21, LIMBS, NB, NJ, PARENTS21, ROOT, TOPO21


class Skeleton(unittest.TestCase):
    def test_tables_agree(self) -> None:
        self.assertEqual(sorted(TOPO21), list(range(NB)))
        for b in TOPO21:
            if b != ROOT:
                self.assertLess(TOPO21.index(PARENTS21[b]), TOPO21.index(b))
        for flip in (FLIP14, FLIP21):
            self.assertEqual([flip[flip[j]] for j in range(len(flip))], list(range(len(flip))))
        carried = {b for bones in BONES_AT for b in bones}
        self.assertEqual(carried, set(range(NB)) - {ROOT})  # every bone can be read somewhere


class Grouping(unittest.TestCase):
    def test_a_neck_has_a_threshold_of_its_own(self) -> None:
        maps = torch.zeros(40, 20, 20)
        maps[1, 10, 10] = 0.25
        self.assertEqual(len(people(maps, thr=0.2, min_joints=1)), 1)
        self.assertEqual(len(people(maps, thr=0.2, min_joints=1, neck_thr=0.3)), 0)

    def test_mistakes_are_asked_for_by_the_program_s_thresholds(self) -> None:
        self.assertEqual(thresholds(KIT.parent / "association.toml"), dict(thr=0.2, neck_thr=0.3, paf_thr=0.05, min_joints=4))

    def test_a_gaussian_s_middle_is_found_exactly(self) -> None:
        y, x = torch.meshgrid(torch.arange(16.0), torch.arange(16.0), indexing="ij")
        hm = torch.exp(-0.5 * ((x - 7.3) ** 2 + (y - 8.4) ** 2) / 0.9**2)[None, None]
        at = argmax_joints(hm.expand(-1, NJ, -1, -1))[0, 0]
        np.testing.assert_allclose(at, [8 * 7.3 + 3.5, 8 * 8.4 + 3.5], atol=0.02)

    def test_people_come_back_from_their_own_maps(self) -> None:
        j = crowd((80, 60), (200, 90), (330, 40))
        hm, paf, _, _ = targets.maps(j, torch.ones(1, 3, NJ, dtype=torch.bool), torch.full((1, 3), 150.0), 40, 64)
        found = people(torch.cat([hm, paf], 1)[0])
        self.assertEqual(len(found), 3)
        for p in j[0].numpy():
            best = min(float(np.abs(q[:, :2] - p).max()) for q in found if (q[:, 2] > 0).all())
            self.assertLess(best, 3.0)

    def test_empty_maps_hold_nobody(self) -> None:
        self.assertEqual(people(torch.zeros(40, 40, 64)), [])
        self.assertEqual(people(torch.full((40, 40, 64), 0.2)), [])

    def test_maximum_of_each_map(self) -> None:
        j = crowd((100, 60))
        hm, _, _, _ = targets.maps(j, torch.ones(1, 1, NJ, dtype=torch.bool), torch.full((1, 1), 150.0), 40, 64)
        self.assertLess(np.abs(argmax_joints(hm)[0] - j[0, 0].numpy()).max(), 3.0)


class Targets(unittest.TestCase):
    def test_fields_point_to_the_parent(self) -> None:
        j = crowd((100, 60))
        _, paf, _, _ = targets.maps(j, torch.ones(1, 1, NJ, dtype=torch.bool), torch.full((1, 1), 150.0), 40, 64)
        for limb, (c, p) in enumerate(LIMBS):
            u = (j[0, 0, p] - j[0, 0, c]) / (j[0, 0, p] - j[0, 0, c]).norm()
            mid = ((j[0, 0, c] + j[0, 0, p]) / 2 - 3.5) / 8
            if (j[0, 0, p] - j[0, 0, c]).norm() < 16:
                continue
            x, y = (int(v) for v in mid.round())
            self.assertGreater(float(paf[0, 2 * limb : 2 * limb + 2, y, x] @ u), 0.8)

    def test_losses_vanish_on_the_target_only(self) -> None:
        j = crowd((100, 60))
        rel = torch.randn(1, 1, 21, 3) * 0.3
        t = targets.synthetic(j, torch.ones(1, 1, NJ), rel, torch.full((1, 1), 150.0), torch.full((1, 1), 4.0), 40, 64)
        self.assertEqual(float(sum(targets.loss2d(t.maps, t))), 0.0)
        self.assertLess(abs(float(targets.location_loss(t.maps, t))), 1e-4)
        self.assertEqual(float(targets.loss3d(t.enc, t)), 0.0)
        off = t.maps.roll(3, 3)
        self.assertGreater(float(targets.location_loss(off, t)), 0.1)
        self.assertGreater(float(sum(targets.loss2d(off, t))), 0.01)

    def test_unlabelled_surroundings_are_ignored(self) -> None:
        j = crowd((100, 60))
        known = torch.zeros(1, 40, 64)
        known[:, 4:30, 8:20] = 1
        box = known[:, None] > 0
        yes = torch.ones(1, 1, dtype=torch.bool)
        rel = torch.randn(1, 1, 21, 3)
        t = targets.real(j, yes[..., None].expand(1, 1, NJ), torch.zeros(1, 1, NJ, dtype=torch.bool), torch.full((1, 1), 150.0), known, box, rel, yes)
        self.assertEqual(float(t.weight[..., 40:].sum()), 0.0)
        self.assertGreater(float(t.weight.sum()), 0.0)

    def test_only_lifted_people_lend_depth(self) -> None:
        j = crowd((60, 60), (200, 60))
        lab, size = torch.ones(1, 2, NJ, dtype=torch.bool), torch.full((1, 2), 150.0)
        rel = torch.randn(1, 2, 21, 3)
        known, box = torch.ones(1, 40, 64), torch.zeros(1, 2, 40, 64, dtype=torch.bool)
        t = targets.real(j, lab, ~lab, size, known, box, rel, torch.tensor([[True, False]]))
        x, y = (int(v) for v in ((j[0, 0, 3] - 3.5) / 8).round())
        bone = rel[0, 0, 3] - rel[0, 0, 2]
        self.assertTrue(torch.allclose(t.enc[0, 9:12, y, x], bone))
        self.assertEqual(float(t.enc_weight[..., 17:].sum()), 0.0)  # the second person stands there


if __name__ == "__main__":
    unittest.main()
