"""The package is typed throughout, and so are programs that use it."""

from __future__ import annotations

import os
import pathlib
import tempfile
import unittest

from mypy import api

CLIENT = pathlib.Path(__file__).parents[1]
USER = """
import edgecap

def wrists(camera: str) -> list[tuple[float, float, float]]:
    with edgecap.bodies(camera, timeout_s=5) as stream:
        frame = stream.newest(timeout_s=None)
        return [body.joint("r_wrist") for body in frame.people()] if frame else []

def zones(camera: str) -> list[tuple[str, int | None, str | None]]:
    return [(e.event, e.person, e.zone) for frame in edgecap.events(camera) for e in frame.events()]

def is_away(camera: str) -> bool:
    health: edgecap.HealthFrame | None = edgecap.health(camera).newest(3)
    return health is not None and health.state == "away" and health.restarts == 0

reveal_type([frame for frame in edgecap.bodies()])
"""


class Types(unittest.TestCase):
    def test_strictly(self) -> None:
        config = ["--config-file", str(CLIENT / "pyproject.toml")]
        with tempfile.TemporaryDirectory() as folder, self.subTest("package"):
            os.environ["MYPYPATH"] = str(CLIENT)
            cache = ["--cache-dir", folder]
            said, failed, code = api.run([*config, *cache, "--strict", "-p", "edgecap"])
            self.assertEqual(code, 0, said + failed)
            program = pathlib.Path(folder) / "program.py"
            program.write_text(USER)
            said, failed, code = api.run([*cache, "--strict", str(program)])
            self.assertEqual(code, 0, said + failed)
            self.assertIn('Revealed type is "list[edgecap.message.BodyFrame]"', said.replace("builtins.", ""))


if __name__ == "__main__":
    unittest.main()
