"""Training tiles: what lies beyond a scene, joints beyond a tile, people behind others, turned and close ones, photos shown whole. No data needed."""

from __future__ import annotations

import io
import pathlib
import sys
import tempfile
import unittest

import numpy as np
import torch
from PIL import Image

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path[:0] = [str(KIT), str(KIT / "tests")]

import targets
import train
from augment import GREYS
from crowd import PERSON, crowd
from pool import Pool
from real import People, RealBatch
from skeleton import LIMBS, NB, NJ, ROOT, STRIDE

CPU = torch.device("cpu")
ELBOW, WRIST = 3, 4
FOREARM = NJ + 2 * LIMBS.index((WRIST, ELBOW))


def scene(image: torch.Tensor, *people: tuple[float, float]) -> Pool:
    """One scene [3, H, W] of people all of whose joints lie in one place each and can be seen."""
    joints3d = torch.randn(1, len(people), NB, 3) + torch.tensor([0.0, 0.0, 9.0])
    joints2d = torch.tensor(people)[None, :, None].expand(1, -1, NJ, 2)
    seen, size = torch.ones(1, len(people), NJ, dtype=torch.uint8), torch.full((1, len(people)), 100.0)
    return Pool(dict(image=image[None], joints2d=joints2d, visible=seen, joints3d=joints3d, rel3d=joints3d, size_px=size), 1, seed=3)


class BeyondScenes(unittest.TestCase):
    def test_nothing_is_shown_twice(self) -> None:
        """A white spot 10 px above the lower edge, in tiles that are higher than the scene."""
        image = torch.full((3, 320, 512), 20, dtype=torch.uint8)
        image[:, 306:313, 250:257] = 255
        tiles = scene(image, (253.0, 309.0)).draw(30, 512, 320, (0.95, 1.4)).image
        shown = 0
        for tile in tiles:
            y, x = torch.nonzero(tile.amin(0) > 0.8, as_tuple=True)
            if len(y):
                shown += 1
                self.assertLess(max(int(y.max() - y.min()), int(x.max() - x.min())), 16, "more than one spot")
        self.assertGreater(shown, 20)

    def test_beyond_it_is_one_grey(self) -> None:
        tiles = scene(torch.full((3, 320, 512), 255, dtype=torch.uint8), (200.0, 200.0)).draw(40, 512, 320, (1.0, 1.0), roll=0.0).image
        self.assertTrue(bool((tiles[:, :, 100:-100] > 0.999).all()))
        beyond = torch.cat([tiles[:, :, :90], tiles[:, :, -90:]], 2)
        self.assertTrue(torch.equal(beyond, beyond[:, :1, :1, :1].expand_as(beyond)))
        self.assertEqual({round(v, 4) for v in beyond[:, 0, 0, 0].tolist()}, {round(v, 4) for v in GREYS})

    def test_mixes_show_little_grey(self) -> None:
        pool = scene(torch.full((3, 320, 512), 255, dtype=torch.uint8), (200.0, 200.0))
        mixes = (m for phases in train.PHASES.values() for phase in phases for m in phase.mixes if not m.close)
        for H, W, zoom in sorted({(m.H, m.W, m.zoom) for m in mixes}):
            grey = float((pool.draw(8, H, W, zoom[:1] * 2).image[:, 0] < 0.9).float().mean())
            self.assertLess(grey, 0.38, f"{W} x {H} at {zoom[0]}, where a scene is smallest")


class BeyondTiles(unittest.TestCase):
    """Somebody whose wrist lies to the left of the tile and whose other joints are in it."""

    def labels(self, wrist: float, seen: float = 1.0) -> targets.Targets:
        j = torch.from_numpy(PERSON)[None, None] + torch.tensor([60.0, 60.0])
        j[0, 0, WRIST] = torch.tensor([wrist, 120.0])
        visible = torch.full((1, 1, NJ), seen)
        visible[0, 0, WRIST] = 0
        size = torch.full((1, 1), 150.0)
        return targets.synthetic(j, visible, torch.zeros(1, 1, NB, 3), size, size / 50, 40, 64)

    def test_a_joint_at_the_edge_is_neither_demanded_nor_forbidden(self) -> None:
        t = self.labels(-5.0)
        row = round((120 - 3.5) / STRIDE)
        self.assertEqual(float(t.maps[0, WRIST].max()), 0)
        self.assertEqual(float(t.weight[0, WRIST, row, 0]), 0)
        self.assertEqual(float(t.weight[0, WRIST, :, 4:].min()), 1)
        self.assertEqual(float(t.weight[0, :WRIST].min()), 1, "channels of other joints")

    def test_a_joint_far_away_and_one_that_is_not_in_the_picture_are_background(self) -> None:
        for wrist in (-60.0, 100.0):  # the latter beyond the scene, over the grey beside it
            self.assertEqual(float(self.labels(wrist).weight[0, WRIST].min()), 1)

    def test_whoever_reaches_to_the_edge_is_left_open_there(self) -> None:
        t = scene(torch.zeros(3, 96, 512, dtype=torch.uint8), (130.0, 48.0), (60.0, 48.0)).draw(200, 96, 104, (1.0, 1.0), roll=0.0)
        x = t.joints2d[:, :, 0, 0]
        away = torch.maximum(-0.5 - x, x - 103.5)
        self.assertTrue(torch.equal(t.size_px > 0, away < 32))
        self.assertTrue(torch.equal(t.visible.eq(1).all(-1), away <= 0))
        edge = (away > 0) & (away < 6)
        self.assertTrue(bool(edge.any()) and bool((away > 32).any()))
        weight = targets.synthetic(t.joints2d, t.visible, t.rel3d, t.size_px, t.depth, 12, 13).weight
        self.assertTrue(bool((weight[edge.any(1), 0].amin((1, 2)) == 0).all()))


class Behind(unittest.TestCase):
    """Two people, the second pasted over a wrist of the first."""

    def labels(self, hidden: bool, at: tuple[float, float] = (172.0, 100.0)) -> targets.Targets:
        j = crowd((60, 60), (180, 60))
        j[0, 0, ELBOW], j[0, 0, WRIST] = torch.tensor([120.0, 100.0]), torch.tensor(at)
        labelled, behind = torch.ones(1, 2, NJ, dtype=torch.bool), torch.zeros(1, 2, NJ, dtype=torch.bool)
        labelled[0, 0, WRIST], behind[0, 0, WRIST] = False, hidden
        box = torch.zeros(1, 2, 40, 64, dtype=torch.bool)
        box[0, 0, 6:28, 3:19], box[0, 1, 6:28, 19:28] = True, True
        no = torch.zeros(1, 2, dtype=torch.bool)
        return targets.real(j, labelled, behind, torch.full((1, 2), 150.0), torch.ones(1, 40, 64), box, torch.zeros(1, 2, NB, 3), no)

    def test_a_joint_behind_somebody_is_neither_demanded_nor_forbidden(self) -> None:
        x, y = round((172 - 3.5) / STRIDE), round((100 - 3.5) / STRIDE)
        t = self.labels(True)
        self.assertEqual(float(t.weight[0, WRIST, y, x]), 0)
        self.assertEqual(float(t.weight[0, WRIST, y, 8]), 1, "where the person can be seen")
        self.assertEqual(float(t.weight[0, FOREARM : FOREARM + 2, y, x - 2].max()), 0)
        self.assertEqual(float(t.weight[0, FOREARM : FOREARM + 2, 10, 8].min()), 1)
        self.assertTrue(torch.equal(t.maps, self.labels(False).maps))

    def test_whoever_stands_in_front_counts_wherever_they_are(self) -> None:
        own = PERSON[WRIST] + [180, 60]
        t = self.labels(True, (float(own[0]) + 6, float(own[1]) - 6))
        shown = t.maps[0, WRIST] > 0.05
        self.assertTrue(bool(shown.any()) and bool((t.weight[0, WRIST][shown] == 1).all()))
        self.assertEqual(float(t.weight[0, WRIST, 6:28, 19:28].min()), 0)

    def test_a_joint_without_a_label_is_left_open_where_the_person_can_be_seen(self) -> None:
        t = self.labels(False)
        self.assertEqual(float(t.weight[0, WRIST, 12, 8]), 0)


class Tiles(unittest.TestCase):
    def test_depth_labels_turn_with_the_picture(self) -> None:
        """Seen from far away, a bone's x and y are its pixels over a scale, however the tile is turned; some tiles lie on their side."""
        g = torch.Generator().manual_seed(5)
        rel = torch.randn(1, 1, 21, 3, generator=g) * 0.3
        rel = rel - rel[:, :, ROOT : ROOT + 1]
        pixels = 40.0
        data = dict(
            image=torch.zeros(1, 3, 96, 96, dtype=torch.uint8),
            joints2d=rel[:, :, :NJ, :2] * pixels + 48,
            visible=torch.ones(1, 1, NJ, dtype=torch.uint8),
            joints3d=rel + torch.tensor([0.0, 0.0, 9.0]),
            rel3d=rel,
            size_px=torch.full((1, 1), 68.0),
        )
        t = Pool(data, 1, seed=3).draw(400, 96, 96, zoom=(1.0, 1.0))
        seen = (t.joints2d - t.joints2d[:, :, 1:2]) / pixels
        told = (t.rel3d[:, :, :NJ] - t.rel3d[:, :, 1:2])[..., :2]
        self.assertLess(float((seen - told).abs().max()), 1e-4)
        up = told[:, 0, 0] / told[:, 0, 0].norm(dim=-1, keepdim=True)
        own = (rel[0, 0, 0] - rel[0, 0, 1])[:2]
        own = own / own.norm()
        mirrored = own * torch.tensor([-1.0, 1.0])
        turned = torch.maximum((up @ own), (up @ mirrored)) < 0.7
        self.assertGreater(int(turned.sum()), 10)
        self.assertLess(int(turned.sum()), 70)


    def test_close_people_are_as_large_as_asked_and_show_their_heads(self) -> None:
        for side in (256, 1024):  # what is rendered larger may come closer
            joints = torch.full((1, 1, NJ, 2), 0.5 * side) + torch.linspace(-0.4, 0.4, NJ)[:, None] * torch.tensor([0.0, side])
            data = dict(
                image=torch.zeros(1, 3, side, side, dtype=torch.uint8),
                joints2d=joints,
                visible=torch.ones(1, 1, NJ, dtype=torch.uint8),
                joints3d=torch.randn(1, 1, NB, 3) + torch.tensor([0.0, 0.0, 9.0]),
                rel3d=torch.randn(1, 1, NB, 3),
                size_px=torch.full((1, 1), 0.8 * side),
            )
            t = Pool(data, 1, seed=3).draw(200, 96, 96, zoom=(0.5, 2.0), roll=0.0, close=(200.0, 600.0))
            most = min(600.0, 1.6 * side)
            self.assertTrue(bool(((t.size_px > 199) & (t.size_px < most + 1)).all()))
            self.assertGreater(float(t.size_px.max()), 0.9 * most)
            self.assertGreater(float(t.visible[:, 0, 0].float().mean()), 0.5)


class Photos(unittest.TestCase):
    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        pack, file = pathlib.Path(folder.name), io.BytesIO()
        Image.new("RGB", (500, 400), (200, 90, 90)).save(file, "webp")
        (pack / "images.bin").write_bytes(4 * file.getvalue())
        np.savez(
            pack / "images.npz",
            offset=np.arange(5) * len(file.getvalue()),
            size=np.full((4, 2), (400, 500), np.int16),
            set=np.array([0, 1, 1, 1], np.uint8),
            joints=np.tile(np.concatenate([PERSON + [250, 120], np.ones((NJ, 1))], 1).astype(np.float32), (4, 1, 1)),
            names=np.array(["0.jpg"] * 4),
            set_names=np.array(["lspet_train", "lsp_train"]),
        )
        self.people = People(pack, CPU, torch.zeros(2, 3, 300, 400, dtype=torch.uint8), 3)

    def batch(self, people: list[float], **more: float) -> RealBatch:
        return self.people.batch(48, 256, 256, (150, 220), people, **more)

    def test_bystanders_are_in_nobody_s_box(self) -> None:
        """Composites take no photo as a whole, in which whoever else is found might be a bystander."""
        whole, cut = self.batch([0.0, 1.0], whole=1.0), self.batch([0.0, 1.0], whole=0.0)
        self.assertLess(float(whole.known.mean()), 0.7)
        self.assertGreater(float(cut.known.mean()), 0.9)  # all but the soft edge of what is pasted
        for b in (whole, cut):
            self.assertTrue(bool((b.known[b.box.any(1)] == 1).all()))

    def test_joints_behind_whoever_was_pasted_later_are_hidden(self) -> None:
        b = self.batch([0.0, 0.0, 0.0, 1.0])
        self.assertTrue(bool(b.hidden.any()))
        self.assertFalse(bool((b.hidden & b.labelled).any()))
        self.assertFalse(bool(b.hidden[:, 2].any()), "nobody was pasted over the last")
        self.assertTrue(bool((b.hidden | b.labelled).all()), "all joints are labelled in these photos")


if __name__ == "__main__":
    unittest.main()
