"""Systems and two inputs, a long one and a short one, go in; processor time a frame comes out.

The processor time of a whole process (user and system), decoding included, on the long input less that on the short,
over the frames that the long one has more: what starting costs falls out, of programs in Python as of ours.
"""

import os
import statistics
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

from whole.systems import System

# Frames over which start-up, seconds in some programs and not the same each time, no longer matters.
ENOUGH = 50


@dataclass
class Input:
    """A folder of photos or a film."""

    source: Path
    frames: int


@dataclass
class Timing:
    """Of all rounds, milliseconds a frame."""

    version: str = ""
    cpu_ms: list[float] = field(default_factory=list)
    networks_ms: list[float] = field(default_factory=list)

    def median(self) -> float:
        """Of the whole program."""
        return statistics.median(self.cpu_ms)

    def networks(self) -> float | None:
        """Inside the networks, where the system says."""
        return statistics.median(self.networks_ms) if self.networks_ms else None


def pin() -> None:
    """This process and all that it starts get one processor, whatever threads they make."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def able(systems: list[System], models: Path) -> list[System]:
    """Those that can run here; the others are named aloud."""
    for s in systems:
        if why := s.lacks(models):
            print(f"SKIPPED: {s.name}: {why}", file=sys.stderr)
    return [s for s in systems if not s.lacks(models)]


def race(systems: list[System], models: Path, long: Input, short: Input, rounds: int, out: Path) -> list[Timing]:
    """Every round begins with another system; `out` keeps each one's people on the long input, `0.jsonl` and so on."""
    timings = [Timing() for _ in systems]
    more = long.frames - short.frames
    if more < ENOUGH:
        print(f"WARNING: times over {more} frames mean nothing: starting weighs more; give {ENOUGH}", file=sys.stderr)
    for turn in range(rounds):
        for k in range(len(systems)):
            i = (k + turn) % len(systems)
            print(f"[{time.strftime('%H:%M:%S')}] round {turn + 1}: {systems[i].name}", file=sys.stderr, flush=True)
            first = systems[i].run(models, short.source, out / "short.jsonl")
            whole = systems[i].run(models, long.source, out / f"{i}.jsonl")
            timings[i].version = whole.version
            timings[i].cpu_ms.append((whole.cpu_s - first.cpu_s) / max(more, 1) * 1e3)
            if whole.networks_s is not None and first.networks_s is not None:
                timings[i].networks_ms.append((whole.networks_s - first.networks_s) / max(more, 1) * 1e3)
    return timings
