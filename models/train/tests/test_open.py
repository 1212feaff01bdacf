"""Training on open data alone: what is taken, what is refused, and that it learns from random weights. No data needed."""

from __future__ import annotations

import contextlib
import copy
import gzip
import io
import json
import math
import pathlib
import subprocess
import sys
import tempfile
import types
import unittest
import unittest.mock

import numpy as np
import torch

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path[:0] = [str(KIT), str(KIT / "tests")]

import attribution
import checkpoint
import everyday
import export
import mistakes
import quant
import renorm
import terms
import test_everyday as labelled
import train
import weights
from coco17 import HEAD_TOP, LABELLED, LSP, NECK, OPEN, to14
from everyday_tiles import Everyday
from model import SelecSLSNet
from pool import FIELDS
from skeleton import NB, NJ
from test_everyday import ALL, SIDE, STANDING, person

OPEN_ROW = dict(source="free_exercise", size=[SIDE, SIDE], split="train", more=0)


def everyday_folder(where: pathlib.Path, only_open: bool = True) -> pathlib.Path:
    rows = [OPEN_ROW | dict(file=f"{k}.jpg", src=f"exercises/{k}/0.jpg", people=[person()]) for k in range(3)]
    return labelled.Tiles().folder(where, rows, only_open)


def scenes_folder(where: pathlib.Path, mark: bool = True) -> pathlib.Path:
    """Two scenes of one person in front of grey."""
    where.mkdir()
    j3 = np.tile(np.array([[0.02 * j - 0.2, 0.05 * j - 0.5, 4.0] for j in range(NB)], np.float32), (2, 1, 1, 1))
    j2 = (j3[..., :NJ, :2] / 4 * 400 + [80, 60]).astype(np.float32)
    fields = dict(
        image=np.full((2, 3, 120, 160), 120, np.uint8),
        joints2d=j2,
        visible=np.ones((2, 1, NJ), np.uint8),
        joints3d=j3,
        rel3d=j3 - j3[:, :, 14:15],
        size_px=np.full((2, 1), 100, np.float32),
        K=np.tile(np.eye(3, dtype=np.float32), (2, 1, 1)),
    )
    for k in FIELDS:
        np.save(where / f"{k}.npy", fields[k])
    (where / "filled").write_text("2")
    if mark:
        terms.mark(where, terms.RENDERED)
    return where


class Rules(unittest.TestCase):
    def test_shares_add_up_and_agree_roughly_with_those_of_photographs(self) -> None:
        for rules in (OPEN, LSP):
            for shares in (rules.neck, rules.head_top_of_face, rules.head_top_of_ears):
                self.assertAlmostEqual(sum(shares.values()), 1, delta=0.002)
        (a, known), (b, _) = to14(STANDING[None], ALL[None], OPEN), to14(STANDING[None], ALL[None], LSP)
        self.assertTrue((known == LABELLED).all())
        torso = 90.0
        self.assertLess(np.linalg.norm(a[0, NECK] - b[0, NECK]), 0.05 * torso)
        self.assertLess(np.linalg.norm(a[0, HEAD_TOP] - b[0, HEAD_TOP]), 0.25 * torso)


class Marks(unittest.TestCase):
    def test_photos_packed_as_open_say_so_and_name_every_photo(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            out = everyday_folder(pathlib.Path(d))
            self.assertIn("Apache-2.0", terms.ingredients(out).values())
            self.assertEqual((out / "attribution.txt").read_text().splitlines(), [f"free_exercise exercises/{k}/0.jpg" for k in range(3)])

    def test_photos_packed_with_others_are_not_open_even_in_a_folder_that_was(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            where = pathlib.Path(d)
            (where / "out").mkdir()
            terms.mark(where / "out", terms.RENDERED)
            out = everyday_folder(where, only_open=False)
            self.assertFalse(terms.is_open(out))
            with self.assertRaisesRegex(SystemExit, "found no open.json"):
                terms.ingredients(out)

    def test_open_images_photos_are_named_by_their_id(self) -> None:
        row = dict(origin="openimages", src="train/images/0067227197b4a933_jpg.rf.e063636ea4f1bb1098d9d119818e0931.jpg")
        self.assertEqual(everyday.attribution("human_dataset_v2", row), "openimages 0067227197b4a933")
        with self.assertRaisesRegex(SystemExit, "16 hexadecimal digits"):
            everyday.attribution("human_dataset_v2", row | dict(src="train/images/holiday_jpg.rf.e063636ea4f1bb1098d9d119818e0931.jpg"))

    def test_authors_are_looked_up_and_photos_of_other_terms_named(self) -> None:
        known, other, strange = "0067227197b4a933", "013c49a036de77fb", "018e5c0299860c46"
        with tempfile.TemporaryDirectory() as d:
            where = pathlib.Path(d)
            (where / "attribution.txt").write_text(f"openimages {known}\nopenimages {other}\nopenimages {strange}\nfree_exercise a b/0.jpg\n")
            by = "https://creativecommons.org/licenses/by/2.0/"
            rows = [f'{known},"A walk, at noon",Ann,{by},https://p/1', f"{other},Rain,Bob,{by.replace('by', 'by-nc')},https://p/2", f"x,Sun,Cy,{by},u"]
            (where / "list.csv").write_text("\n".join(["ImageID,Title,Author,License,OriginalLandingURL", *rows]))
            paths = [str(where / n) for n in ("attribution.txt", "list.csv", "authors.tsv")]
            with contextlib.redirect_stdout(io.StringIO()) as said:
                self.assertEqual(attribution.main(paths), 1)
            self.assertEqual(said.getvalue().split()[-2:], [strange, other])
            self.assertEqual((where / "authors.tsv").read_text().splitlines()[0], f"{known}\tA walk, at noon\tAnn\t{by}\thttps://p/1")
            (where / "list.csv").write_text("ImageID,Author\n")
            with self.assertRaisesRegex(SystemExit, "found none of Title"):
                attribution.main(paths)

    def test_photos_can_be_left_out(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            where = pathlib.Path(d)
            everyday_folder(where)
            everyday.pack(where, where / "labels", where / "fewer", True, frozenset(["exercises/1/0.jpg"]))
            self.assertEqual(len((where / "fewer/attribution.txt").read_text().splitlines()), 2)

    def test_who_is_to_be_named_stands_behind_the_photo(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            where = pathlib.Path(d)
            everyday_folder(where)
            path = where / "labels" / "free_exercise.jsonl.gz"
            with gzip.open(path, "rt") as f:
                rows = [json.loads(line) for line in f]
            rows[1]["credit"] = "“At noon” by Ann, CC BY 2.0"
            with gzip.open(path, "wt") as f:
                f.writelines(json.dumps(r) + "\n" for r in rows)
            everyday.pack(where, where / "labels", where / "out", True)
            lines = (where / "out/attribution.txt").read_text(encoding="utf-8").splitlines()
            self.assertEqual(lines[1], "free_exercise exercises/1/0.jpg\t“At noon” by Ann, CC BY 2.0")
            # A line of it is enough to leave the photo out.
            (where / "these.txt").write_text(lines[1] + "\n", encoding="utf-8")
            everyday.pack(where, where / "labels", where / "out", True, everyday.named(where / "these.txt"))
            self.assertEqual((where / "out/attribution.txt").read_text(encoding="utf-8").splitlines(), [lines[0], lines[2]])

    def test_only_weights_that_say_so_are_open(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            path = pathlib.Path(d) / "stage1.safetensors"
            for said, fine in ((export.OPEN_STAGE1, True), (export.TRAINED_ON, False)):
                weights.write(path, {"a": torch.zeros(1)}, {"contract": json.dumps(dict(trained_on=said))})
                if fine:
                    terms.require_open_weights(path)
                else:
                    with self.assertRaisesRegex(SystemExit, "expected weights trained on open data"):
                        terms.require_open_weights(path)
            weights.write(path, {"a": torch.zeros(1)}, {})
            with self.assertRaises(SystemExit):
                terms.require_open_weights(path)
            with self.assertRaises(SystemExit):
                terms.require_open_weights(pathlib.Path(d) / "selecsls60.pth")


class Windows(unittest.TestCase):
    def test_some_tiles_look_past_everybody(self) -> None:
        beside = person()
        beside["kp"] = [[x * 0.3, y * 0.3, c] for x, y, c in beside["kp"]]
        beside["box"] = [v * 0.3 for v in beside["box"]]
        with tempfile.TemporaryDirectory() as d:
            out = labelled.Tiles().folder(pathlib.Path(d), [OPEN_ROW | dict(file="a.jpg", src="a.jpg", people=[beside])], True)
            share = [float((Everyday(out, 3, away).batch(24, 64, 64, (0.9, 1.0)).size_px > 0).any(1).float().mean()) for away in (0.0, 1.0)]
        self.assertGreater(share[0], 0.9)
        self.assertLess(share[1], 0.3)

    def test_people_are_as_tall_as_asked(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            e = Everyday(everyday_folder(pathlib.Path(d)), 3)
            size = e.batch(12, 192, 192, (0.6, 1.3), tall=(160, 180)).size_px
        self.assertTrue(bool(((size > 150) & (size < 190)).all()), size)


class Schedule(unittest.TestCase):
    def test_a_held_rate_warms_up_stays_and_falls_at_the_end(self) -> None:
        def at(p: float, step: int = 10_000) -> float:
            return train.lr_at(p, 2e-3, 0.2, step)

        self.assertLess(at(0.0, 0), 1e-5)
        self.assertEqual([at(0.1), at(0.5), at(0.79)], [2e-3] * 3)
        self.assertAlmostEqual(at(0.9), 1e-3)
        self.assertAlmostEqual(at(1.0), 4e-6)
        self.assertEqual(train.lr_at(0.03, 2e-3), 2e-3)  # one cycle, unless asked

    def test_teachers_are_asked_about_every_mix_and_about_both_sides_of_it(self) -> None:
        for mixes in {len(q.mixes) for phases in train.PHASES.values() for q in phases}:
            for every in range(1, 6):
                for first in range(3 * mixes * every):
                    asked = [(step % mixes, turn) for step in range(first, first + 2 * mixes * every) if (turn := train.turn_of(step, mixes, every)) is not None]
                    kinds = [(mix, turn % 2) for mix, turn in asked]
                    self.assertEqual(sorted(kinds), [(mix, side) for mix in range(mixes) for side in range(2)], (mixes, every, first))

    def test_normalisation_begins_as_batch_normalisation(self) -> None:
        self.assertEqual(renorm.limits_at(0), (1, 0))
        self.assertEqual(renorm.limits_at(10**6), renorm.LIMITS)
        layer = renorm.BatchRenorm2d(3)
        x = torch.randn(4, 3, 8, 8) * 5 + 2
        layer.limits = renorm.limits_at(0)
        self.assertTrue(torch.allclose(layer(x), torch.nn.BatchNorm2d(3)(x), atol=1e-4))

    def test_every_phase_of_open_data_draws_open_data_alone(self) -> None:
        for kind in ("cpu open", "gpu open", "tiny open"):
            self.assertTrue(all(m.real == 0 and m.everyday > 0 and m.synth > 0 for q in train.PHASES[kind] for m in q.mixes), kind)


class Run(unittest.TestCase):
    def setUp(self) -> None:
        self.addCleanup(torch.set_num_threads, torch.get_num_threads())
        torch.set_num_threads(1)  # threads of one process wait for each other where others want the cores
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.addCleanup(setattr, renorm.BatchRenorm2d, "limits", renorm.LIMITS)
        self.at = pathlib.Path(self.folder.name)
        (self.at / "photos").mkdir()
        self.everyday = everyday_folder(self.at / "photos")
        self.scenes = scenes_folder(self.at / "scenes")

    def arguments(self, *more: object, steps: int = 5) -> list[str]:
        fixed = (self.at / "nothing", self.at / "run", "--cpu", "--tiny", "--no-bf16", "--minutes", 60, "--fall", 0.2, "--steps", steps)
        return [str(x) for x in (*fixed, "--everyday", self.everyday, *more)]

    def test_the_3d_head_alone_learns_where_that_is_asked(self) -> None:
        seen = []
        for steps, more in ((3, ()), (6, ("--resume",))):
            train.main(self.arguments("--open", "--scenes", self.scenes, "--head3d", *more, steps=steps))
            nets = [SelecSLSNet(), SelecSLSNet()]
            checkpoint.load(self.at / "run/ckpt", *nets, None, torch.device("cpu"))
            seen.append([net.state_dict() for net in nets])
        for before, after in zip(*seen):
            changed = {k.split(".")[0] for k in before if not torch.equal(before[k], after[k])}
            self.assertEqual(changed, {"head3d"})

    def test_lsp_is_not_read_where_it_has_no_depth_to_teach(self) -> None:
        # the pack is a folder that is not there
        train.main(self.arguments("--scenes", self.scenes, "--head3d", steps=2))
        self.assertTrue((self.at / "run/ckpt").exists())
        with self.assertRaises(FileNotFoundError):
            train.main(self.arguments("--scenes", self.scenes, steps=2))

    def test_weights_that_are_no_numbers_never_take_the_last_good_ones_place(self) -> None:
        bad, good = SelecSLSNet(), SelecSLSNet()
        with torch.no_grad():
            bad.head2d.out.bias[3] = math.nan
        trainer = train.Trainer.__new__(train.Trainer)
        trainer.group, trainer.out, trainer.meta, trainer.opt = types.SimpleNamespace(first=True, average_statistics=lambda net: None), self.at, {}, None
        trainer._meet = lambda: None
        for trainer.net, trainer.ema, saves in ((bad, good, 0), (good, bad, 0), (good, good, 1)):
            with unittest.mock.patch("checkpoint.save") as save:
                trainer.save()
            self.assertEqual(save.call_count, saves)
        with self.assertRaisesRegex(SystemExit, "lower --lr"):
            trainer.recover()

    def test_ranges_of_the_rounding_are_found_anew_where_the_last_checkpoint_has_none(self) -> None:
        net = SelecSLSNet()
        ema = copy.deepcopy(net)
        trainer = train.Trainer.__new__(train.Trainer)
        trainer.a = types.SimpleNamespace(head3d=False, freeze=0, muon=False, lr=1e-3, wd=0.0)
        trainer.net, trainer.ema, trainer.out, trainer.dev = net, ema, self.at, torch.device("cpu")
        trainer.meta = dict(step=7, quant=False, lr_scale=1.0)
        trainer.opt = trainer._optimizer()
        checkpoint.save(self.at / "ckpt", net, ema, trainer.opt, trainer.meta)
        trainer._quantise()
        for m in net.modules():
            if isinstance(m, quant.QuantReLU):
                m.amax.fill_(torch.inf)
        trainer.recover()
        self.assertEqual(trainer.meta, dict(step=7, quant=True, lr_scale=0.5))
        self.assertTrue(train.finite(net) and train.finite(ema))
        for m in net.modules():
            if isinstance(m, quant.QuantReLU):
                m.amax.fill_(3.0)
        checkpoint.save(self.at / "ckpt", net, ema, trainer.opt, trainer.meta)
        trainer.recover()
        self.assertEqual(set(quant.ranges(net).values()), {3.0})

    def test_the_log_says_the_rate_that_is_taken(self) -> None:
        trainer = train.Trainer.__new__(train.Trainer)
        trainer.meta, trainer.everyday, trainer.cuda = dict(step=9, images=90, lr_scale=0.5), None, False
        trainer.a = types.SimpleNamespace(lr=2e-3, fall=0.2)
        trainer.opt = torch.optim.SGD([torch.zeros(1, requires_grad=True)], lr=1e-3)
        log = io.StringIO()
        trainer._log(log, [0.0] * 8, 0.5, train.PHASES["tiny"][0].mixes[0], 1.0)
        self.assertEqual(json.loads(log.getvalue())["lr"], 1e-3)

    def test_a_pause_takes_no_more_of_the_schedule_than_a_step_may(self) -> None:
        """Steps of ten seconds with a night between two of them; every fourth step asks whether the 280 seconds of the
        schedule are over."""
        at = iter([0.0, 0.0, *(10.0 * k + (40_000 if k > 3 else 0) for k in range(1, 40))])
        options = ("--open", "--scenes", self.scenes, "--total", 280 / 60, "--sync", 4)
        with unittest.mock.patch("clock.time", types.SimpleNamespace(monotonic=lambda: next(at))):
            train.main(self.arguments(*options, steps=0))
        net = SelecSLSNet()
        meta = checkpoint.load(self.at / "run/ckpt", net, copy.deepcopy(net), None, torch.device("cpu"))
        # 120 seconds of the pause count: 270 after 16 steps
        self.assertEqual((meta["step"], meta["elapsed"]), (20, 310.0))

    def test_a_schedule_of_steps_has_no_call_to_end_with(self) -> None:
        with self.assertRaises(SystemExit), contextlib.redirect_stderr(io.StringIO()) as said:
            train.main(self.arguments("--scenes", self.scenes, "--finish"))
        self.assertIn("expected --finish", said.getvalue())

    def test_it_learns_from_random_weights_and_goes_on(self) -> None:
        options = ("--open", "--scenes", self.scenes)
        train.main(self.arguments(*options))
        train.main(self.arguments(*options, "--resume", steps=10))
        rows = [json.loads(x) for x in (self.at / "run/log.jsonl").read_text().splitlines()]
        self.assertEqual([r["step"] for r in rows], [5, 10])
        self.assertTrue(all(math.isfinite(r[k]) for r in rows for k in ("hm_real", "hm_syn", "enc", "where")), rows)
        with self.assertRaisesRegex(SystemExit, "go on with --open"):
            train.main(self.arguments("--scenes", self.scenes, "--resume"))
        net, ema = SelecSLSNet(), SelecSLSNet()
        meta = checkpoint.load(self.at / "run/ckpt", net, ema, None, torch.device("cpu"))
        export.export_stage1(ema, meta, self.at / "stage1.safetensors", None, False, True)
        terms.require_open_weights(self.at / "stage1.safetensors")
        with self.assertRaisesRegex(SystemExit, "no --pack"):
            export.export_stage1(ema, meta, self.at / "stage1.safetensors", self.at, False, True)

    def test_stage_2_takes_open_motion_alone(self) -> None:
        closed = scenes_folder(self.at / "pack", mark=False)
        call = [sys.executable, str(KIT / "stage2.py"), str(closed), str(self.at / "run"), "--cpu", "--open"]
        r = subprocess.run(call, capture_output=True, text=True, check=False)
        self.assertIn("found no open.json", r.stderr)
        terms.mark(closed, terms.BODY | terms.MOCAP)
        seen = self.at / "mistakes.pt"
        torch.save({"mistakes": {}, "seen": {}}, seen)
        for more in (("--mistakes", str(seen)), ("--init", str(KIT.parent / "weights/stage2.safetensors"))):
            r = subprocess.run([*call, *more], capture_output=True, text=True, check=False)
            self.assertRegex(r.stderr, "expected mistakes of open weights|expected weights trained on open data")

    def test_open_mistakes_are_of_open_weights_in_open_scenes(self) -> None:
        weights_of = {True: self.at / "open.safetensors", False: KIT.parent / "weights/stage1.safetensors"}
        export.export_stage1(SelecSLSNet(), {"step": 0, "images": 0, "quant": False, "open": True}, weights_of[True], None, False, True)
        closed = scenes_folder(self.at / "closed", mark=False)
        for ours, scenes in ((False, self.scenes), (True, closed)):
            with self.assertRaisesRegex(SystemExit, "open"):
                mistakes.main([str(self.at), str(self.at / "m.pt"), "--open", "--stage1", str(weights_of[ours]), "--scenes", str(scenes)])

    def test_mistakes_without_anybody_in_3d_are_refused_before_anything_is_looked_at(self) -> None:
        with self.assertRaisesRegex(SystemExit, "give --scenes"):
            mistakes.main([str(self.at), str(self.at / "m.pt"), "--stage1", str(KIT.parent / "weights/stage1.safetensors"), "--everyday", str(self.at)])

    def test_anything_else_is_refused(self) -> None:
        closed = scenes_folder(self.at / "closed", mark=False)
        for more in (
            ("--scenes", self.scenes, closed),
            (),
            ("--scenes", self.scenes, "--init", KIT.parent / "weights/stage1.safetensors"),
            ("--scenes", self.scenes, "--distil", KIT.parent / "weights/stage1.safetensors"),
        ):
            with self.assertRaisesRegex(SystemExit, "open"):
                train.main(self.arguments("--open", *more))


if __name__ == "__main__":
    unittest.main()
