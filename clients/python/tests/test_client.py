"""Streams that come, go and come back, and what messages say by name."""

from __future__ import annotations

import ctypes
import errno
import gc
import logging
import os
import pathlib
import re
import resource
import select
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
import unittest
from unittest import mock

from writer import Writer, edgecap, frame

from edgecap.ring import Ring, open_in
from edgecap.wake import Wake

CLIENT = pathlib.Path(__file__).parents[1]
REPOSITORY = CLIENT.parents[1]


END_OF_FILE = edgecap.FLAG_END_OF_STREAM | edgecap.FLAG_FILE_TIME


class InPlace(unittest.TestCase):
    """A test with a runtime folder of its own."""

    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        env = mock.patch.dict(os.environ, EDGECAP_RUNTIME_DIR=folder.name)
        env.start()
        self.addCleanup(env.stop)


class Streams(InPlace):
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

    def test_an_error_names_the_cameras_that_there_are(self) -> None:
        writer = Writer(self.folder, "door")
        self.assertEqual(edgecap.cameras(), ["door"])
        with self.assertRaisesRegex(edgecap.NoFrame, "there are bodies of door"):
            next(iter(edgecap.bodies("hall", timeout_s=0.1)))
        writer.close()

    def test_bodies_of_other_versions_are_no_camera_that_can_be_read(self) -> None:
        writers = [Writer(self.folder, "old", 1), Writer(self.folder, "door"), Writer(self.folder, "new", 22)]
        self.assertEqual(edgecap.cameras(), ["door"])
        for writer in writers:
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
        env = os.environ | {"PYTHONPATH": str(CLIENT)}
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
        env = os.environ | {"PYTHONPATH": str(CLIENT)}
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
        env = os.environ | {"PYTHONPATH": str(CLIENT), "PYTHONUNBUFFERED": "1"}
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

    def test_the_group_that_may_read_is_the_files(self) -> None:
        writer = Writer(self.folder)
        user, group = os.geteuid(), self.folder.stat().st_gid + 1
        look, opens = os.lstat, os.open

        def seen(path: str) -> os.stat_result:
            found = look(path)
            return os.stat_result([*found[:5], group, *found[6:]]) if str(path) == str(writer.path) else found

        def hidden(path: str) -> os.stat_result:
            if str(path) == str(writer.path):
                raise PermissionError
            return look(path)

        def refused(path: str, *more: int) -> int:
            if str(path) == str(writer.path):
                raise PermissionError
            return opens(path, *more)

        expected = f"a member of group {group}, found user {user};"
        with mock.patch("os.open", refused):
            with mock.patch("os.lstat", seen), self.assertRaisesRegex(edgecap.AccessError, expected):
                edgecap.bodies()
            # Where the file may not be looked at, the folder's.
            with mock.patch("os.lstat", hidden), self.assertRaisesRegex(edgecap.AccessError, f"group {group - 1},"):
                edgecap.bodies()
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

    def test_a_reader_returns_to_the_folder_that_comes_first(self) -> None:
        own, service = self.folder / "own", self.folder / "service"
        for folder in (own, service):
            folder.mkdir(mode=0o700)
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
        own, service = self.folder / "own", self.folder / "service"
        for folder in (own, service):
            folder.mkdir(mode=0o700)
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

    def _two(self) -> list[Writer]:
        """Publishers in two folders, in none of which a reader looks."""
        folders = [self.folder / "own", self.folder / "service"]
        for folder in folders:
            folder.mkdir(mode=0o700)
        return [Writer(folder) for folder in folders]

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

    def test_what_is_no_file_is_refused_and_leaves_nothing_open(self) -> None:
        path = self.folder / "camera0.bodies.v2"
        for make, remove in [(path.mkdir, path.rmdir), (lambda: os.mkfifo(path), path.unlink)]:
            make()
            opened = len(os.listdir("/proc/self/fd"))
            for _ in range(3):
                with self.assertRaisesRegex(edgecap.AccessError, "bodies.v2: expected a file of user"):
                    edgecap.bodies()
            gc.collect()
            self.assertEqual(len(os.listdir("/proc/self/fd")), opened)
            remove()

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

    def test_a_pipe_in_the_place_of_another_version_is_not_waited_for(self) -> None:
        os.mkfifo(self.folder / "camera0.bodies.v3")
        script = "import edgecap\nprint(edgecap.bodies().next(0))"
        env = os.environ | {"PYTHONPATH": str(CLIENT)}
        run = subprocess.run([sys.executable, "-c", script], env=env, capture_output=True, text=True, timeout=30)
        self.assertEqual(run.stdout, "None\n", run.stderr)

    def test_a_file_that_others_may_write_is_refused(self) -> None:
        writer = Writer(self.folder)
        writer.path.chmod(0o622)
        with self.assertRaisesRegex(edgecap.AccessError, "bodies.v2: expected a file of user"):
            edgecap.bodies()
        writer.close()

    def test_a_folder_that_others_may_write_is_refused(self) -> None:
        self.folder.chmod(0o777)
        with self.assertRaisesRegex(edgecap.AccessError, "chmod 700"):
            edgecap.bodies()

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

    def test_the_module_prints_a_line_a_frame(self) -> None:
        writer = Writer(self.folder)
        run = [sys.executable, "-m", "edgecap"]
        child = subprocess.Popen(run, env=os.environ | {"PYTHONPATH": str(CLIENT)}, stdout=subprocess.PIPE, text=True)
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
        env = os.environ | {"PYTHONPATH": str(CLIENT)}
        for words, code in [(["--help"], 0), (["-h"], 0), (["--camera", "hall"], 2), (["-x"], 2), (["a", "b"], 2)]:
            run = [sys.executable, "-m", "edgecap", *words]
            done = subprocess.run(run, env=env, capture_output=True, text=True, timeout=30)
            self.assertEqual(done.returncode, code, words)
            self.assertIn("usage: python3 -m edgecap [CAMERA]", done.stderr if code else done.stdout)


class Messages(unittest.TestCase):
    def test_fields_by_name(self) -> None:
        body = frame(2, (3, 9)).people()[1]
        self.assertEqual(body.joint("r_elbow"), (9.0, 3.0, 2.0))
        self.assertEqual(body.joint2d("r_elbow"), (3.0, 9.0))
        self.assertEqual(body.joint_state("r_elbow"), "predicted")
        self.assertEqual(body.joint_states[:3], ("predicted", "occluded", "observed"))
        self.assertEqual(body.joint_confidence("l_foot_tip"), 20 / 32)
        self.assertEqual(body.bone_length("r_shoulder"), 2 / 64)
        self.assertEqual(body.bone_rotation("rightLowerArm"), (5.0, 0.0, 0.0, 1.0))
        self.assertEqual(body.angle("r_elbow_flexion"), 14 / 16)
        self.assertEqual(body.named_angles()["l_ankle_flexion"], 28 / 16)
        self.assertEqual(len(body.named_angles()), edgecap.DOF)

    def test_a_name_that_is_none_is_told_with_the_nearest(self) -> None:
        body = frame(0).people()[0]
        for what, call in [
            ("joint 'r_wirst': there is none of that name; did you mean 'r_wrist'?", lambda: body.joint("r_wirst")),
            ("did you mean 'r_knee_flexion'?", lambda: body.angle("r_knee_flex")),
            ("did you mean 'leftHand'?", lambda: body.bone_rotation("LeftHand")),
            ("expected one of head_top, neck", lambda: body.joint_state("?")),
            ("expected 1 to 64 of", lambda: edgecap.bodies("a/b")),
        ]:
            with self.assertRaises(edgecap.UnknownName) as failed:
                call()
            self.assertIn(what, str(failed.exception))

    def test_unknown_codes_are_the_first_and_counts_are_held_to_what_there_is(self) -> None:
        made = frame(0)
        made._bodies[0]._state, made._bodies[0]._joint_states[0], made.world._state = 9, 200, 77
        made.count = 1000
        body = made.people()[0]
        self.assertEqual((body.state, body.joint_state("head_top"), made.world.state), ("tentative", "predicted", "none"))
        self.assertEqual(len(made.people()), edgecap.MAX_PEOPLE)

    def test_what_is_printed_tells_what_it_is(self) -> None:
        made = frame(12, (3, 9))
        made.world._state, made.world.translation[1], made.world.rotation[3] = 1, 1.5, 1
        self.assertEqual(repr(made.people()[0]), "Body(id=3, tracked, score=0.88, pelvis at (0.50, -0.25, 3.00) m, height 1.75 m)")
        self.assertEqual(
            repr(made), "BodyFrame(sequence=12, #3, #9, 1280x720, World(estimated, camera 1.50 m above the floor))"
        )
        self.assertEqual(repr(made.in_world(made.people()[0])), "WorldBody(pelvis at (0.50, 1.25, 3.00) m)")
        made.world.translation[1] = 0
        self.assertEqual(repr(made.world), "World(estimated)", "a room of several cameras has no one camera")
        self.assertEqual(repr(frame(1, ())), "BodyFrame(sequence=1, nobody, 1280x720, World(no floor is known))")

    def test_names_are_those_of_the_skeleton(self) -> None:
        skeleton = tomllib.loads((REPOSITORY / "models/skeleton.toml").read_text())
        self.assertEqual(edgecap.ANGLE_NAMES[6:], tuple(d["name"] for d in skeleton["dof"]))
        parents = {b["joint"]: b["parent"] for b in skeleton["bone"]} | {"pelvis": "pelvis"}
        names = edgecap.JOINT_NAMES
        self.assertEqual({n: names[p] for n, p in zip(names, edgecap.PARENTS)}, parents)
        carried = dict(zip(edgecap.HUMANOID_BONES, (edgecap.HUMANOID_BONES[p] for p in edgecap.HUMANOID_PARENTS)))
        self.assertEqual((carried["rightUpperArm"], carried["leftFoot"]), ("spine", "leftLowerLeg"))

    def test_the_version_is_that_of_the_program(self) -> None:
        cargo = (REPOSITORY / "Cargo.toml").read_text()
        self.assertEqual(edgecap.__version__, re.search(r'^version = "(.+)"', cargo, re.M)[1])


if __name__ == "__main__":
    unittest.main()
