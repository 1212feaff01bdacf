"""Tiles made by other processes, and training data carried in parts. No data needed."""

from __future__ import annotations

import dataclasses
import importlib.util
import pathlib
import sys
import tempfile
import unittest
import unittest.mock

import numpy as np
import torch

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(KIT))

if importlib.util.find_spec("cv2") is None:
    raise unittest.SkipTest("OpenCV is not here, without which nothing is carried")

import ahead
import carry
import depth
import terms
from everyday_tiles import Batch, Everyday
from pool import FIELDS, Stored
from real import PEOPLED, TAUGHT, TEACHER, People, decode, held_out, load_photos, load_set
from skeleton import NB
from test_depth import apart, crowd_folder
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

    def test_depth_comes_with_its_people(self) -> None:
        crowded = crowd_folder(self.at / "crowd")
        made = ahead.Ahead(crowded, 5, 0.0, CPU, workers=2)
        self.addCleanup(made.close)
        self.assertTrue(made.lends)
        self.assertFalse(self.made.lends)
        b = made.batch(40, 128, 160, (0.7, 1.2))
        self.assertEqual((b.rel3d.shape, b.rel3d.dtype), ((40, 2, NB, 3), torch.float32))
        self.assertLess(apart(b), 0.03)
        self.assertTrue(bool((b.lifted == ((b.rel3d[..., 0, 2] > 0) & (b.size_px > 0))).all()))
        self.assertTrue(bool(b.lifted.any()) and bool((~b.lifted[b.size_px > 0]).any()))

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

    def test_depth_follows_its_people(self) -> None:
        crowded, scenes = crowd_folder(self.at / "crowd"), scenes_folder(self.at / "still")
        terms.mark(crowded, terms.ingredients(crowded) | terms.DEPTH)
        carry.main([*map(str, ["pack", self.at / "parts", "--everyday", crowded, "--scenes", scenes, "--side", 150])])
        carry.main(["unpack", str(self.at / "parts"), str(self.at / "both")])
        both = self.at / "both/everyday"
        (rel3d, lifted), (carried, still) = depth.read(crowded, 6), depth.read(both, 6)
        rows = [0, 1, 4, 5, 2, 3]  # two people a photo; photos 0 and 2 are in the first part
        np.testing.assert_array_equal(carried, rel3d[rows])
        np.testing.assert_array_equal(still, lifted[rows])
        self.assertLess(apart(Everyday(both, 3).batch(20, 128, 160, (0.7, 1.2))), 0.03)
        self.assertIn("BlazePose", " ".join(terms.ingredients(both)))
        lifted[2:4] = False  # nobody in photo 1
        depth.write(crowded, rel3d, lifted)
        carry.main([*map(str, ["pack", self.at / "lent", "--everyday", crowded, "--scenes", scenes, "--lent"])])
        carry.main(["unpack", str(self.at / "lent"), str(self.at / "some")])
        np.testing.assert_array_equal(depth.read(self.at / "some/everyday", 4)[0], rel3d[[0, 1, 4, 5]])
        carry.main([*map(str, ["pack", self.at / "parts", "--everyday", self.everyday, "--scenes", scenes])])
        carry.main(["unpack", str(self.at / "parts"), str(self.at / "without")])
        self.assertFalse((self.at / "without/everyday" / depth.FILE).exists())

    def test_a_folder_that_held_other_data_says_nothing_of_it(self) -> None:
        """Neither whose depth it was nor that all of it was open."""
        crowded, scenes = crowd_folder(self.at / "crowd"), scenes_folder(self.at / "still")
        carry.main([*map(str, ["pack", self.at / "parts", "--everyday", crowded, "--scenes", scenes])])
        carry.main(["unpack", str(self.at / "parts"), str(self.at / "both")])
        carried = [self.at / "both/everyday", self.at / "both/scenes/still"]
        self.assertTrue(all(map(terms.is_open, carried)))
        self.assertTrue((carried[0] / depth.FILE).exists())
        for folder in (self.everyday, scenes):
            terms.unmark(folder)
        carry.main([*map(str, ["pack", self.at / "parts", "--everyday", self.everyday, "--scenes", scenes])])
        terms.mark(self.at / "parts/part0/scenes/still", terms.RENDERED)  # one part of two
        carry.main(["unpack", str(self.at / "parts"), str(self.at / "both")])
        self.assertFalse(any(map(terms.is_open, carried)))
        self.assertFalse((carried[0] / depth.FILE).exists())

    def test_what_ends_halfway_leaves_no_scenes_of_before(self) -> None:
        out, part = scenes_folder(self.at / "scenes"), self.at / "part"
        part.mkdir()
        np.savez(part / "truth.npz", offset=[0])
        with unittest.mock.patch("carry.pictures", return_value=[np.zeros((3, 8, 8), np.uint8)]), self.assertRaises(KeyError):
            carry.unpack_scenes([part], out)
        self.assertFalse(terms.is_open(out))
        with self.assertRaisesRegex(SystemExit, "expected scenes"):
            Stored(out, 1)

    def test_pictures_of_a_pack_are_carried_with_what_is_known_of_them(self) -> None:
        pack = pack_of(self.at / "pack", {"lsp_train": 3, "lsp_test": 2, "background": 21})
        parts = ["--everyday", self.everyday, "--scenes", scenes_folder(self.at / "still"), "--pack", pack, "--quality", 95]
        carry.main([*map(str, ["pack", self.at / "parts", *parts])])
        carry.main(["unpack", str(self.at / "parts"), str(self.at / "both")])
        carried = self.at / "both/pack"
        self.assertEqual(load_set(carried, "lsp_test").names, [], "pictures to test on went along")
        for name in ("lsp_train", "background"):
            whole, found = load_set(pack, name), load_set(carried, name)
            self.assertEqual(sorted(found.names), whole.names)
            for like, picture, joints in zip(found.names, found.files, found.joints):
                i = whole.names.index(like)
                np.testing.assert_array_equal(joints, whole.joints[i])
                a, b = decode(picture).astype(float), decode(whole.files[i]).astype(float)
                self.assertLess(np.abs(a - b).mean(), 4)

    def test_what_the_teacher_knows_goes_along(self) -> None:
        """People of a carried pack have the joints, the weight, the depth and the outlines that they have in the whole one."""
        pack = pack_of(self.at / "pack", {"lspet_train": 5, "lsp_train": 3, "lsp_test": 2, "background": 4})
        z = dict(np.load(pack / "images.npz"))
        rng = np.random.default_rng(4)
        z["joints"][..., :2] = rng.uniform(5, 35, (14, 14, 2))
        z["joints"][..., 2] = rng.random((14, 14)) < 0.8
        np.savez(pack / "images.npz", **z)
        told = np.concatenate([z["joints"][:8, :, :2] + rng.normal(0, 3, (8, 14, 2)), rng.uniform(0.5, 1, (8, 14, 1))], 2)
        told[1, :, :2] = told[1, ::-1, :2]  # contradicts its labels
        answers = dict(ok=rng.random(8) < 0.7, lift=np.arange(8) % 2 == 0, joints=told.astype(np.float32))
        answers |= dict(bones=rng.random((8, NB, 3)).astype(np.float16), mask=rng.integers(0, 255, (8, 26, 26)).astype(np.uint8))
        np.savez(pack / TEACHER, **answers)
        parts = ["--everyday", self.everyday, "--scenes", scenes_folder(self.at / "still"), "--pack", pack]
        carry.main([*map(str, ["pack", self.at / "parts", *parts])])
        carry.main(["unpack", str(self.at / "parts"), str(self.at / "both")])
        carried, empty = self.at / "both/pack", torch.zeros(1, 3, 30, 40, dtype=torch.uint8)
        whole, found = (People(p, CPU, empty) for p in (pack, carried))
        names = [[f"{s} {n}" for s in TAUGHT for n in load_set(p, s).names] for p in (pack, carried)]
        self.assertNotEqual(*names)
        rows = [names[0].index(n) for n in names[1]]
        for key in ("joints", "lab", "weight", "bones", "lift", "cut", "mask"):
            np.testing.assert_array_equal(getattr(found, key), getattr(whole, key)[rows], key)
        self.assertTrue(found.lends)
        self.assertFalse(bool(torch.equal(whole.joints, torch.from_numpy(z["joints"][:8, :, :2]))), "nothing was mended")
        np.savez(pack / TEACHER, **{k: v[:-1] for k, v in answers.items()})
        with self.assertRaisesRegex(SystemExit, "expected 8 rows in .*teacher.npz, found 7"):
            carry.main([*map(str, ["pack", self.at / "parts", *parts])])
        (pack / TEACHER).unlink()
        carry.main([*map(str, ["pack", self.at / "parts", *parts])])
        carry.main(["unpack", str(self.at / "parts"), str(self.at / "both")])
        self.assertFalse(People(carried, CPU, empty).lends)

    def test_photos_kept_out_of_training_are_the_same_in_a_carried_pack(self) -> None:
        pack = pack_of(self.at / "pack", {"background": 21})
        parts = ["--everyday", self.everyday, "--scenes", scenes_folder(self.at / "still"), "--pack", pack, "--quality", 95]
        carry.main([*map(str, ["pack", self.at / "parts", *parts])])
        carry.main(["unpack", str(self.at / "parts"), str(self.at / "both")])
        for held in (False, True):
            a, b = (load_photos(p, CPU, held=held).flatten(1).float().mean(1) for p in (pack, self.at / "both/pack"))
            self.assertEqual(len(a), len(b))
            self.assertLess(float((a.sort()[0] - b.sort()[0]).abs().max()), 3)
        kept = [n for n in load_set(pack, "background").names if not held_out(n) and n not in PEOPLED]
        self.assertEqual(len(load_photos(pack, CPU)), len(kept))
        self.assertLess(len(kept), 18, "INRIA's photos with people are trained on as backgrounds")


def pack_of(folder: pathlib.Path, sets: dict[str, int]) -> pathlib.Path:
    """A pack of pictures that are of one grey each, numbered from 0 in every set."""
    names = [f"{i:04}.jpg" for n in sets.values() for i in range(n)]
    greys = np.linspace(20, 235, len(names)).round().astype(np.uint8)
    files = [carry.compressed(np.full((40, 50, 3), g), 95) for g in greys]
    folder.mkdir(exist_ok=True)
    (folder / "images.bin").write_bytes(b"".join(files))
    np.savez(
        folder / "images.npz",
        offset=np.cumsum([0, *map(len, files)]),
        size=np.full((len(names), 2), (40, 50), np.int16),
        set=np.repeat(np.arange(len(sets)), list(sets.values())).astype(np.uint8),
        joints=np.random.default_rng(1).random((len(names), 14, 3)).astype(np.float32),
        names=np.array(names),
        set_names=np.array(list(sets)),
    )
    return folder


if __name__ == "__main__":
    unittest.main()
