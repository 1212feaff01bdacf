"""Messages of other versions are refused, and only these."""

from __future__ import annotations

import os
import subprocess
import sys
import unittest
from unittest import mock

from runtime import InOwnFolder, environment
from writer import Writer, edgecap, frame


class Versions(InOwnFolder):
    def test_bodies_of_other_versions_are_no_camera_that_can_be_read(self) -> None:
        writers = [Writer(self.folder, "old", 1), Writer(self.folder, "door"), Writer(self.folder, "new", 22)]
        self.assertEqual(edgecap.cameras(), ["door"])
        for writer in writers:
            writer.close()

    def test_messages_of_another_version_are_refused(self) -> None:
        writer = Writer(self.folder, version=3)
        with self.assertRaisesRegex(edgecap.VersionError, "expected messages of version 2, found version 3; use"):
            edgecap.bodies()
        writer.close()

    def test_who_comes_just_after_the_look_is_of_no_other_version(self) -> None:
        writers, listed = [], os.listdir

        def comes(folder: str) -> list[str]:
            writers.append(Writer(self.folder))
            return listed(folder)

        with mock.patch("os.listdir", comes):
            stream = edgecap.bodies()
        [writer] = writers
        writer.publish(frame(1))
        self.assertEqual(stream.next(5).sequence, 1)
        stream.close()
        writer.close()

    def test_who_has_read_once_is_told_of_messages_of_another_version_too(self) -> None:
        writer = Writer(self.folder)
        stream = edgecap.bodies()
        writer.publish(frame(0))
        self.assertEqual(stream.next(5).sequence, 0)
        writer.close()
        newer = Writer(self.folder, version=3)
        with self.assertRaisesRegex(edgecap.VersionError, "expected messages of version 2, found version 3"):
            stream.next(5)
        newer.close()
        # It reads on where the right ones come back.
        writer = Writer(self.folder)
        writer.publish(frame(1))
        self.assertEqual(stream.next(5).sequence, 1)
        writer.close()

    def test_a_pipe_in_the_place_of_another_version_is_not_waited_for(self) -> None:
        os.mkfifo(self.folder / "camera0.bodies.v3")
        script = "import edgecap\nprint(edgecap.bodies().next(0))"
        env = environment()
        run = subprocess.run([sys.executable, "-c", script], env=env, capture_output=True, text=True, timeout=30)
        self.assertEqual(run.stdout, "None\n", run.stderr)


if __name__ == "__main__":
    unittest.main()
