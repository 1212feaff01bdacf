"""Photos and scenes as they are packed, and who stands beside whom in them. No data needed."""

from __future__ import annotations

import io
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest
from unittest import mock

import numpy as np
import torch
from PIL import Image

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path[:0] = [str(KIT), str(KIT / "tests")]

import pack
import prerender
import real
import terms
import truth
from composites import OUTSIDE, VISIBLE, person
from crowd import PERSON
from pool import FIELDS, Stored
from real import arrange
from skeleton import NB, NJ


class Packed(unittest.TestCase):
    def test_photos_are_upright_whoever_decodes_them(self) -> None:
        turned = Image.Exif()
        turned[0x0112] = 6
        file = io.BytesIO()
        Image.new("RGB", (40, 20)).save(file, "JPEG", exif=turned)
        self.assertEqual(real.decode(file.getvalue()).shape, (40, 20, 3))
        with mock.patch.dict(sys.modules, cv2=None):
            upright = real.decode(file.getvalue())
        self.assertEqual(upright.shape, (40, 20, 3))
        upright[0, 0] = 7  # may be written to

    def test_decoded_pictures_of_another_pack_are_not_taken(self) -> None:
        names = {real.cached_name(files, 200) for files in ([b"one", b"two"], [b"one", b"too"], [b"one", b"two"])}
        self.assertEqual(len(names), 2)

    def test_other_pictures_take_the_teacher_s_answers_away(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            data, out = pathlib.Path(d) / "data", pathlib.Path(d) / "pack"
            for folder in (data / "people2d/lspet", data / "no_people", out):
                folder.mkdir(parents=True)
            Image.new("RGB", (80, 60)).save(data / "people2d/lspet/1.jpg")
            row = dict(file="lspet/1.jpg", split="train", joints=[[79, 59, 1]] * NJ)
            (data / "people2d/annotations.json").write_text(json.dumps([row]))
            (out / "teacher.npz").touch()
            pack.pack_images(data, out, 40, 50, False)
            self.assertFalse((out / "teacher.npz").exists())
            z = np.load(out / "images.npz")
            self.assertEqual(z["size"].tolist(), [[30, 40]])
            np.testing.assert_allclose(z["joints"][0, 0], [39.25, 29.25, 1])


class RenderedScenes(unittest.TestCase):
    def test_photos_with_truth_are_no_scenes(self) -> None:
        """They come in the same format, and what is packed as scenes counts as open."""
        codes = np.full(NJ, VISIBLE)
        with tempfile.TemporaryDirectory() as folder:
            pictures, out = pathlib.Path(folder) / "photos", pathlib.Path(folder) / "scenes"
            pictures.mkdir()
            Image.new("RGB", (512, 320)).save(pictures / "000000.jpg")
            camera = dict(fx=512, fy=512, cx=255.5, cy=159.5)
            frames = [dict(file="000000.jpg", camera=camera, people=[person(1, PERSON, codes)])]
            (pictures / "truth.json").write_text(json.dumps(dict(format="edgecap-truth", version=1, frames=frames)))
            with self.assertRaisesRegex(SystemExit, "no scenes"):
                truth.main([str(pictures), str(out)])
            self.assertFalse(out.exists())

    def test_what_ends_halfway_leaves_no_scenes_of_before(self) -> None:
        joints = [[0.01 * j, 0.02 * j, 4.0] for j in range(NB)]
        seen = dict(stature=1.7, joints3d=joints, joints2d=[[9.0, 9.0]] * NB, visibility=[VISIBLE] * NB)
        camera = dict(fx=400.0, fy=400.0, cx=256.0, cy=160.0)
        with tempfile.TemporaryDirectory() as folder:
            synth, out = pathlib.Path(folder) / "synth", pathlib.Path(folder) / "scenes"
            synth.mkdir()
            files = [f"{k}.png" for k in range(2)]
            frames = [dict(file=name, camera=camera, people=[seen]) for name in files]
            (synth / "truth.json").write_text(json.dumps(dict(format="edgecap-truth", version=1, frames=frames)))
            for name in files:
                Image.new("RGB", (512, 320)).save(synth / name)
            truth.main([str(synth), str(out)])
            self.assertEqual(Stored(out, 1).filled, 2)
            (synth / files[1]).write_bytes(b"no picture")
            with self.assertRaises(OSError):
                truth.main([str(synth), str(out)])
            self.assertFalse(terms.is_open(out))
            with self.assertRaisesRegex(SystemExit, "expected scenes in .*scenes, found none"):
                Stored(out, 1)

    def test_scenes_that_are_rendered_later_are_copied_to_the_device(self) -> None:
        """With another name for the CPU, it stands for a GPU."""
        with tempfile.TemporaryDirectory() as name:
            out = pathlib.Path(name)
            files = {k: np.lib.format.open_memmap(out / f"{k}.npy", "w+", np.float32, (3, 1, 4, 4)) for k in FIELDS}

            def render(row: int) -> None:
                for file in files.values():
                    file[row] = row + 1
                    file.flush()
                (out / "filled").write_text(str(row + 1))

            render(0)
            for elsewhere in (torch.device("cpu"), torch.device("meta")):
                with mock.patch("pool.CPU", elsewhere):
                    pool = Stored(out, 1, torch.device("cpu"))
                self.assertEqual(pool.data is pool.files, elsewhere.type == "cpu")
                known = pool.filled
                render(known)
                pool.refresh(1)
                self.assertEqual(pool.filled, known + 1)
                for field in pool.data.values():
                    self.assertEqual(field[: known + 1, 0, 0, 0].tolist(), list(range(1, known + 2)))

    def test_scenes_are_counted_anew_where_others_are_rendered(self) -> None:
        """What is rendered lacks the last field, so the first ones are replaced and nothing is counted."""
        halves = mock.Mock(render=lambda n: mock.Mock(spec=FIELDS[:1], **{FIELDS[0]: torch.zeros(n, 1)}))
        with tempfile.TemporaryDirectory() as folder, mock.patch("prerender.Generator", lambda *_, **__: halves), mock.patch("prerender.load_photos"):
            out = pathlib.Path(folder)
            (out / "filled").write_text("1500")
            with self.assertRaises(AttributeError):
                prerender.main([str(out), str(out), "--n", "4"])
            self.assertTrue((out / f"{FIELDS[0]}.npy").exists())
            with self.assertRaises(SystemExit):
                Stored(out, 1)

    def test_everybody_of_the_fullest_picture_has_a_place(self) -> None:
        joints3d = [[0.01 * j, 0.02 * j, 4.0] for j in range(NB)]
        joints2d = [[256 + 400 * p[0] / p[2], 160 + 400 * p[1] / p[2]] for p in joints3d]
        seen = dict(stature=1.7, joints3d=joints3d, joints2d=joints2d, visibility=[VISIBLE] * NB)
        unseen = seen | dict(visibility=[OUTSIDE] * NB)
        camera = dict(fx=400.0, fy=400.0, cx=256.0, cy=160.0)
        with tempfile.TemporaryDirectory() as folder:
            out = pathlib.Path(folder) / "scenes"
            synths = []
            for name, blue, crowds in (("one", 199, (2, 9)), ("other", 40, (1,))):
                synth = pathlib.Path(folder) / name
                synth.mkdir()
                Image.new("RGB", (512, 320), (9, 99, blue)).save(synth / "000000.png")
                frames = [dict(file="000000.png", camera=camera, people=n * [seen] + [unseen]) for n in crowds]
                (synth / "truth.json").write_text(json.dumps(dict(format="edgecap-truth", version=1, frames=frames)))
                synths.append(synth)
            subprocess.run([sys.executable, KIT / "truth.py", *synths, out], check=True, capture_output=True)
            pool = Stored(out, 1)
            self.assertTrue(terms.is_open(out))
            self.assertEqual((pool.data["size_px"] > 0).sum(1).tolist(), [2, 9, 1])
            self.assertEqual(pool.data["image"][:, 2, 7, 7].tolist(), [199, 199, 40])
            tiles = pool.draw(4, 320, 512, (1.0, 1.0), roll=0.0)
            self.assertEqual(tiles.joints2d.shape, (4, 9, NJ, 2))
            self.assertTrue(bool((tiles.visible.eq(VISIBLE).all(-1).sum(1)[:, None] == torch.tensor([2, 9, 1])).any(1).all()))


class Company(unittest.TestCase):
    def setUp(self) -> None:
        self.n = torch.arange(1, 5).repeat(500)
        self.tall, self.cx, self.cy = arrange(self.n, 4, (100, 300), torch.Generator().manual_seed(3))

    def test_who_is_taller_is_pasted_over_the_others(self) -> None:
        for k in range(2, 5):
            tall = self.tall[self.n == k, :k]
            self.assertTrue((tall[:, 1:] >= tall[:, :-1]).all())
            ratio = tall[:, -1] / tall[:, 0]
            self.assertGreater(float(ratio.max()), 1.9)  # behind each other
            self.assertLess(float(ratio.median()), 1.6)  # but mostly beside each other

    def test_somebody_alone_is_as_tall_as_asked_for_and_near_the_middle(self) -> None:
        alone = self.n == 1
        tall = self.tall[alone, 0]
        self.assertTrue(((tall >= 100) & (tall <= 300)).all())
        self.assertTrue(((self.cx[alone, 0] - 0.5).abs() <= 0.3).all() and ((self.cy - 0.5).abs() <= 0.225).all())

    def test_most_stand_in_a_row_and_some_close_together(self) -> None:
        x = self.cx[self.n == 4].sort(1)[0]
        width = x[:, -1] - x[:, 0]
        self.assertGreater(float(width.quantile(0.7)), 0.6)
        self.assertLess(float(width.quantile(0.15)), 0.5)


if __name__ == "__main__":
    unittest.main()
