"""A stream may be closed by another thread, from within its own loop, and by a signal's handler."""

from __future__ import annotations

import os
import threading
import time
import unittest
from unittest import mock

from runtime import InOwnFolder
from writer import Writer, edgecap, frame

from edgecap.ring import Ring


class Closing(InOwnFolder):
    @mock.patch("edgecap.stream._SILENT_FOR_S", 3600)
    @mock.patch("edgecap.stream._LOOK_EVERY_S", 3600)
    def test_closing_in_another_thread_ends_a_loop_at_once(self) -> None:
        writer = Writer(self.folder)
        # Closed at once it may not wait yet, after a while it does.
        for pause_s in (0, 0.02, 0.2):
            stream, ended = edgecap.bodies(), []
            writer.publish(frame(1))
            began = threading.Event()

            def loop(stream=stream, ended=ended, began=began) -> None:
                try:
                    for _ in stream:
                        began.set()
                    ended.append("cleanly")
                except Exception as e:
                    ended.append(repr(e))

            thread = threading.Thread(target=loop, daemon=True)
            thread.start()
            self.assertTrue(began.wait(30))
            time.sleep(pause_s)
            stream.close()
            # Who is not woken looks in an hour.
            thread.join(30)
            self.assertEqual(ended, ["cleanly"])
        writer.close()

    def test_closing_ends_a_wait_for_a_run_and_a_loop_from_within(self) -> None:
        stream, got = edgecap.bodies(), []
        thread = threading.Thread(target=lambda: got.append(stream.next(None)))
        thread.start()
        time.sleep(0.05)
        stream.close()
        thread.join(30)
        self.assertEqual(got, [None])
        writer = Writer(self.folder)
        stream = edgecap.bodies()
        writer.publish(frame(1))
        writer.publish(frame(2))
        for message in stream:
            got.append(message.sequence)
            stream.close()
        self.assertEqual(got, [None, 1])
        for call in (stream.next, stream.newest, stream.publishers, stream.fileno, lambda: next(iter(stream))):
            with self.assertRaisesRegex(edgecap.EdgecapError, "closed; open another"):
                call()
        writer.close()

    def test_a_signals_handler_may_close_what_its_thread_reads(self) -> None:
        writer, read = Writer(self.folder), Ring.read
        opened = len(os.listdir("/proc/self/fd"))

        def closes(ring: Ring, n: int, into: edgecap.BodyFrame) -> bool:
            stream.close()
            return read(ring, n, into)

        for call in (lambda: list(stream), lambda: stream.next(5), lambda: stream.newest(5)):
            stream = edgecap.bodies()
            writer.publish(frame(1))
            with mock.patch.object(Ring, "read", closes):
                call()
            self.assertEqual(len(os.listdir("/proc/self/fd")), opened)
            with self.assertRaisesRegex(edgecap.EdgecapError, "closed; open another"):
                stream.next(0)
        writer.close()

    def test_a_signals_handler_may_close_who_begins_or_ends_a_wait(self) -> None:
        opened = len(os.listdir("/proc/self/fd"))
        stream = edgecap.bodies()

        def close() -> None:
            with stream._wake._lock:
                stream.close()

        # One that is stuck does not keep the tests from ending.
        thread = threading.Thread(target=close, daemon=True)
        thread.start()
        thread.join(30)
        self.assertFalse(thread.is_alive())
        self.assertEqual(len(os.listdir("/proc/self/fd")), opened)


if __name__ == "__main__":
    unittest.main()
