"""Files and folders that are refused: who may read them, who else may write, what is no file."""

from __future__ import annotations

import gc
import os
import unittest
from unittest import mock

from runtime import InOwnFolder
from writer import Writer, edgecap


class Access(InOwnFolder):
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


if __name__ == "__main__":
    unittest.main()
