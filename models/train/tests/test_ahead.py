"""Tiles made by other processes, and training data carried in parts. No data needed."""

from __future__ import annotations

import dataclasses
import pathlib
import sys
import tempfile
import unittest

import numpy as np
import torch

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(KIT))

import ahead
import carry
import terms
from everyday_tiles import Batch, Everyday
from pool import FIELDS
from test_open import everyday_folder, scenes_folder

CPU = torch.device("cpu")


class Folder(unittest.TestCase):
    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.at = pathlib.Path(folder.name)
        (self.at / "photos").mkdir()
        self.everyday = everyday_folder(self.at / "photos")


class Ahead(Folder):
    def setUp(self) -> None:
        super().setUp()
        self.made = ahead.Ahead(self.everyday, 5, 0.1, CPU, workers=2)
        self.addCleanup(self.made.close)

    def test_tiles_are_those_of_one_process(self) -> None:
        kinds = ((40, 96, 128, (0.7, 1.2), None, False), (7, 64, 64, (0.7, 1.2), (40, 90), True))
        seen = {kind: [self.made.batch(*kind) for _ in range(2 * ahead.DEPTH)] for kind in kinds}
        for kind, batches in seen.items():
            n, H, W = kind[:3]
            for b in batches:
                self.assertEqual(b.image.shape, (n, 3, H, W))
                self.assertTrue(all(len(getattr(b, f.name)) == n for f in dataclasses.fields(Batch)))
            self.assertGreater(len({float(b.image.sum()) for b in batches}), 2 * ahead.DEPTH - 2, "the same tiles again")
        one = Everyday(self.everyday, 5, 0.1)
        one.keep_decoded()
        one.g.manual_seed((5 << 32) + 1)
        expected, found = one.batch(16, *kinds[0][1:]), seen[kinds[0]][0]
        self.assertLess(float((found.image[:16] - expected.image).abs().max()), 1 / 255)
        for k in ahead.LABELS:
            np.testing.assert_array_equal(getattr(found, k)[:16], getattr(expected, k), k)

    def test_what_is_no_longer_wanted_makes_room(self) -> None:
        self.made.free = type(self.made.free)(range(2 * (ahead.DEPTH + 1)))
        for kind in ((32, 64, 64, (0.7, 1.2)), (30, 64, 96, (0.7, 1.2)), (32, 64, 64, (0.7, 1.2))):
            for _ in range(3):
                b = self.made.batch(*kind)
                self.assertEqual(b.image.shape, (kind[0], 3, *kind[1:3]))
                self.assertGreater(float(b.image.std()), 0.01)

    def test_more_than_fits_is_refused(self) -> None:
        self.made.free = type(self.made.free)(range(3))
        with self.assertRaisesRegex(SystemExit, "SLOTS"):
            self.made.batch(32, 64, 64, (0.7, 1.2), None, False)

    def test_tiles_too_large_are_refused(self) -> None:
        with self.assertRaisesRegex(SystemExit, "MOST"):
            self.made.batch(1, 1024, 1024, (0.7, 1.2))


class Carried(Folder):
    def test_parts_hold_all_and_each_is_usable_alone(self) -> None:
        whole = scenes_folder(self.at / "still")
        call = ["pack", self.at / "parts", "--everyday", self.everyday, "--scenes", whole, "--side", 150]
        carry.main([*map(str, call)])
        carry.main(["unpack", str(self.at / "parts"), str(self.at / "both")])
        z, kept = np.load(self.at / "both/everyday/people.npz"), np.load(self.everyday / "people.npz")
        self.assertEqual(z["size"].tolist(), [[150, 150]] * 3)
        self.assertLess(np.abs((z["joints"] + 0.5) * 2 - 0.5 - kept["joints"]).max(), 1e-3)
        self.assertEqual(terms.ingredients(self.at / "both/everyday"), terms.ingredients(self.everyday))
        few, many = (Everyday(f, 3) for f in (self.at / "both/everyday", self.everyday))
        for i, like in enumerate((0, 2, 1)):  # photos 0 and 2 are in the first part
            a, b = few.picture(i).float(), many.picture(like, 1).float()
            self.assertLess(float((a - b).abs().mean()), 6)
        for k in FIELDS:
            a, b = (np.load(f / f"{k}.npy").astype(float) for f in (self.at / "both/scenes/still", whole))
            self.assertLess(np.abs(a - b).max(), 3, k)
        one = self.at / "one"
        one.mkdir()
        (self.at / "parts/part0").rename(one / "part0")
        carry.main(["unpack", str(one), str(self.at / "first")])
        self.assertEqual(len(Everyday(self.at / "first/everyday", 3).size), 2)


if __name__ == "__main__":
    unittest.main()
