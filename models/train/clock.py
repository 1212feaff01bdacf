"""Seconds in which a run worked: one that is stopped for a night (`kill -STOP`, a laptop asleep) finds its schedule where
it was."""

from __future__ import annotations

import statistics
import time
from collections import deque

LONGEST = 10.0  # steps as long as the median one: a longer gap is a pause, of which no more counts
# Seconds that a single step may take whatever the others do: algorithms are chosen, a network is compiled, a checkpoint
# is written.
ALLOWED = 120.0
REMEMBERED = 101  # steps that the median is of


class Clock:
    """Begins where it is made; `seconds` have counted since."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._last = time.monotonic()
        self._steps: deque[float] = deque(maxlen=REMEMBERED)

    def _gap(self) -> float:
        now = time.monotonic()
        gap, self._last = now - self._last, now
        return gap

    def whole(self) -> float:
        """Counts all since the last call, where steps have not begun and nothing tells how long is too long."""
        self.seconds += self._gap()
        return self.seconds

    def step(self) -> float:
        """Counts the step since the last call, of a pause only so much as a step may take."""
        gap = self._gap()
        usual = statistics.median(self._steps) if self._steps else 0.0
        self._steps.append(gap)
        self.seconds += min(gap, max(LONGEST * usual, ALLOWED))
        return self.seconds
