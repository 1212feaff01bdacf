"""One engine, one model, one thread count in a process of its own. Speaks the protocol of `ours.rs`, one JSON per line:

    <- {"ready": {...}}                            once, after loading and a first inference
    -> {"run": 5}              <- {"ms": [...]}    five timed inferences
    -> {"maps": IN, "to": OUT} <- {"maps": n}      IN: pictures, bytes [n, height, width, 3]; OUT: f32 [n, rows, columns, 40 + 63]
"""

import json
import resource
import sys
import time
from pathlib import Path

import numpy as np

from peers import pictures
from peers.engines import ENGINES


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
            ms = []
            for _ in range(ask["run"]):
                t = time.perf_counter_ns()
                e.run()
                ms.append((time.perf_counter_ns() - t) / 1e6)
            say(ms=ms, peak_mb=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
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
