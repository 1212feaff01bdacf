"""`python3 -m edgecap`: a line a frame, and how it is called."""

from __future__ import annotations

import subprocess
import sys
import unittest

from runtime import InOwnFolder, environment
from writer import END_OF_FILE, Writer, frame


class Module(InOwnFolder):
    def test_the_module_prints_a_line_a_frame(self) -> None:
        writer = Writer(self.folder)
        run = [sys.executable, "-m", "edgecap"]
        child = subprocess.Popen(run, env=environment(), stdout=subprocess.PIPE, text=True)
        assert child.stdout
        # It begins with the newest frame: one is there before it comes.
        writer.publish(frame(7))
        line = child.stdout.readline()
        writer.publish(frame(8, (), END_OF_FILE))
        self.assertEqual(child.wait(30), 0)
        child.stdout.close()
        writer.close()
        self.assertIn("7 Body(id=3, tracked, score=0.88", line)

    def test_the_module_says_how_it_is_called(self) -> None:
        env = environment()
        for words, code in [(["--help"], 0), (["-h"], 0), (["--camera", "hall"], 2), (["-x"], 2), (["a", "b"], 2)]:
            run = [sys.executable, "-m", "edgecap", *words]
            done = subprocess.run(run, env=env, capture_output=True, text=True, timeout=30)
            self.assertEqual(done.returncode, code, words)
            self.assertIn("usage: python3 -m edgecap [CAMERA]", done.stderr if code else done.stdout)


if __name__ == "__main__":
    unittest.main()
