"""Several runtime folders: which one is read, and what is said of one that is closed to this user."""

from __future__ import annotations

import logging
import os
import pathlib
import time
import unittest
from unittest import mock

from runtime import InOwnFolder
from writer import Writer, edgecap, frame

from edgecap.ring import open_in


class Folders(InOwnFolder):
    def test_a_folder_of_a_service_that_is_closed_is_said_while_nobody_publishes(self) -> None:
        service, own = self.folder / "service", self.folder / "own"
        service.mkdir()
        own.mkdir()
        access, may_not = os.access, []
        closed = mock.patch("os.access", lambda path, mode: str(path) not in may_not and access(path, mode))
        session = {"XDG_RUNTIME_DIR": str(own), "EDGECAP_RUNTIME_DIR": ""}

        def said(camera: str = "test-kept-out") -> tuple[str, str]:
            with self.assertLogs("edgecap", logging.WARNING) as log, self.assertRaises(edgecap.NoFrame) as failed:
                next(iter(edgecap.bodies(camera, timeout_s=1.1)))
            return log.output[0], str(failed.exception)

        with mock.patch("edgecap.place.SERVICE_DIR", str(service)), mock.patch.dict(os.environ, session), closed:
            with mock.patch("edgecap.place.runtime_dir", lambda: str(own)):
                service.chmod(0o750)
                for text in said():
                    self.assertNotIn("closed", text)
                may_not.append(str(service))
                for text in said():
                    self.assertRegex(text, r"service is closed to this user: add this user to the group \S+ \(sudo")
                service.chmod(0o700)
                for text in said():
                    self.assertIn(f"only user {os.geteuid()} may read there", text)
                self.assertNotIn(str(service), edgecap.reading_dirs())

    def test_a_reader_returns_to_the_folder_that_comes_first(self) -> None:
        own, service = self._folders()
        writers = [Writer(service)]
        writers[0].publish(frame(1))
        with mock.patch("edgecap.stream.reading_dirs", lambda: [str(own), str(service)]), edgecap.bodies() as stream:
            self.assertEqual(stream.next(5).sequence, 1)
            writers.append(Writer(own))
            writers[1].publish(frame(2))
            # On a busy machine signs of life may come late.
            is_alive = mock.patch("edgecap.ring.Ring.is_published", lambda _: True)
            with mock.patch("edgecap.stream._RETURN_EVERY_S", 3600.0), is_alive:
                stream._looked = 0.0
                self.assertIsNone(stream.next(0), "it has looked there lately")
            stream._looked_before -= 1.0
            stream._looked = 0.0
            self.assertEqual(stream.next(5).sequence, 2)
            self.assertIsNone(stream.next(0))
        for writer in writers:
            writer.close()

    def test_a_reader_that_always_has_a_message_returns_to_the_folder_that_comes_first(self) -> None:
        own, service = self._folders()
        writers = [Writer(service)]
        with mock.patch("edgecap.stream.reading_dirs", lambda: [str(own), str(service)]), edgecap.bodies() as stream:
            writers.append(Writer(own))
            # On a busy machine signs of life may come late.
            for n in range(1000):
                time.sleep(0.01 * min(n, 1))
                writers[0].publish(frame(n))
                stream._looked, stream._looked_before = 0.0, stream._looked_before - 1.0
                stream.next(0)
                if stream._ring.folder == str(own):
                    break
            else:
                self.fail("it stays where it is")
            writers[1].publish(frame(1000))
            self.assertEqual(stream.next(5).sequence, 1000)
        for writer in writers:
            writer.close()

    def _go_over(self, stream: edgecap.Stream, writer: Writer) -> None:
        """Has the stream read what `writer` publishes."""
        ring = open_in(str(writer.path.parent), stream._kind)
        assert ring
        # On a busy machine signs of life may come late.
        ring.was_alive = True
        stream._follow(ring, first=False)
        self.assertIs(stream._ring, ring)

    def _unread(self, stream: edgecap.Stream) -> list[int]:
        return [message.sequence for message in iter(stream._read, None)]

    def _folders(self) -> list[pathlib.Path]:
        """Of two runtimes, the one that comes first before the other."""
        folders = [self.folder / "own", self.folder / "service"]
        for folder in folders:
            folder.mkdir(mode=0o700)
        return folders

    def _two(self) -> list[Writer]:
        """Publishers in two folders, in none of which a reader looks."""
        return [Writer(folder) for folder in self._folders()]


    def test_who_goes_over_to_another_folder_and_returns_reads_nothing_twice(self) -> None:
        own, service = self._two()
        with edgecap.bodies() as stream:
            self._go_over(stream, own)
            own.publish(frame(1))
            service.publish(frame(11))
            self.assertEqual(self._unread(stream), [1])
            self._go_over(stream, service)
            self.assertEqual(self._unread(stream), [11])
            own.publish(frame(2))
            self._go_over(stream, own)
            self.assertEqual(self._unread(stream), [2])
            self._go_over(stream, service)
            self.assertEqual(self._unread(stream), [])
            for n in range(40):
                own.publish(frame(n))
            self._go_over(stream, own)
            self.assertEqual(self._unread(stream), list(range(24, 40)))
        for writer in (own, service):
            writer.close()

    def test_nobody_who_was_seen_long_ago_is_shown_to_who_goes_over_to_another_folder(self) -> None:
        own, service = self._two()

        def seen_long_ago(n: int) -> edgecap.BodyFrame:
            made = frame(n)
            made.publish_ns = max(1, time.monotonic_ns() - 10_000_000_000)
            return made

        with edgecap.bodies() as stream:
            self._go_over(stream, own)
            service.publish(seen_long_ago(11))
            self._go_over(stream, service)
            self.assertEqual(self._unread(stream), [])
            service.publish(frame(12))
            self.assertEqual(self._unread(stream), [12])
            # Left before it was read.
            service.publish(seen_long_ago(13))
            self._go_over(stream, own)
            self._go_over(stream, service)
            self.assertEqual(self._unread(stream), [])
        for writer in (own, service):
            writer.close()

    def test_a_link_in_one_folder_does_not_hide_the_next(self) -> None:
        first, second = self.folder / "first", self.folder / "second"
        for folder in (first, second):
            folder.mkdir(mode=0o700)
        (first / "camera0.bodies.v2").symlink_to("nowhere")
        writer = Writer(second)
        writer.publish(frame(1))
        with mock.patch("edgecap.stream.reading_dirs", lambda: [str(first), str(second)]), edgecap.bodies() as stream:
            self.assertEqual(stream.next(5).sequence, 1)
        writer.close()


if __name__ == "__main__":
    unittest.main()
