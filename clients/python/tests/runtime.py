"""What tests of streams run in: a runtime folder of their own, and for programs beside them this client."""

from __future__ import annotations

import os
import pathlib
import tempfile
import unittest
from unittest import mock

CLIENT = pathlib.Path(__file__).parents[1]


def environment() -> dict[str, str]:
    """Of a program that finds the client, and the folder of the test that starts it."""
    return os.environ | {"PYTHONPATH": str(CLIENT)}


class InOwnFolder(unittest.TestCase):
    """A test with a runtime folder of its own."""

    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        env = mock.patch.dict(os.environ, EDGECAP_RUNTIME_DIR=folder.name)
        env.start()
        self.addCleanup(env.stop)
