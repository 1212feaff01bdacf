"""Calls of gpu.sh, with nothing but a log behind them. No data, no PyTorch and no GPU needed."""

from __future__ import annotations

import os
import pathlib
import subprocess
import tempfile
import time
import unittest

KIT = pathlib.Path(__file__).resolve().parent.parent
# Stands for Python: writes down what it is asked to run; training goes on until it is ended.
PYTHON = """#!/bin/bash
echo "$(basename "$1") $(basename "$2") $*" >>"$RUN_LOG"
case $* in *--finish* | *--steps*) ;; *train.py*) trap 'exit 0' TERM; for _ in {1..300}; do sleep 0.1; done ;; esac
"""


class Calls(unittest.TestCase):
    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.at = pathlib.Path(folder.name)
        self.there = self.at / "run"
        (self.at / "python3").write_text(PYTHON)
        (self.at / "python3").chmod(0o755)
        self.log = self.at / "log"
        self.environment = os.environ | dict(PATH=f"{self.at}:{os.environ['PATH']}", RUN_LOG=str(self.log))
        self.there.mkdir()
        (self.there / "end").write_text(str(int(time.time()) + 600))

    def call(self, *what: object) -> None:
        subprocess.run(["bash", str(KIT / "gpu.sh"), *map(str, what)], env=self.environment, check=True, timeout=30)

    def take(self, *parts: int) -> None:
        for k in parts:
            (self.at / f"part{k}").mkdir()
            self.call("take", self.there, self.at / f"part{k}")

    def lines(self, count: int) -> list[str]:
        """What was run, once there are so many."""
        until = time.monotonic() + 20
        while time.monotonic() < until:
            found = self.log.read_text().splitlines() if self.log.exists() else []
            if len(found) >= count:
                return found
            time.sleep(0.05)
        raise AssertionError(f"expected {count} calls, found {found}")

    def ended(self) -> str:
        until = time.monotonic() + 20
        while not (self.there / "ended").exists() and time.monotonic() < until:
            time.sleep(0.05)
        return (self.there / "ended").read_text().strip()

    def test_training_begins_on_two_parts_and_goes_on_with_all(self) -> None:
        self.take(0)
        self.call("train", self.there, 3, "--muon")
        time.sleep(1.5)
        self.assertFalse(self.log.exists(), "it began on one part")
        self.take(1)
        unpacked, some = self.lines(2)
        self.assertRegex(unpacked, "^carry.py unpack .*/some$")
        self.assertRegex(some, "^train.py pack .*/some/pack .* --muon$")
        time.sleep(1.5)
        self.assertEqual(len(self.lines(2)), 2, "it went on without the last part")
        self.take(2)
        *_, unpacked, all_ = self.lines(4)
        self.assertRegex(unpacked, "^carry.py unpack .*/all$")
        self.assertRegex(all_, "^train.py pack .*/all/pack .* --finish --muon --resume$")
        self.assertEqual(self.ended(), "0")

    def test_where_all_parts_are_there_it_begins_with_them(self) -> None:
        self.take(0, 1, 2)
        self.call("train", self.there, 3, "--muon")
        unpacked, only = self.lines(2)
        self.assertRegex(unpacked, "^carry.py unpack .*/all$")
        self.assertRegex(only, "^train.py pack .*/all/pack .* --finish --muon$")
        self.assertEqual(self.ended(), "0")
        self.assertEqual(len(self.lines(2)), 2)

    def test_a_schedule_of_steps_is_not_bent_to_the_time(self) -> None:
        self.take(0)
        self.call("train", self.there, 1, "--steps", 900)
        self.assertRegex(self.lines(2)[1], "^train.py pack .*/all/pack .* --steps 900$")
        self.assertNotIn("--finish", self.lines(2)[1])
        self.assertEqual(self.ended(), "0")

    def test_what_failed_early_says_why(self) -> None:
        (self.there / "train.log").write_text("no such option\n")
        (self.there / "ended").write_text("2\n")
        call = ["bash", str(KIT / "gpu.sh"), "watch", str(self.there), str(self.at / "back")]
        r = subprocess.run(call, env=self.environment, check=False, timeout=30, capture_output=True, text=True)
        self.assertEqual((r.returncode, r.stdout), (2, "no such option\n"))
        self.assertTrue((self.at / "back/train.log").exists())
        (self.there / "ended").write_text("0\n")
        r = subprocess.run(call, env=self.environment, check=False, timeout=30, capture_output=True, text=True)
        self.assertEqual(r.returncode, 1, "nothing came back, and that was called right")


if __name__ == "__main__":
    unittest.main()
