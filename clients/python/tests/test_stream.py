"""What a stream gives and waits for, and what it says of a camera that is silent or not there."""

from __future__ import annotations

import logging
import os
import resource
import time
import unittest
from unittest import mock

from runtime import InOwnFolder
from writer import Writer, edgecap, frame


class Streams(InOwnFolder):
    def test_frames_come_oldest_first_and_newest_leaves_older_ones_out(self) -> None:
        writer = Writer(self.folder)
        with edgecap.bodies() as stream:
            for n in range(5):
                writer.publish(frame(n))
            self.assertEqual([stream.next(0).sequence for _ in range(2)], [0, 1])
            self.assertEqual(stream.newest(0).sequence, 4)
            self.assertIsNone(stream.next(0))
            self.assertIsNone(stream.newest(0.05))
            for n in range(40):
                writer.publish(frame(n))
            # Seventeen slots, one of which is being written.
            self.assertEqual(stream.next(0).sequence, 24)
        writer.close()

    def test_waits_no_longer_than_it_was_told(self) -> None:
        stream = edgecap.bodies()
        begin = time.monotonic()
        self.assertIsNone(stream.next(0.1))
        self.assertGreaterEqual(time.monotonic() - begin, 0.1)
        with self.assertRaises(edgecap.NoFrame) as failed:
            next(iter(edgecap.bodies("hall", timeout_s=0.1)))
        said = str(failed.exception)
        self.assertIn("within 0.1 s", said)
        self.assertIn("edgecap run --name hall", said)
        self.assertIsInstance(failed.exception, TimeoutError)

    def test_an_error_names_the_cameras_that_there_are(self) -> None:
        writer = Writer(self.folder, "door")
        self.assertEqual(edgecap.cameras(), ["door"])
        with self.assertRaisesRegex(edgecap.NoFrame, "there are bodies of door"):
            next(iter(edgecap.bodies("hall", timeout_s=0.1)))
        writer.close()

    def test_a_program_with_thousands_of_open_files_reads_too(self) -> None:
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        if hard < 1200:
            self.skipTest(f"this user may open {hard} files")
        resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 1200), hard))
        self.addCleanup(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))
        null = os.open(os.devnull, os.O_RDONLY)
        opened = [null]
        self.addCleanup(lambda: [os.close(fd) for fd in opened])
        while opened[-1] < 1100:
            opened.append(os.dup(null))
        writer = Writer(self.folder)
        with edgecap.bodies() as stream:
            self.assertIsNone(stream.next(0.01))
            writer.publish(frame(3))
            self.assertEqual(stream.next(5).sequence, 3)
        writer.close()

    def test_who_waits_is_told_of_other_cameras(self) -> None:
        writer = Writer(self.folder, "door")
        with self.assertLogs("edgecap", logging.WARNING) as log, self.assertRaises(edgecap.NoFrame):
            next(iter(edgecap.bodies("hall", timeout_s=1.1)))
        self.assertTrue(log.output[0].endswith("--name hall`; there are bodies of door"), log.output)
        writer.close()

    def test_a_publisher_that_is_silent_is_not_to_be_started(self) -> None:
        writer = Writer(self.folder)
        with self.assertRaises(edgecap.NoFrame) as failed:
            next(iter(edgecap.bodies(timeout_s=0.1)))
        writer.close()
        self.assertIn("it is published, but no frame came within 0.1 s", str(failed.exception))
        self.assertNotIn("start", str(failed.exception))

    def test_a_run_is_searched_for_seldom_once_the_wait_is_long(self) -> None:
        stream, searched = edgecap.bodies(), []
        with mock.patch("edgecap.stream.open_in", lambda *_: searched.append(time.monotonic())):
            # By the rule, not by the clock: a busy machine searches seldom anyway.
            with mock.patch("edgecap.stream._SEARCH_EAGERLY_S", 3600.0):
                self.assertEqual(stream._every(), 0.02)
            with mock.patch("edgecap.stream._SEARCH_EAGERLY_S", 0.0):
                self.assertEqual(stream._every(), 0.2)
                stream.next(1.0)
        self.assertLess(len(searched), 10)
        writer = Writer(self.folder)
        writer.publish(frame(1))
        self.assertEqual(stream.next(5).sequence, 1)
        stream.close()
        writer.close()

    def test_nobody_who_was_seen_long_ago_is_shown_to_a_new_reader(self) -> None:
        now = time.monotonic_ns()
        long_ago = max(1, now - 10_000_000_000)
        # Nothing takes so long that it is stale.
        in_an_hour = now + 3600 * 10**9
        for published, flags, is_shown in [
            (long_ago, 0, False),
            (in_an_hour, 0, True),
            (0, 0, True),
            (long_ago, edgecap.FLAG_END_OF_STREAM, True),
        ]:
            with self.subTest(published=published, flags=flags):
                writer, seen = Writer(self.folder), frame(1, (), flags)
                seen.publish_ns = published
                writer.publish(seen)
                with edgecap.bodies() as stream:
                    self.assertEqual(stream.next(0) is not None, is_shown)
                    writer.publish(frame(2))
                    self.assertEqual(stream.next(5).sequence, 2)
                writer.close()


if __name__ == "__main__":
    unittest.main()
