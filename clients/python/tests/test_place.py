"""The folder that is read stays the same wherever the process goes, and is none that somebody else put in its place."""

from __future__ import annotations

import os
import time
import unittest
from unittest import mock

from runtime import InOwnFolder
from writer import Writer, edgecap, frame

from edgecap import place


class Place(InOwnFolder):
    def test_a_folder_that_is_named_from_here_stays_where_it_is_when_the_process_moves(self) -> None:
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(self.folder.parent)
        writer = Writer(self.folder)
        with mock.patch.dict(os.environ, EDGECAP_RUNTIME_DIR=self.folder.name), edgecap.bodies() as stream:
            os.chdir("/")
            # On a busy machine signs of life may come late.
            for n in range(1000):
                time.sleep(0.01 * min(n, 1))
                stream._looked = 0.0
                if stream.publishers():
                    break
            else:
                self.fail("it is gone")
            writer.publish(frame(1))
            with edgecap.bodies() as late:
                self.assertEqual([stream.next(5).sequence, late.next(5).sequence], [1, 1])
        writer.close()

    def test_a_link_in_a_folder_for_everybody_is_nobodys_own_folder(self) -> None:
        own, link = self.folder / "own", self.folder / "link"
        own.mkdir(mode=0o700)
        link.symlink_to(own)
        session = {"XDG_RUNTIME_DIR": str(self.folder), "EDGECAP_RUNTIME_DIR": ""}
        for path, is_read in ((own, True), (link, False)):
            with mock.patch("edgecap.place._without_session", lambda path=path: str(path)):
                with mock.patch.dict(os.environ, session):
                    self.assertEqual(str(path) in place.reading_dirs(), is_read, path)


if __name__ == "__main__":
    unittest.main()
