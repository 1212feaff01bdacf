"""Who waits is woken by messages alone: with inotify or without it, in an event loop, in a forked child."""

from __future__ import annotations

import ctypes
import errno
import os
import re
import select
import subprocess
import sys
import threading
import time
import unittest
from unittest import mock

from runtime import CLIENT, InOwnFolder, environment
from writer import Writer, edgecap, frame

from edgecap.wake import _STEP_S, Wake


class Wakes(InOwnFolder):
    def test_a_short_wait_for_a_silent_publisher_is_short(self) -> None:
        writer, waited = Writer(self.folder), []
        # By the rule, not by the clock: a busy machine may give the processor late.
        with edgecap.bodies() as stream, mock.patch.object(Wake, "wait", lambda _, timeout_s: waited.append(timeout_s)):
            self.assertIsNone(stream.next(0.001))
        writer.close()
        self.assertGreater(len(waited), 0)
        self.assertLessEqual(max(waited), 0.001)

    @mock.patch("edgecap.stream._LOOK_EVERY_S", 3600)
    def test_a_message_wakes_who_waits_for_it(self) -> None:
        writer = Writer(self.folder)
        with edgecap.bodies() as stream:
            for n in range(10):
                thread = threading.Timer(0.01, writer.publish, (frame(n),))
                thread.start()
                begin = time.monotonic()
                self.assertEqual(stream.next(120).sequence, n)
                # Who is not woken finds it when the wait is over.
                self.assertLess(time.monotonic() - begin, 60)
                thread.join()
        writer.close()

    def test_a_user_who_has_no_inotify_left_reads_too(self) -> None:
        for refused in ["inotify_init1", "inotify_add_watch"]:
            libc = mock.Mock(wraps=ctypes.CDLL(None, use_errno=True))
            setattr(libc, refused, mock.Mock(return_value=-1))
            writer = Writer(self.folder)
            with mock.patch("ctypes.CDLL", return_value=libc), edgecap.bodies() as stream:
                self.assertIsNone(stream.next(0.01))
                thread = threading.Thread(target=writer.publish, args=(frame(3),))
                thread.start()
                self.assertEqual(stream.next(5).sequence, 3)
                thread.join()
            writer.close()

    def test_a_user_who_has_no_inotify_left_looks_often_only_where_a_file_is(self) -> None:
        libc = mock.Mock(wraps=ctypes.CDLL(None, use_errno=True))
        libc.inotify_init1 = mock.Mock(return_value=-1)
        with mock.patch("ctypes.CDLL", return_value=libc):
            wake = Wake()
        with mock.patch("edgecap.wake.time.sleep") as sleep:
            wake.wait(0.2)
            wake.watch(str(self.folder))
            wake.wait(0.2)
            self.assertFalse(wake.watches())
            wake.leave()
            wake.wait(0.2)
        self.assertEqual([call.args for call in sleep.call_args_list], [(0.2,), (_STEP_S,), (0.2,)])
        wake.close()

    def test_a_file_that_was_cut_short_wakes_nobody(self) -> None:
        writer = Writer(self.folder)
        writer.publish(frame(0))
        with edgecap.bodies() as stream:
            os.truncate(writer.path, 100)
            self.assertIsNone(stream.next(0))
            stream._wake.forget()
            os.utime(writer.path)
            with mock.patch.object(stream._wake, "forget") as woken:
                stream._wake.wait(0.001)
            woken.assert_not_called()
        writer.close()

    def test_a_descriptor_that_could_not_fire_is_refused(self) -> None:
        libc = mock.Mock(wraps=ctypes.CDLL(None, use_errno=True))
        watch = libc.inotify_add_watch

        def fails(why: int) -> mock.Mock:
            def call(*_: object) -> int:
                ctypes.set_errno(why)
                return -1

            return mock.Mock(side_effect=call)

        writer = Writer(self.folder)
        with mock.patch("ctypes.CDLL", return_value=libc):
            libc.inotify_add_watch = fails(errno.ENOSPC)
            with edgecap.bodies() as stream:
                with self.assertRaisesRegex(edgecap.EdgecapError, "no inotify watch left.*max_user_watches"):
                    stream.fileno()
                libc.inotify_add_watch = watch
                self.assertGreaterEqual(stream.fileno(), 0, "one was given back")
                writer.publish(frame(1))
                self.assertTrue(select.select([stream.fileno()], [], [], 30)[0])
            libc.inotify_add_watch = fails(errno.ENOSPC)
            with edgecap.bodies() as stream:
                libc.inotify_add_watch = watch
                stream._looked = 0.0
                stream.next(0)
                writer.publish(frame(2))
                self.assertTrue(select.select([stream._wake.fileno()], [], [], 30)[0], "it is tried at each look")
            # The file has gone in between.
            libc.inotify_add_watch = fails(errno.ENOENT)
            with edgecap.bodies() as stream:
                self.assertGreaterEqual(stream.fileno(), 0)
        writer.close()

    def test_a_forked_child_and_its_parent_are_both_woken(self) -> None:
        writer = Writer(self.folder)
        script = (
            "import edgecap, os, select\n"
            "def woken(): return bool(select.select([stream.fileno()], [], [], 30)[0])\n"
            "stream = edgecap.bodies()\n"
            "stream.next(0)\n"
            "print('open', flush=True)\n"
            "input()\n"
            "if os.fork() == 0:\n"
            "    seen = stream.next(0).sequence, stream.next(0)\n"
            "    print('child', *seen, flush=True)\n"
            "    print('child', woken(), stream.next(0).sequence, flush=True)\n"
            "    os._exit(0)\n"
            "os.wait()\n"
            "is_told = bool(select.select([stream.fileno()], [], [], 0)[0])\n"
            "print('parent', is_told, stream.next(0).sequence, flush=True)\n"
        )
        env = environment()
        pipe = subprocess.PIPE
        run = subprocess.Popen([sys.executable, "-c", script], env=env, stdin=pipe, stdout=pipe, text=True)
        assert run.stdin and run.stdout
        self.assertEqual(run.stdout.readline(), "open\n")
        writer.publish(frame(1))
        run.stdin.write("\n")
        run.stdin.flush()
        self.assertEqual(run.stdout.readline(), "child 1 None\n")
        writer.publish(frame(2))
        self.assertEqual(run.stdout.readline(), "child True 2\n")
        # What the child has read and was woken by, the parent is woken by all the same.
        self.assertEqual(run.stdout.readline(), "parent True 1\n")
        self.assertEqual(run.wait(30), 0)
        run.stdin.close()
        run.stdout.close()
        writer.close()

    def test_a_child_that_is_forked_while_another_thread_reads_goes_on(self) -> None:
        writer = Writer(self.folder)
        script = (
            "import edgecap, os, signal, threading, warnings\n"
            "warnings.simplefilter('ignore')\n"
            "stream = edgecap.bodies()\n"
            "held, forked = threading.Event(), threading.Event()\n"
            "def read():\n"
            "    with stream._lock, stream._wake._lock:\n"
            "        held.set()\n"
            "        forked.wait()\n"
            "thread = threading.Thread(target=read)\n"
            "thread.start()\n"
            "held.wait()\n"
            "child = os.fork()\n"
            "if child == 0:\n"
            "    signal.alarm(30)\n"
            "    stream.next(0)\n"
            "    stream.close()\n"
            "    os._exit(7)\n"
            "print(os.waitpid(child, 0)[1], flush=True)\n"
            "forked.set()\n"
            "thread.join()\n"
            "print(stream.next(0), flush=True)\n"
        )
        env = environment()
        run = subprocess.run([sys.executable, "-c", script], env=env, capture_output=True, text=True, timeout=60)
        self.assertEqual(run.stdout, f"{7 << 8}\nNone\n", run.stderr)
        writer.close()

    def test_a_message_makes_the_descriptor_readable_until_all_are_read(self) -> None:
        writer = Writer(self.folder)
        with edgecap.bodies() as stream:
            readable = lambda s=0.0: bool(select.select([stream.fileno()], [], [], s)[0])  # noqa: E731
            self.assertIsNone(stream.next(0))
            self.assertFalse(readable())
            for n in (1, 2):
                writer.publish(frame(n))
            self.assertTrue(readable(30))
            self.assertEqual([stream.next(0).sequence, stream.next(0).sequence], [1, 2])
            self.assertIsNone(stream.next(0))
            self.assertFalse(readable())
        writer.close()

    def test_an_event_loop_reads_as_the_page_says(self) -> None:
        page = (CLIENT / "README.md").read_text()
        [example] = re.findall(r"```python\n(import asyncio\n.+?)```", page, re.S)
        # It looks every second: who is not woken would wait for a minute.
        patient = example.replace("came.wait(), 1)", "came.wait(), 60)")
        self.assertNotEqual(patient, example)
        writer = Writer(self.folder)
        env = environment() | {"PYTHONUNBUFFERED": "1"}
        child = subprocess.Popen([sys.executable, "-c", patient], env=env, stdout=subprocess.PIPE, text=True)
        assert child.stdout
        self.addCleanup(child.stdout.close)
        # It begins with the newest frame: one is there before it comes.
        writer.publish(frame(7))
        self.assertIn("sequence=7", child.stdout.readline())
        for n in range(8, 18):
            writer.publish(frame(n))
            begin = time.monotonic()
            self.assertIn(f"sequence={n}", child.stdout.readline())
            self.assertLess(time.monotonic() - begin, 30)
        child.kill()
        child.wait()
        writer.close()


if __name__ == "__main__":
    unittest.main()
