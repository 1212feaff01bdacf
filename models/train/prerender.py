"""Render synthetic scenes into a folder that training on a CPU maps: python prerender.py PACK FOLDER --n 1500 [--held].

`filled` counts the scenes written so far; training may start before the last one is there.
"""

from __future__ import annotations

import argparse
import os
import pathlib
import sys
import time

import numpy as np
import torch

from pool import FIELDS, clear
from real import load_photos
from scenes import Generator


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("pack", type=pathlib.Path)
    ap.add_argument("folder", type=pathlib.Path)
    ap.add_argument("--n", type=int, default=1500)
    ap.add_argument("--seed", type=int, default=5)
    ap.add_argument("--held", action="store_true", help="held-out motion and photos")
    ap.add_argument("--supersample", type=int, default=2)
    ap.add_argument("--threads", type=int, default=1)
    a = ap.parse_args(argv)
    torch.set_num_threads(a.threads)
    torch.manual_seed(a.seed)
    cpu = torch.device("cpu")
    gen = Generator(a.pack, cpu, load_photos(a.pack, cpu, held=a.held), a.seed, held=a.held, supersample=a.supersample, chunk=4)
    clear(a.folder)  # and not open afterwards: people stand before INRIA's photos
    files: dict[str, np.ndarray] = {}
    began = time.time()
    for at in range(0, a.n, 4):
        s = gen.render(min(4, a.n - at))
        for k in FIELDS:
            v = getattr(s, k).numpy()
            if k not in files:
                files[k] = np.lib.format.open_memmap(a.folder / f"{k}.npy", "w+", v.dtype, (a.n, *v.shape[1:]))
            files[k][at : at + len(v)] = v
        new = a.folder / "filled.new"
        new.write_text(str(at + len(s)))
        os.replace(new, a.folder / "filled")
    print(f"{a.n} scenes in {time.time() - began:.0f} s")


if __name__ == "__main__":
    main(sys.argv[1:])
