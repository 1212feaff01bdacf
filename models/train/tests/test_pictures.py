"""Pictures that are changed before training: sharpened, dimmed, framed, windows of panoramas. No data needed."""

from __future__ import annotations

import pathlib
import sys
import unittest

import numpy as np
import torch
from PIL import Image

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path[:0] = [str(KIT), str(KIT / "tests")]

from augment import sharpen
from crowd import PERSON
from dim import FULL_WELL, READ_NOISE, dim, linear, stored
from framed import FRAME, cut_off, frame
from skeleton import NB, NJ, ROOT, limb_chain
from windows import most_seen, seen_through, window


class Sharpening(unittest.TestCase):
    def test_edges_get_steeper_and_flat_places_stay(self) -> None:
        edge = torch.full((2, 3, 16, 16), 0.3)
        edge[..., 8:] = 0.7
        edge = torch.nn.functional.avg_pool2d(torch.nn.functional.pad(edge, (1, 1, 1, 1), mode="replicate"), 3, 1)
        same, sharp = sharpen(edge, torch.tensor([0.0, 1.5]))
        torch.testing.assert_close(same, edge[0])
        torch.testing.assert_close(sharp[..., [0, -1]], edge[1][..., [0, -1]])
        self.assertGreater(float(sharp.diff(dim=2).max()), 1.4 * float(edge.diff(dim=3).max()))


class Dimming(unittest.TestCase):
    def test_gain_brings_back_brightness_and_not_what_was_lost(self) -> None:
        rng = np.random.default_rng(3)
        picture = np.full((64, 64, 3), 120, np.uint8)
        same, weak, dark = (dim(picture, light, 8.0, rng) for light in (1.0, 0.125, 0.02))
        for x in (same, weak):
            self.assertLess(abs(float(linear(x / 255.0).mean()) / linear(np.array(120 / 255.0)) - 1), 0.02)
        # beyond the gain it gets darker: 0.02 · 8 of the light
        self.assertLess(abs(float(linear(dark / 255.0).mean()) / (0.16 * linear(np.array(120 / 255.0))) - 1), 0.05)
        # the fewer the photons, the larger their relative noise: √(n + 4²) / n with n electrons
        for x, light in ((weak, 0.125), (dark, 0.02)):
            n = FULL_WELL * light * linear(np.array(120 / 255.0))
            v = linear(x / 255.0)
            self.assertLess(abs(float(v.std() / v.mean()) / (np.sqrt(n + READ_NOISE**2) / n) - 1), 0.1)

    def test_stored_undoes_linear(self) -> None:
        x = np.linspace(0, 1, 256)
        self.assertLess(np.abs(stored(linear(x)) - x).max(), 1e-6)


class Framed(unittest.TestCase):
    def test_joints_stay_on_their_pixels_and_people_get_the_wanted_size(self) -> None:
        joints = np.concatenate([PERSON + np.array([40, 20], np.float32), np.ones((NJ, 1), np.float32)], 1)
        photo = np.full((190, 80, 3), 20, np.uint8)
        photo[17:24, 37:44] = photo[162:169, 25:32] = 255  # head top and right ankle
        for tall in (70.0, 150.0, 900.0):
            picture, moved = frame(Image.fromarray(photo), joints, tall)
            self.assertEqual(picture.size, FRAME)
            wanted = min(tall, FRAME[1] / 190 * float(limb_chain(joints[None])[0]))
            self.assertAlmostEqual(float(limb_chain(moved[None])[0]), wanted, delta=0.03 * wanted)
            x = np.asarray(picture, np.float32)[..., 0]
            for j in (0, 10):
                c, r = moved[j, :2]
                ys, xs = np.mgrid[int(r) - 8 : int(r) + 9, int(c) - 8 : int(c) + 9]
                bright = np.maximum(x[ys, xs] - 20, 0)
                self.assertAlmostEqual(float((bright * xs).sum() / bright.sum()), c, delta=0.3)
                self.assertAlmostEqual(float((bright * ys).sum() / bright.sum()), r, delta=0.3)


    def test_who_is_cut_off_fills_the_frame_down_to_the_cut(self) -> None:
        joints = np.concatenate([PERSON + np.array([40, 20], np.float32), np.ones((NJ, 1), np.float32)], 1)
        photo = np.full((190, 80, 3), 20, np.uint8)
        photo[17:24, 37:44] = 255  # head top
        for where, hips, knees in (("hips", 1, 0), ("thighs", 1, 0)):
            cut = cut_off(Image.fromarray(photo), joints, where)
            assert cut is not None
            picture, moved = cut
            self.assertEqual(picture.size, FRAME)
            self.assertAlmostEqual(moved[0, 1], 0.25 * FRAME[1], delta=2)
            self.assertEqual(moved[[8, 11], 2].tolist(), [hips, hips])
            self.assertEqual(moved[[9, 12, 10, 13], 2].tolist(), [knees] * 4)
            x = np.maximum(np.asarray(picture, np.float32)[..., 0] - 120, 0)  # beside the photo it is grey
            ys, xs = np.mgrid[: FRAME[1], : FRAME[0]]
            self.assertAlmostEqual(float((x * xs).sum() / x.sum()), moved[0, 0], delta=0.5)
            self.assertAlmostEqual(float((x * ys).sum() / x.sum()), moved[0, 1], delta=0.5)
        lying = joints.copy()
        lying[:, :2] = joints[:, [1, 0]]
        self.assertIsNone(cut_off(Image.fromarray(photo), lying, "hips"))


class Windows(unittest.TestCase):
    def test_a_window_keeps_rays_and_says_who_is_outside(self) -> None:
        rng = np.random.default_rng(1)
        camera = dict(fx=900.0, fy=900.0, cx=511.5, cy=319.5)
        joints3d = np.array([[0.0, -0.8 + 0.08 * j, 3.0] for j in range(NB)])
        joints2d = joints3d[:, :2] / joints3d[:, 2:] * 900 + [511.5, 319.5]
        one = dict(stature=1.7, joints3d=joints3d.tolist(), joints2d=joints2d.tolist(), visibility=[1] * NB, box=[400.0, 50.0, 600.0, 600.0], pixels=9e4)
        left, upper, scale = window(one, camera, (1024, 640), (600, 600), rng)
        self.assertAlmostEqual(scale * 900 * 1.7 / joints3d[ROOT][2], 600, delta=1)
        [seen] = seen_through([one], left, upper, scale)
        there = np.array(seen["joints2d"])
        inside = (there > -0.5).all(1) & (there < np.array([512, 320]) - 0.5).all(1)
        self.assertTrue(inside[0] and not inside[NB - 1])
        self.assertEqual(seen["visibility"], inside.astype(int).tolist())
        moved = (np.array([511.5, 319.5]) + 0.5 - [left, upper]) * scale - 0.5
        rays = joints3d[:, :2] / joints3d[:, 2:] * 900 * scale + moved
        self.assertLess(np.abs(rays - there).max(), 0.02)
        self.assertLessEqual(seen["box"][3], 320)
        self.assertLess(seen["pixels"], 9e4 * scale**2)
        self.assertEqual(seen_through([one], 5000, 0, scale), [])

    def test_a_film_is_of_whoever_shows_their_head_most(self) -> None:
        camera = dict(fx=900.0)

        def person(id_: int, distance: float, head: int) -> dict:
            return dict(id=id_, stature=1.7, joints3d=[[0.0, 0.0, distance]] * NB, visibility=[head, 1] + [1] * (NB - 2))

        # 510 px, head hidden twice; 510 px; too far away
        frames = [dict(camera=camera, people=[person(1, 3.0, int(k < 3)), person(2, 3.0 + k / 100, 1), person(3, 30.0, 1)]) for k in range(5)]
        chosen = most_seen(frames, 300)
        assert chosen
        self.assertEqual((chosen[0]["id"], chosen[0]["joints3d"][0][2]), (2, 3.02))
        self.assertIsNone(most_seen(frames, 900))


if __name__ == "__main__":
    unittest.main()
