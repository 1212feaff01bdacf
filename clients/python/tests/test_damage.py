"""Files that somebody cut short or wrote into are survived."""

from __future__ import annotations

import os
import struct
import time
import unittest

from runtime import InOwnFolder
from writer import Writer, edgecap, frame


class Damage(InOwnFolder):
    def test_a_file_that_is_cut_short_is_no_frame(self) -> None:
        writer = Writer(self.folder)
        stream = edgecap.bodies()
        writer.publish(frame(0))
        os.truncate(writer.path, 1000)
        self.assertIsNone(stream.next(0.05))
        writer.close()

    def test_a_file_that_is_cut_short_and_whose_publisher_died_is_left(self) -> None:
        writer = Writer(self.folder)
        with edgecap.bodies() as stream:
            writer.publish(frame(0))
            os.truncate(writer.path, 1000)
            writer.kill()
            self.assertIsNone(stream.next(0.05))
            writer = Writer(self.folder)
            writer.publish(frame(1))
            self.assertEqual(stream.next(5).sequence, 1)
        writer.close()

    def test_a_count_that_nobody_wrote_is_survived_and_the_next_message_read(self) -> None:
        writer = Writer(self.folder)
        with edgecap.bodies() as stream:
            for n, count in enumerate([2**64 - 1, 2**64 - 17, 2**64 - 18, 0, 1000]):
                writer.publish(frame(10 * n))
                os.pwrite(writer.fd, struct.pack("=Q", count), 32)
                got = [stream._read() for _ in range(18)]
                self.assertLess(sum(message is not None for message in got), 17, "what was there, once")
                self.assertTrue(self._is_read(stream, writer, 10 * n + 1), count)
        writer.close()

    def _is_read(self, stream: edgecap.Stream, writer: Writer, sequence: int) -> bool:
        for n in range(1000):
            # On a busy machine signs of life may come late, and what came before them is not read.
            time.sleep(0.01 * min(n, 1))
            writer.publish(frame(sequence))
            stream._looked = 0.0
            if (message := stream.newest(0)) and message.sequence == sequence:
                return True
        return False


if __name__ == "__main__":
    unittest.main()
