"""Figures: of clips, for the card, of people in a picture. No data needed."""

from __future__ import annotations

import argparse
import json
import pathlib
import sys
import tempfile
import unittest
from unittest import mock

import numpy as np
import torch

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path[:0] = [str(KIT), str(KIT / "tests")]

import card
import choices
import photos
from clips import SEEDS, line, people_of, render, row, total
from crowd import PERSON
from letterbox import letterbox, to_original


class Synth:
    """Stands for the program: keeps what it has when it is stopped, as `synth` does."""

    def __init__(self) -> None:
        self.ends, self.calls = False, 0

    def __call__(self, what: str, *options: object) -> str:
        self.calls += 1
        text = "whole" if self.ends else "a part"
        out = pathlib.Path(str(options[options.index("--out") + 1]))
        out.mkdir()
        (out / "truth.json").write_text(text)
        if "--clip" in options:
            pathlib.Path(str(options[options.index("--clip") + 1])).write_text(text)
        if not self.ends:
            raise SystemExit("stopped")
        return ""


class Clips(unittest.TestCase):
    def report(self, matched: int, mpjpe: float, found: int, identity: dict | None = None) -> dict:
        pose = dict(truth=10, people=matched, mpjpe_mm=mpjpe, canonical_mpjpe_mm=mpjpe / 4, n_mpjpe_mm=mpjpe / 3, pa_mpjpe_mm=mpjpe / 2, pck150=0.5)
        return dict(pose3d=pose, finding=[{}, dict(people=8, found=found, predictions=9)], identity=identity)

    def test_everybody_counts_alike_whatever_clip_they_are_in(self) -> None:
        t = total([row(self.report(9, 50, 8)), row(self.report(3, 90, 4))])
        self.assertEqual((t["truth"], t["matched"], t["asked"], t["found"], t["reports"]), (20, 12, 16, 12, 18))
        self.assertAlmostEqual(t["mpjpe"], 60)
        self.assertAlmostEqual(t["pa"], 30)
        self.assertAlmostEqual(t["same_size"], 15)
        self.assertAlmostEqual(t["scaled"], 20)

    def test_identities_count_by_appearances(self) -> None:
        few, many = dict(idf1=0.5, truth=4, predicted=6, switches=2), dict(idf1=1.0, truth=20, predicted=20, switches=1)
        t = total([row(self.report(9, 50, 8, few)), row(self.report(9, 50, 8, many))])
        self.assertAlmostEqual(t["idf1"], 0.9)
        self.assertEqual(t["switches"], 3)
        self.assertTrue(line("all", t).endswith("| 90.0 %, 3 |"))
        self.assertTrue(line("seen", total([row(self.report(9, 50, 8))])).endswith("| – |"))

    def test_nobody_found_is_no_error(self) -> None:
        nobody = self.report(0, 0, 0) | dict(pose3d=None, coco=dict(people=7))
        both = total([row(nobody), row(self.report(5, 60, 8))])
        self.assertEqual((both["truth"], both["matched"], both["mpjpe"]), (17, 5, 60))

    def test_a_clip_that_was_broken_off_is_rendered_again(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            folder, program = pathlib.Path(d), Synth()
            with self.assertRaises(SystemExit):
                render(program, folder, SEEDS[0], 6)
            program.ends = True
            for _ in range(2):
                clip, truth = render(program, folder, SEEDS[0], 6)
                self.assertEqual((clip.read_text(), truth.read_text()), ("whole", "whole"))
            self.assertEqual(program.calls, 2)

    def test_clips_hold_two_to_six_people(self) -> None:
        self.assertEqual([people_of(s) for s in SEEDS], [2, 3, 4, 5, 6] * 2)


class Card(unittest.TestCase):
    def test_stills_that_were_broken_off_are_rendered_again(self) -> None:
        with tempfile.TemporaryDirectory() as d, mock.patch("framed.main"):
            held, program = pathlib.Path(d) / "held", Synth()
            with self.assertRaises(SystemExit):
                card.prepare(program, held, held)
            program.ends = True
            for _ in range(2):
                card.prepare(program, held, held)
            self.assertEqual((held / "stills/truth.json").read_text(), "whole")
            self.assertEqual(program.calls, 2)

    def test_a_row_says_what_was_measured_and_no_more(self) -> None:
        finding = [dict(recall=0.9, people=20, precision=0.8, mean_oks=0.7), dict(recall=0.855, people=20, precision=0.8, mean_oks=0.75)]
        pose = dict(mpjpe_mm=157.24, canonical_mpjpe_mm=150.0, n_mpjpe_mm=140.0, pa_mpjpe_mm=119.0, people=17)
        full = card.row("stills", dict(finding=finding, coco=dict(ap=0.485, ar=0.52), pck=0.762, pose3d=pose, identity=dict(idf1=0.93, switches=2)))
        self.assertEqual(
            full,
            "| stills | 85.5 (90.0) % of 20, 80.0 % right | 48.5 / 52.0, 0.75 | 76.2 % | 157.2 / 150.0 / 140.0 / 119.0 mm of 17 | IDF1 93.0 %, 2 switches |",
        )
        self.assertEqual(card.without(["--quality=best"], "--quality"), [])
        self.assertEqual(card.without(["--threads", "1", "--quality", "best", "--flip-test"], "--quality"), ["--threads", "1", "--flip-test"])
        self.assertEqual(card.row("LSP-test", dict(finding=[], pck=0.824)), "| LSP-test | – | – | 82.4 % | – |  |")
        self.assertEqual(card.row("nobody", dict(finding=[], quiet=dict(quiet=98, pictures=100))), "| nobody | quiet 98 of 100 | | | | |")

    def test_nobody_found_is_no_error(self) -> None:
        finding = [dict(recall=0.0, people=20, precision=None, mean_oks=None)] * 2
        nobody = card.row("stills", dict(finding=finding, coco=dict(ap=0.0, ar=0.0), pck=0.0))
        self.assertEqual(nobody, "| stills | 0.0 (0.0) % of 20, – % right | 0.0 / 0.0, – | 0.0 % | – |  |")

    def test_what_was_measured_is_kept_where_the_next_set_fails(self) -> None:
        two = [card.Pictures(name, name, []) for name in ("one", "two")]

        def program(what: str, *options: object) -> str:
            if what == "infer" and "two" in options:
                raise SystemExit("no pictures")
            return json.dumps(dict(finding=[], pck=0.5))

        with tempfile.TemporaryDirectory() as d, mock.patch("card.prepare"), mock.patch("card.sets", return_value=two):
            kept = pathlib.Path(d) / "kept.json"
            with mock.patch("card.Program", return_value=program), self.assertRaisesRegex(SystemExit, "no pictures"):
                card.main([d, "--data", d, "--json", str(kept)])
            self.assertEqual(list(json.loads(kept.read_text())), ["one"])

    def test_weights_are_measured_by_the_thresholds_fitted_to_them(self) -> None:
        a = argparse.Namespace(stage1="a", stage2="b", association=None, calibrate="photos", size=[160, 224])
        self.assertNotIn("--association", choices.conversion(a, [], pathlib.Path("c.ecm")))
        a.association = "open.toml"
        asked = choices.conversion(a, ["--range", "max"], pathlib.Path("c.ecm"))
        self.assertEqual(asked[asked.index("--association") + 1], "open.toml")


class Frames(unittest.TestCase):
    def test_letterbox_and_back(self) -> None:
        image = np.zeros((300, 200, 3), np.uint8)
        image[150, 100] = 255  # one bright pixel
        x, s, du, dv = letterbox(image)
        y, c = np.unravel_index(int(x[0, 0, :, :].sub(128).clamp_min(-128).where(x[0, 0] != 128, torch.tensor(-200.0)).argmax()), (320, 512))
        q = np.ones((14, 3), np.float32) * [c, y, 1]
        back = to_original([q], s, du, dv)[0]
        self.assertLess(abs(back[0, 0] - 100), 1.0)
        self.assertLess(abs(back[0, 1] - 150), 1.0)

    def test_oks(self) -> None:
        q = np.concatenate([PERSON, np.ones((14, 1), np.float32)], 1)
        k = np.concatenate([PERSON[photos.SHARED], np.full((12, 1), 2, np.float32)], 1)
        p = photos.Person(k, 150.0 * 60, np.array([0, 0, 60, 150], np.float32))
        self.assertAlmostEqual(photos.oks(q, p), 1.0, places=5)
        q[photos.SHARED[:6], 2] = 0  # arms not found
        self.assertAlmostEqual(photos.oks(q, p), 0.5, places=5)


if __name__ == "__main__":
    unittest.main()
