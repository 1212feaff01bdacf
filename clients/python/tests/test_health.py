"""What is said of a camera is read, and found to be missing."""

from __future__ import annotations

import time
import unittest
from collections.abc import Callable

from runtime import InOwnFolder
from writer import END_OF_FILE, Writer, edgecap


def told(state: str, ago_s: float = 0.0, **fields: float) -> edgecap.HealthFrame:
    """A message of so long ago, in whose state the camera had been for a minute."""
    now = time.monotonic_ns() - int(ago_s * 1e9)
    code = edgecap.HEALTH_STATES.index(state)
    return edgecap.HealthFrame(publish_ns=now, since_ns=now - 60 * 10**9, _state=code, **fields)


class Health(InOwnFolder):
    def writer(self) -> Writer:
        return Writer(self.folder, "camera0", 1, "health", edgecap.HealthFrame)

    def test_fields_by_name(self) -> None:
        health = told("live", source_hz=30, observed_hz=14.96, look_hz=7.5, latency_us=41_800, _pace=2, people=1)
        self.assertEqual((health.state, health.pace, health.look_hz), ("live", "behind", 7.5))
        self.assertAlmostEqual(health.state_seconds, 60.0)
        self.assertEqual(str(health), "live for 60 s, 15.0 of 30.0 pictures a second (behind), 42 ms, 1 person")
        self.assertEqual(repr(told("away")), "HealthFrame(away for 60 s)")
        later = edgecap.HealthFrame(_state=77, _pace=77)
        self.assertEqual((later.state, later.pace), ("unknown", "unknown"), "of a later version")

    def test_states_are_read_until_a_film_ends(self) -> None:
        writer = self.writer()
        with edgecap.health() as stream:
            for state, flags in [("starting", 0), ("live", 0), ("away", 0), ("live", 0), ("ended", END_OF_FILE)]:
                writer.publish(told(state, flags=flags))
            self.assertEqual([h.state for h in stream], ["starting", "live", "away", "live", "ended"])
        writer.close()

    def test_what_was_so_a_while_ago_is_told_to_nobody_who_comes(self) -> None:
        writer = self.writer()
        writer.publish(told("live", ago_s=10))
        with edgecap.health() as stream:
            self.assertIsNone(stream.newest(0), "it hangs")
            self.until(lambda: stream.publishers() == 1)
            writer.publish(told("idle"))
            self.assertEqual(stream.newest(5).state, "idle")
            writer.kill()
            self.until(lambda: stream.publishers() == 0)
            self.assertIsNone(stream.newest(0))

    def until(self, done: Callable[[], bool]) -> None:
        begin = time.monotonic()
        while not done():
            self.assertLess(time.monotonic() - begin, 30)
            time.sleep(0.01)


if __name__ == "__main__":
    unittest.main()
