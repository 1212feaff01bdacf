"""The engines' race: what it refuses, and what it does where an engine cannot be installed."""

import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

import numpy as np

HERE = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HERE))

from peers import agreement, table  # noqa: E402
from whole import systems  # noqa: E402


class Agreement(unittest.TestCase):
    """Our maps against ONNX Runtime's."""

    def test_maps_that_are_no_numbers_stray_like_those_that_are_far_off(self):
        ours = {"engine": "ours", "precision": "f32"}
        self.assertFalse(agreement.strays(ours | {"relative_max": 1e-4}))
        for off in (2e-3, float("inf"), float("nan")):
            self.assertTrue(agreement.strays(ours | {"relative_max": off}), off)
        self.assertFalse(agreement.strays({"engine": "ncnn", "precision": "f32", "relative_max": 1.0}))

    def test_an_engine_that_loses_every_peak_is_told_so(self):
        reference = np.zeros((1, 5, 5, agreement.CHANNELS), np.float32)
        reference[0, 2, 2, 0] = 0.9
        reference[..., agreement.HEAD2D :] = 0.1
        found = agreement.compare(reference, np.zeros_like(reference), True)
        self.assertEqual((found["peaks"], found["peaks_lost"]), (1, 1))
        self.assertIn("| – | 1 of 1 |", self.row(found, True))
        whole = agreement.compare(reference, reference, True)
        self.assertIn("| 0.00 (0.00) | 0 of 1 |", self.row(whole, True))
        random = agreement.compare(reference, reference, False)
        self.assertIn("| – | – |", self.row(random, False))

    def row(self, found: dict, trained: bool) -> str:
        one = {"network": "selecsls", "trained": trained, "gmac": 8.0, "agreement": [found | {"engine": "ours", "precision": "int8"}], "speed": []}
        facts = {"cpu": "a", "family": "1", "model": "2", "cores": 2, "isa": ["avx2"], "governor": None}
        pictures = {"calibration": 1, "photographs": True, "agreement": 1}
        results = {"networks": [one], "machine": facts, "size": [512, 320], "pictures": pictures, "made": "", "forced_isa": None}
        return table.render(results | {"rounds": 1, "runs": 1})


class Table(unittest.TestCase):
    """What the tables say of the machine."""

    def said(self, threads: list[int], cpu_ms: float = 10.0, **machine: object) -> str:
        one = {"engine": "ours", "precision": "f32", "version": "1", "note": "avx2", "median_ms": 10.0, "cpu_ms": cpu_ms, "peak_mb": 1.0}
        network = {"network": "selecsls", "trained": True, "gmac": 8.0, "agreement": [], "speed": [one | {"threads": t} for t in threads]}
        facts = {"cpu": "a", "family": "1", "model": "2", "cores": 2, "isa": ["avx2"], "governor": None} | machine
        pictures = {"calibration": 1, "photographs": True, "agreement": 0}
        results = {"networks": [network], "machine": facts, "size": [512, 320], "pictures": pictures}
        return table.render(results | {"rounds": 1, "runs": 1, "made": "", "forced_isa": None})

    def test_a_busy_machine_is_told_with_any_number_of_threads(self):
        busy, unknown = "Other programs were running", "not known"
        self.assertIn(busy, self.said([1, 2], cpu_ms=5.0, load=0.0))
        self.assertNotIn(busy, self.said([1, 2], load=2.0), "one thread had all of its core")
        self.assertIn(busy, self.said([2], load=1.0))
        quiet = self.said([2], load=0.1)
        self.assertTrue(busy not in quiet and unknown not in quiet)
        self.assertIn(unknown, self.said([2]))


class Whole(unittest.TestCase):
    """whole.sh, where pip cannot install MediaPipe; everything else that it calls is made up here."""

    def test_what_cannot_be_installed_is_skipped_aloud_every_time(self):
        with tempfile.TemporaryDirectory() as place:
            peers = pathlib.Path(place) / "benches/peers"
            peers.mkdir(parents=True)
            for name in ("whole.sh", "requirements.txt", "requirements-mediapipe.txt"):
                shutil.copy(HERE / name, peers)
            tools = pathlib.Path(place) / "tools"
            tools.mkdir()
            # The environment comes after `-m venv`; its pip and python are programs of this test.
            made = 'mkdir -p "$3/bin"; for p in pip python; do cp "$(dirname "$0")/$p" "$3/bin"; done'
            for name, text in {
                "venv": made,
                "pip": 'case "$*" in *mediapipe*) exit 1 ;; esac',
                "python": ":",
                "cargo": ":",
            }.items():
                (tools / name).write_text(f"#!/bin/sh\n{text}\n")
                (tools / name).chmod(0o755)
            environment = os.environ | {"PYTHON": str(tools / "venv"), "PATH": f"{tools}:{os.environ['PATH']}"}
            for _ in range(2):
                done = subprocess.run(["sh", peers / "whole.sh"], env=environment, capture_output=True, text=True)
                self.assertEqual(done.returncode, 0, done.stderr)
                self.assertIn("SKIPPED: MediaPipe", done.stderr)
                self.assertTrue((peers / ".venv/.complete").exists())
                self.assertFalse((peers / ".venv-mediapipe/.complete").exists())

    def test_what_is_half_installed_is_lacking(self):
        with tempfile.TemporaryDirectory() as place:
            folder = pathlib.Path(place)
            (folder / "bin").mkdir()
            (folder / "bin/python").touch()
            before, systems.MEDIAPIPE = systems.MEDIAPIPE, folder
            self.addCleanup(setattr, systems, "MEDIAPIPE", before)
            pose = systems.System("MediaPipe", "", program="mediapipe one")
            self.assertIn("not installed", pose.lacks(folder))
            (folder / ".complete").touch()
            self.assertEqual(pose.lacks(folder), "")


if __name__ == "__main__":
    unittest.main()
