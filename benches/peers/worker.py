"""One engine, one model, one thread count in a process of its own. Speaks the protocol of `ours.rs`, one JSON per line:

    <- {"ready": {...}}                            once, after loading and a first inference
    -> {"run": 5}              <- {"ms": [...], "cpu_ms": [...], "peak_mb": x}    five timed inferences
    -> {"maps": IN, "to": OUT} <- {"maps": n}      IN: pictures, bytes [n, height, width, 3]; OUT: f32 [n, rows, columns, 40 + 63]
"""

import json
import sys
import time
from pathlib import Path

import numpy as np

from peers import pictures
from peers.engines import ENGINES


def peak_mb() -> float | None:
    """Peak resident memory; `resource` would count what the parent had before it became us."""
    status = Path("/proc/self/status").read_text()
    return next((int(l.split()[1]) / 1024 for l in status.splitlines() if l.startswith("VmHWM:")), None)


def main() -> None:
    engine, model, threads, precision, height, width = sys.argv[1:7]
    height, width = int(height), int(width)
    say = lambda **kv: print(json.dumps(kv), file=channel, flush=True)
    channel, sys.stdout = sys.stdout, sys.stderr
    start = time.perf_counter()
    e = ENGINES[engine](Path(model), int(threads), precision)
    e.feed(pictures.planes(pictures.made(0, 1, height, width))[0])
    e.run()
    say(ready={"version": e.version, "note": e.note, "first_ms": (time.perf_counter() - start) * 1e3})
    for line in sys.stdin:
        ask = json.loads(line)
        if "run" in ask:
            ms, cpu_ms = [], []
            for _ in range(ask["run"]):
                wall, cpu = time.perf_counter_ns(), time.process_time_ns()
                e.run()
                ms.append((time.perf_counter_ns() - wall) / 1e6)
                cpu_ms.append((time.process_time_ns() - cpu) / 1e6)
            say(ms=ms, cpu_ms=cpu_ms, peak_mb=peak_mb())
        else:
            raw = np.fromfile(ask["maps"], np.uint8).reshape(-1, height, width, 3)
            with open(ask["to"], "wb") as f:
                for p in pictures.planes(raw):
                    e.feed(p)
                    e.run()
                    stacked = np.concatenate(e.maps()).transpose(1, 2, 0)
                    f.write(np.ascontiguousarray(stacked, "<f4").tobytes())
            say(maps=len(raw))


main()
