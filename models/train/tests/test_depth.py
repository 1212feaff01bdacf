"""Depth that BlazePose lends to people in photos of everyday life: asked for, drawn with tiles, learnt. No data and no mediapipe needed."""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import io
import pathlib
import sys
import tempfile
import types
import unittest
import unittest.mock

import numpy as np
import torch

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path[:0] = [str(KIT), str(KIT / "tests")]

import depth
import distil
import everyday
import mistakes
import renorm
import targets
import teacher
import terms
import test_everyday as labelled
import train
from everyday_tiles import Batch, Everyday
from pool import Stored
from skeleton import NB, NJ, ROOT
from test_everyday import SIDE, STANDING, person
from test_open import scenes_folder

HIPS, TRUNK17 = [8, 11], [5, 6, 11, 12]
# Where COCO's joints are among BlazePose's 33 landmarks.
OF_COCO = {0: 0, 1: 2, 2: 5, 3: 7, 4: 8} | {k: k + 6 for k in range(5, 11)} | {k: k + 12 for k in range(11, 17)}


def people_folder(where: pathlib.Path, photos: list[list[dict]]) -> pathlib.Path:
    """A pack of open photos of `SIDE` pixels, with these people in each."""
    where.mkdir(exist_ok=True)
    row = dict(source="free_exercise", size=[SIDE, SIDE], split="train", more=0)
    return labelled.Tiles().folder(where, [row | dict(file=f"{k}.jpg", src=f"{k}.jpg", people=p) for k, p in enumerate(photos)], True)


def crowd_folder(where: pathlib.Path) -> pathlib.Path:
    """Three photos of two people each, nobody like the other, with depth.npz: x and y of the bones are those of the joints, in 100 px about the
    pelvis; z is 0.1 m times the person's row and one, below 0 for every second one, who is not lifted."""
    rng = np.random.default_rng(7)
    photos = [
        [
            person((STANDING - [0, 150]) * 0.45 + rng.normal(0, 6, STANDING.shape) + [dx, 150], box=[0.5 * k, 0, 0.5 + 0.5 * k, 1])
            for k, dx in enumerate((-75, 75))
        ]
        for _ in range(3)
    ]
    out = people_folder(where, photos)
    joints = np.load(out / "people.npz")["joints"]
    rel3d = np.zeros((len(joints), NB, 3))
    rel3d[:, :NJ, :2] = (joints - joints[:, HIPS].mean(1, keepdims=True)) / 100
    lifted = np.arange(len(joints)) % 2 == 0
    rel3d[..., 2] = (0.1 * (1 + np.arange(len(joints))) * np.where(lifted, 1, -1))[:, None]
    depth.write(out, rel3d.astype(np.float16), lifted)
    return out


class Shown(unittest.TestCase):
    """Photos as Stage I is asked about them, for Stage II to learn from."""

    def test_everybody_is_asked_about_where_the_picture_shows_them(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            folder = crowd_folder(pathlib.Path(d))
            shown = list(mistakes.of_everyday(folder, 9, np.random.default_rng(1)))
            labels = np.load(folder / "people.npz")["joints"].reshape(3, 2, NJ, 2)
            self.assertEqual(len(list(mistakes.of_everyday(folder, 2, np.random.default_rng(1)))), 2)
        self.assertEqual(len(shown), 3)
        scale, left = 320 / SIDE, (512 - 320) / 2
        for s, joints in zip(shown, labels):
            self.assertEqual((tuple(s.picture.shape), s.rel), ((1, 3, 320, 512), [None, None]))
            for (at, labelled, size), truth in zip(s.truth, joints):
                np.testing.assert_allclose(at, (truth + 0.5) * scale - 0.5 + [left, 0], atol=1e-3)
                self.assertTrue(labelled.sum() > 8 and 60 < size < 320, (labelled, size))


def apart(b: Batch) -> float:
    """How far the first 14 joints' x and y are from those of the picture about the pelvis, at the scale that suits best, at most, over the person's
    size."""
    there = b.size_px > 0
    seen = (b.joints2d - b.joints2d[:, :, HIPS].mean(2, keepdim=True))[there].flatten(1)
    told = b.rel3d[there][:, :NJ, :2].flatten(1)
    scale = (seen * told).sum(1, keepdim=True) / told.square().sum(1, keepdim=True)
    return float(((seen - scale * told).abs().amax(1) / seen.abs().amax(1)).max())


class Folder(unittest.TestCase):
    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.at = pathlib.Path(folder.name)


def landmarks(joints17: np.ndarray) -> np.ndarray:
    """COCO's joints [17, 2 or 3] as BlazePose's landmarks [33, 4], hands and feet at wrists and ankles."""
    out = np.zeros((33, 4))
    for ours, theirs in OF_COCO.items():
        out[theirs, : joints17.shape[1]] = joints17[ours]
    for tip, end in ((17, 15), (19, 15), (18, 16), (20, 16), (31, 27), (32, 28)):
        out[tip] = out[end]
    out[:, 3] = 1
    return out


WORLD = landmarks(STANDING / 170 + [0, -150 / 170])[:, :3]  # metres about the hips


class Asking(Folder):
    def test_what_is_seen_in_the_cut_out_comes_back_exactly(self) -> None:
        image = np.zeros((200, 300, 3), np.uint8)
        buf = io.BytesIO()
        depth.Image.fromarray(image).save(buf, "PNG")
        rng = np.random.default_rng(3)
        for box in ([20.3, 10.1, 61.7, 140.9], [0, 0, 300, 200], [-12.5, 150.2, 40, 199], [250, 3, 318.7, 99.4]):
            crop = depth.Crop.around(np.array(box))
            self.assertGreaterEqual(max(crop.shown), depth.SHOWN_PX)
            self.assertLessEqual(crop.left, box[0] - 0.29 * max(box[2] - box[0], box[3] - box[1]))
            truth = rng.uniform(-20, 320, (33, 2))
            seen = np.concatenate([crop.from_photo(truth), rng.random((33, 2))], 1)

            def ask(shown: np.ndarray, crop: depth.Crop = crop, seen: np.ndarray = seen) -> tuple[np.ndarray, np.ndarray, None]:
                self.assertEqual(shown.shape, (*crop.shown[::-1], 3))
                return seen, WORLD, None

            [(flat, world)] = depth.look((buf.getvalue(), np.array([box])), ask)
            self.assertLess(np.abs(flat[:, :2] - truth).max(), 1e-4)
            np.testing.assert_array_equal(flat[:, 2:], seen[:, 2:])
            np.testing.assert_array_equal(world, WORLD)

    def test_the_cut_out_shows_what_the_map_says(self) -> None:
        """Also beyond the photo, where it shows the nearest of its pixels."""
        y, x = np.mgrid[:120, :160]
        image = np.stack([x, y, x], -1).astype(np.uint8)
        crop = depth.Crop.around(np.array([100.0, 30.0, 150.0, 118.0]))
        shown = crop.cut(image)
        rows, columns = np.mgrid[8 : shown.shape[0] - 8, 8 : shown.shape[1] - 8]
        at = crop.to_photo(np.stack([columns, rows], -1))
        self.assertGreater(at[..., 0].max(), 165)
        inner = ((at > 2) & (at < [157, 117])).all(-1)
        for k, most in ((0, 159), (1, 119)):
            value = shown[8:-8, 8:-8, k]
            self.assertLess(np.abs(value - at[..., k])[inner].max(), 1)
            self.assertLess(np.abs(value - at[..., k].clip(0, most)).max(), 2)

    def seen(self, shown: np.ndarray) -> tuple[np.ndarray, np.ndarray, None]:
        """A stand-in for BlazePose that finds the white trunk of somebody upright."""
        rows, columns = (np.nonzero((shown[..., 0] > 127).sum(axis) > 3)[0] for axis in (1, 0))
        if len(rows) == 0:
            return teacher.MISSING.copy(), teacher.MISSING[:, :3].copy(), None
        trunk = STANDING[TRUNK17]
        low, span = trunk.min(0), np.ptp(trunk, axis=0)
        found = np.array([columns[0], rows[0]]), np.array([np.ptp(columns), np.ptp(rows)])
        return landmarks((STANDING - low) / span * found[1] + found[0]).astype(np.float32), WORLD.astype(np.float32), None

    def lend(self, folder: pathlib.Path, ask: depth.Ask, limit: int = 0) -> str:
        with contextlib.redirect_stdout(io.StringIO()) as said:
            depth.lend(folder, lambda jobs: (depth.look(job, ask) for job in jobs), limit)
        return said.getvalue()

    def test_who_agrees_with_the_labels_lends_depth(self) -> None:
        small = person()
        small["kp"] = [[0.1 + 0.2 * x, 0.1 + 0.2 * y, c] for x, y, c in small["kp"]]
        small["box"] = [0.1 + 0.2 * v for v in small["box"]]
        hipless = person()
        hipless["kp"][11][2] = 0.15
        few = person()
        for k in (0, 1, 2, 3, 4, 7, 8, 9, 10, 15, 16):
            few["kp"][k][2] = 0.15
        aside = person()
        aside["kp"][7][1] += 0.4  # elbows somewhere else
        aside["kp"][8][1] += 0.4
        folder = people_folder(self.at, [[person()], [small, person()], [hipless], [few], [aside], []])
        z = dict(np.load(folder / "people.npz"))
        self.assertEqual(depth.asked(z).tolist(), [0, 2, 5])
        self.assertEqual(depth.asked(z | dict(stretched=np.arange(6) == 0)).tolist(), [2, 5])
        self.assertEqual(len(depth.asked(z, 2)), 2)
        said = self.lend(folder, self.seen)
        rel3d, lifted = depth.read(folder, len(z["state"]))
        self.assertEqual((rel3d.dtype, rel3d.shape, lifted.dtype), (np.float16, (6, NB, 3), np.bool_))
        self.assertEqual(lifted.tolist(), [True, False, False, False, False, False], "somebody else, or other elbows, was seen")
        self.assertIn("6 people, 3 asked of, 1 lend depth", said)
        self.assertFalse(rel3d[~lifted].any())
        self.assertEqual(np.abs(rel3d[0, ROOT]).max(), 0)
        self.assertAlmostEqual(teacher.stature(rel3d[0].astype(np.float32)), 1.7, 2)
        self.assertLess(rel3d[0, 16, 1], -0.4)
        self.assertGreater(rel3d[0, 5, 0], 0.1)  # the left shoulder, of somebody seen from the front

    def test_exchanged_sides_giants_and_nobody_lend_none(self) -> None:
        folder = people_folder(self.at, [[person()]])

        def exchanged(shown: np.ndarray) -> tuple[np.ndarray, np.ndarray, None]:
            flat, world, _ = self.seen(shown)
            return np.concatenate([landmarks(flat[list(OF_COCO.values()), :2][labelled.FLIP17])[:, :2], flat[:, 2:]], 1), world, None

        def giant(shown: np.ndarray) -> tuple[np.ndarray, np.ndarray, None]:
            flat, world, _ = self.seen(shown)
            return flat, world * 1.5, None

        for ask in (exchanged, giant, lambda shown: self.seen(shown * 0)):
            self.lend(folder, ask)
            self.assertFalse(depth.read(folder, 1)[1].any())
        self.lend(folder, self.seen)
        self.assertTrue(depth.read(folder, 1)[1].all())

    def test_an_open_folder_stays_open_and_says_whose_depth_it_is(self) -> None:
        folder = people_folder(self.at, [[person()]])
        before = terms.ingredients(folder)
        self.assertNotIn("BlazePose", " ".join(before))
        self.assertIn("stays open", self.lend(folder, self.seen))
        self.assertEqual(terms.ingredients(folder), before | terms.DEPTH)
        with contextlib.redirect_stdout(io.StringIO()):
            everyday.pack(self.at, self.at / "labels", folder, True)
        self.assertFalse((folder / depth.FILE).exists(), "depth of a pack that is no more")
        self.assertEqual(terms.ingredients(folder), before)
        terms.unmark(folder)
        self.assertNotIn("open", self.lend(folder, self.seen))
        self.assertFalse(terms.is_open(folder))

    def test_without_mediapipe_one_message_says_what_to_install(self) -> None:
        for found in (None, importlib.util.spec_from_file_location("mediapipe", self.at / "__init__.py")):
            with unittest.mock.patch("importlib.util.find_spec", return_value=found), self.assertRaisesRegex(SystemExit, "pip install mediapipe"):
                depth.main([str(self.at)])


class Tiles(Folder):
    def test_bones_turn_and_mirror_with_the_tile(self) -> None:
        e = Everyday(crowd_folder(self.at), 3)
        self.assertTrue(e.lends)
        with unittest.mock.patch.object(Everyday, "_log_uniform", return_value=1.0):
            b = e.batch(24, 256, 320, (1.0, 1.0))
        self.assertLess(apart(b), 2e-3)  # what f16 rounds
        there = b.size_px > 0
        up = b.joints2d[there][:, 1] - b.joints2d[there][:, HIPS].mean(1)
        self.assertGreater(float((up[:, 0] / up[:, 1]).abs().max()), 0.15)
        np.testing.assert_array_equal(b.lifted, (b.rel3d[..., 0, 2] > 0) & there)
        self.assertTrue(bool(b.lifted.any()) and bool((~b.lifted[there]).any()))
        self.assertLess(apart(e.batch(24, 256, 320, (0.7, 1.2))), 0.05)  # stretched, too

    def test_who_is_mirrored_has_the_other_sides_hands_and_feet(self) -> None:
        folder = people_folder(self.at, [[person()]])
        rel3d = np.zeros((1, NB, 3), np.float16)
        rel3d[0, 18, 2] = -0.5  # the left hand is held out
        depth.write(folder, rel3d, np.ones(1, bool))
        b = Everyday(folder, 3).batch(16, 256, 320, (0.9, 1.0))
        out = b.rel3d[:, 0, [17, 18], 2]
        self.assertEqual(sorted({tuple(row) for row in out.tolist()}), [(-0.5, 0.0), (0.0, -0.5)])

    def test_a_folder_without_depth_lends_none(self) -> None:
        folder = crowd_folder(self.at)
        many = Everyday(folder, 3).batch(8, 128, 160, (0.7, 1.2))
        (folder / depth.FILE).unlink()
        e = Everyday(folder, 3)
        b = e.batch(8, 128, 160, (0.7, 1.2))
        self.assertFalse(e.lends or bool(b.lifted.any()) or bool(b.rel3d.any()))
        np.testing.assert_array_equal(b.image, many.image)  # the same tiles
        np.testing.assert_array_equal(b.joints2d, many.joints2d)
        self.assertEqual(float(made(b).enc_weight.sum()), 0)

    def test_rows_of_another_pack_are_refused(self) -> None:
        folder = crowd_folder(self.at)
        depth.write(folder, np.zeros((5, NB, 3), np.float16), np.zeros(5, bool))
        with self.assertRaisesRegex(SystemExit, "expected 6 rows in .*depth.npz.*found 5: run depth.py"):
            Everyday(folder, 3)


def made(b: Batch) -> targets.Targets:
    return targets.everyday(b.joints2d, b.labelled, b.unknown, b.size_px, b.box, b.hazy, b.rel3d, b.lifted)


class Targets(unittest.TestCase):
    def setUp(self) -> None:
        j, _ = labelled.to14((STANDING * 0.8 + [70, 10])[None], labelled.ALL[None])
        self.joints = torch.from_numpy(np.stack([j[0], j[0] + [110, 0]]).astype(np.float32))[None]
        self.rel = torch.randn(1, 2, NB, 3, generator=torch.Generator().manual_seed(2))

    def answer(self, joints: torch.Tensor, size: list[float], lifted: list[bool], labels: torch.Tensor | None = None) -> targets.Targets:
        known = torch.ones(1, 2, NJ, dtype=torch.bool) if labels is None else labels
        box, hazy = torch.zeros(1, 2, 40, 32, dtype=torch.bool), torch.zeros(1, 40, 32, dtype=torch.bool)
        return targets.everyday(joints, known, ~known, torch.tensor([size]), box, hazy, self.rel, torch.tensor([lifted]))

    def test_only_labelled_joints_of_lifted_people_have_encodings(self) -> None:
        known = torch.ones(1, 2, NJ, dtype=torch.bool)
        known[0, 0, 4] = False
        t = self.answer(self.joints, [220.0, 220.0], [True, False], known)
        cell = ((self.joints - 3.5) / 8).round().long()
        x, y = cell[0, 0, 3].tolist()
        self.assertTrue(torch.allclose(t.enc[0, 9:12, y, x], self.rel[0, 0, 3] - self.rel[0, 0, 2]))
        x, y = cell[0, 0, 4].tolist()
        self.assertEqual(float(t.enc_weight[0, 12:15, y, x].sum()), 0)
        for j in range(NJ):  # of the second person
            x, y = cell[0, 1, j].tolist()
            self.assertEqual(float(t.enc_weight[0, :, y, x].sum()), 0)
        without = self.answer(self.joints, [220.0, 220.0], [False, False], known)
        self.assertEqual(float(without.enc_weight.sum()), 0)
        self.assertTrue(torch.equal(without.maps, t.maps) and torch.equal(without.weight, t.weight))

    def test_who_is_taller_stands_in_front(self) -> None:
        both = self.joints[:, :1].expand(-1, 2, -1, -1)
        x, y = ((both[0, 0, 3] - 3.5) / 8).round().long().tolist()
        for size, front in (([220.0, 150.0], 0), ([150.0, 220.0], 1)):
            t = self.answer(both, size, [True, True])
            self.assertTrue(torch.allclose(t.enc[0, 9:12, y, x], self.rel[0, front, 3] - self.rel[0, front, 2]), front)


class Learning(Folder):
    """Losses of one tile of everyday photos and one rendered tile, by a network that answers the same whatever it sees."""

    def setUp(self) -> None:
        super().setUp()
        self.folder = crowd_folder(self.at / "photos")
        b = Everyday(self.folder, 3).batch(2, 128, 160, (0.9, 1.0))
        self.assertTrue(bool(b.lifted.any()))
        self.lent = made(b)
        b.lifted[:] = False
        self.none = made(b)
        g = torch.Generator().manual_seed(5)
        self.y, self.e = torch.randn(3, 40, 16, 20, generator=g) * 0.1, torch.randn(3, 3 * NB, 16, 20, generator=g) * 0.1
        some = (torch.rand(1, 3 * NB, 16, 20, generator=g) < 0.1).float()
        self.rendered = targets.Targets(torch.zeros(1, 40, 16, 20), torch.ones(1, 40, 16, 20), torch.zeros(1, 3 * NB, 16, 20), some)
        self.x = torch.zeros(3, 3, 128, 160)
        self.skipped: list[int] = []

    def trainer(self, lends: bool, people: bool | None = None) -> train.Trainer:
        """`people`: whether those of LSP lend depth; None: there is no LSP."""
        t = train.Trainer.__new__(train.Trainer)
        t.a = argparse.Namespace(peak=(9.0, 3.0), lend=0.7, synth=0.6, where=0.004, w3d=0.5, distil_weight=0.4)
        t.dev, t.bf16, t.teachers = torch.device("cpu"), False, None
        t.people = None if people is None else types.SimpleNamespace(lends=people)
        t.everyday = types.SimpleNamespace(lends=lends)

        def network(x: torch.Tensor, first3d: int) -> tuple[torch.Tensor, torch.Tensor]:
            self.skipped.append(first3d)
            return self.y, self.e[first3d:]

        t.fwd = network
        return t

    def test_depth_of_photos_counts_as_much_as_lsps_without_any_lsp(self) -> None:
        of_rendered = targets.loss3d(self.e[2:], self.rendered)
        of_photos = targets.loss3d(self.e[:2], self.lent)
        self.assertGreater(float(of_photos), 0)
        L, _ = self.trainer(True).losses(self.x, None, self.lent, self.rendered, everyday=2)
        self.assertAlmostEqual(float(L[4]), float(of_rendered + 0.7 * of_photos), 5)
        without, _ = self.trainer(False).losses(self.x, None, self.none, self.rendered, everyday=2)
        self.assertAlmostEqual(float(without[4]), float(of_rendered), 6)
        self.assertTrue(torch.equal(without[[0, 1, 2, 3, 5, 6]], L[[0, 1, 2, 3, 5, 6]]))
        for people, lends in ((True, False), (False, True), (False, False)):
            self.trainer(lends, people).losses(self.x, None, self.none, self.rendered, everyday=2)
        self.assertEqual(self.skipped, [0, 2, 0, 0, 2], "tiles whose 3D is not asked for")

    def teachers(self, asked: list[torch.Tensor]) -> types.SimpleNamespace:
        """Some who say one more than the network everywhere, and keep in `asked` what they were shown."""

        def answer(x: torch.Tensor, turn: int) -> targets.Targets:
            asked.append(x)
            return targets.Targets(self.y.detach() + 1, torch.ones_like(self.y), self.e + 1, torch.ones_like(self.e))

        return types.SimpleNamespace(answer=answer)

    def taught(self, tr: targets.Targets, lends: bool) -> torch.Tensor:
        """Where what the teachers ask depends on the encodings: its gradient [3, 63, h, w]."""
        trainer = self.trainer(lends)
        trainer.teachers = self.teachers([])
        e = self.e.clone().requires_grad_()
        return torch.autograd.grad(trainer._taught(self.x, self.y, e, tr, 3.0, 2), e)[0]

    def test_teachers_leave_depth_to_whoever_knows_better(self) -> None:
        pull = self.taught(self.lent, True)
        self.assertEqual(float(pull[2:].abs().max()), 0, "of rendered tiles")
        flat, depth_of = pull[:2].unflatten(1, (NB, 3)).split([2, 1], 2)
        self.assertEqual(float(depth_of.abs().max()), 0, "of real people, while some lend theirs")
        lent = self.lent.enc_weight.unflatten(1, (NB, 3))[:, :, :2] > 0
        self.assertTrue(bool(lent.any()))
        self.assertEqual(float(flat[lent].abs().max()), 0)
        bones = ~lent.flatten(3).any(3)
        self.assertGreater(float(flat[bones].abs().min()), 0, "bones that nobody in the tile lends")

    def test_teachers_are_silent_as_far_as_they_see_a_joint_that_lends_depth(self) -> None:
        b = Everyday(self.folder, 3).batch(1, 128, 160, (0.9, 1.0))
        b.joints2d[:], b.lifted[:] = torch.tensor([83.5, 67.5]), True
        b.labelled[:], b.unknown[:], b.size_px[:] = True, False, 200.0
        labels = made(b)
        said = targets.Targets(*(torch.ones(2, c, 16, 20) for c in (40, 40, 3 * NB, 3 * NB)))
        distil.leave_depth(said, labels, True)
        y, x = torch.meshgrid(torch.arange(16) - 8.0, torch.arange(20) - 10.0, indexing="ij")
        sigma = float(targets.sigma_cells(torch.tensor(200.0)))
        bone = said.enc_weight[0].unflatten(0, (NB, 3))[3]  # of an elbow
        self.assertEqual(float(bone[:, x.hypot(y) < 2 * sigma].max()), 0)
        self.assertEqual(float(bone[:2, x.hypot(y) > 6].min()), 1)

    def test_where_nobody_lends_depth_teachers_tell_that_of_real_people(self) -> None:
        alone = self.taught(self.none, False)
        self.assertGreater(float(alone[:2].abs().min()), 0)
        self.assertEqual(float(alone[2:].abs().max()), 0)

    def test_labels_count_less_only_in_2d_and_where_teachers_speak(self) -> None:
        """The last of the real tiles is of everyday life, the one before it is not."""
        pulls, asked, shown = [], [], torch.ones_like(self.x)
        for look in (None, shown):
            trainer = self.trainer(True)
            trainer.teachers = self.teachers(asked)
            self.y.requires_grad_()
            self.e.requires_grad_()
            L, _ = trainer.losses(self.x, look, self.lent, self.rendered, everyday=1)
            pulls.append([torch.autograd.grad(part.sum(), (self.y, self.e), retain_graph=True, allow_unused=True) for part in (L[:6], L)])
        self.assertTrue(len(asked) == 1 and asked[0] is shown)
        (before, _), (labels, everything) = pulls
        torch.testing.assert_close(labels[0][[0, 2]], 0.6 * before[0][[0, 2]])
        torch.testing.assert_close(everything[0][1], before[0][1])
        self.assertGreater(float((everything[0] - labels[0])[[0, 2]].abs().mean()), 0)
        torch.testing.assert_close(labels[1], before[1])

    def test_teachers_are_asked_about_pictures_as_they_were_before_the_camera_spoilt_them(self) -> None:
        trainer = self.trainer(True)
        trainer.everyday, trainer.pools = Everyday(self.folder, 3), [Stored(scenes_folder(self.at / "scenes"), 3)]
        mix = train.Mix(96, 96, 0, 2, (50, 90), [], (0.9, 1.0), everyday=2)
        with unittest.mock.patch("train.photometric", side_effect=lambda x, g: x * 0):
            x, shown, tr, ts, _ = trainer.batch(mix)
            self.assertIsNone(shown, "a copy for nobody")
            trainer.teachers = self.teachers([])
            x, shown, tr, ts, _ = trainer.batch(mix)
        self.assertEqual((x.shape, shown.shape), ((4, 3, 96, 96),) * 2)
        self.assertTrue(bool((x == -0.5).all()))
        self.assertGreater(float(shown[:2].std()), 0.05)
        self.assertLess(float((shown[2:] - (120 / 255 - 0.5)).abs().median()), 0.01)

    def test_an_open_run_learns_depth_of_photos_and_says_whose_it_is(self) -> None:
        self.addCleanup(torch.set_num_threads, torch.get_num_threads())
        self.addCleanup(setattr, renorm.BatchRenorm2d, "limits", renorm.LIMITS)
        torch.set_num_threads(1)
        terms.mark(self.folder, terms.ingredients(self.folder) | terms.DEPTH)
        fixed = ("--cpu", "--tiny", "--no-bf16", "--minutes", 60, "--steps", 5, "--open", "--everyday", self.folder)
        call = [self.at / "nothing", self.at / "run", *fixed, "--scenes", scenes_folder(self.at / "scenes")]
        with contextlib.redirect_stdout(io.StringIO()) as said, unittest.mock.patch("targets.loss3d", wraps=targets.loss3d) as asked:
            train.main([*map(str, call)])
        self.assertIn("BlazePose (Apache-2.0)", said.getvalue())
        self.assertEqual([len(c.args[0]) for c in asked.call_args_list][1::2], [2] * 5)  # photos, after rendered tiles
        self.assertTrue(any(c.args[1].enc_weight.any() for c in asked.call_args_list[1::2]))


if __name__ == "__main__":
    unittest.main()
