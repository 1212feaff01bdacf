"""Publishers that come, go and come back are counted and followed."""

from __future__ import annotations

import logging
import threading
import time
import unittest
from unittest import mock

from runtime import InOwnFolder
from writer import END_OF_FILE, Writer, edgecap, frame


class Publishers(InOwnFolder):
    def test_a_publisher_that_comes_later_goes_and_comes_back_is_followed(self) -> None:
        stream, got = edgecap.bodies(), []
        with self.assertLogs("edgecap", logging.WARNING) as log:
            loop = threading.Thread(target=lambda: got.extend(f.sequence for f in stream))
            loop.start()
            self._until(lambda: any("nobody publishes it yet" in m for m in log.output))
            writer = Writer(self.folder)
            writer.publish(frame(1))
            self._until(lambda: got == [1])
            writer.kill()
            self._until(lambda: any("its publisher has gone" in m for m in log.output))
            writer = Writer(self.folder)
            writer.publish(frame(2))
            writer.publish(frame(3, (), edgecap.FLAG_END_OF_STREAM))
            self._until(lambda: got == [1, 2, 3])
            writer.close()
            self._until(lambda: sum("its publisher has gone" in m for m in log.output) == 2)
            writer = Writer(self.folder)
            writer.publish(frame(4))
            writer.publish(frame(5, (), END_OF_FILE))
            loop.join(30)
            writer.close()
        self.assertEqual(got, [1, 2, 3, 4, 5], "a camera that is stopped is waited for, a file ends")
        self.assertEqual(len(log.output), 6, log.output)
        self.assertTrue(log.output[1].endswith("is published"), log.output)
        for line in (3, 5):
            self.assertTrue(log.output[line].endswith("is published again"), log.output)

    def _until(self, done) -> None:
        begin = time.monotonic()
        while not done():
            self.assertLess(time.monotonic() - begin, 30)
            time.sleep(0.01)

    def test_publishers_are_counted(self) -> None:
        stream = edgecap.bodies()
        self.assertEqual(stream.publishers(), 0)
        writer = Writer(self.folder)
        self._until(lambda: stream.publishers() == 1)
        self.assertIn("published now", repr(stream))
        writer.kill()
        self._until(lambda: stream.publishers() == 0)
        self.assertIn("edgecap/v2/camera0/bodies: nobody publishes it", repr(stream))
        stream.close()
        with self.assertRaisesRegex(edgecap.EdgecapError, "closed; open another"):
            stream.next(0.01)

    def test_a_publisher_that_came_back_is_counted_before_the_messages_of_the_dead_are_read(self) -> None:
        writer = Writer(self.folder)
        with edgecap.bodies() as stream:
            writer.publish(frame(1))
            writer.publish(frame(2))
            self._until(lambda: stream.publishers() == 1)
            writer.kill()
            self._until(lambda: stream.publishers() == 0)
            writer = Writer(self.folder)
            writer.publish(frame(3))
            self._until(lambda: stream.publishers() == 1)
            self.assertEqual([stream.next(5).sequence for _ in range(3)], [1, 2, 3], "nothing is left out")
            writer.close()

    def test_a_child_that_is_forked_after_a_run_does_not_look_for_its_messages(self) -> None:
        writer = Writer(self.folder)
        with edgecap.bodies() as stream:
            writer.close()
            # As in a child that was forked.
            stream._wake._process = -1
            with mock.patch("edgecap.wake.time.sleep") as sleep:
                self.assertIsNone(stream.next(0.01))
            sleep.assert_not_called()
            self.assertTrue(stream._wake.is_of_this_process())
            # The next run is read all the same.
            writer = Writer(self.folder)
            writer.publish(frame(1))
            self.assertEqual(stream.next(30).sequence, 1)
        writer.close()

    def test_the_newest_is_of_who_publishes_and_not_of_the_dead(self) -> None:
        for asks in (False, True):
            with self.subTest(asks=asks):
                writer = Writer(self.folder)
                stream = edgecap.bodies()
                writer.publish(frame(1))
                writer.kill()
                time.sleep(1)
                self.assertEqual(stream.publishers(), 0)
                self.assertEqual(stream.newest(0).sequence, 1, "while nobody publishes it is the newest there is")
                stream.close()
                writer = Writer(self.folder)
                stream = edgecap.bodies()
                writer.publish(frame(1))
                writer.kill()
                time.sleep(1)
                self.assertEqual(stream.publishers(), 0)
                writer = Writer(self.folder)
                writer.publish(frame(2))
                if asks:
                    self._until(lambda: stream.publishers() == 1)
                else:
                    time.sleep(0.3)
                self.assertEqual(stream.newest(5).sequence, 2)
                self.assertIsNone(stream.newest(0))
                stream.close()
                writer.close()


if __name__ == "__main__":
    unittest.main()
