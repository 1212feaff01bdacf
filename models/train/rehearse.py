"""Every step of the recipe once, at toy size, on a CPU: python rehearse.py PACK [WORK].  Under two minutes on two free cores.

Trains some tens of steps in two processes, interrupts, resumes, fine-tunes with int8 rounding, trains Stage II, measures, exports, and
measures the exported file again: the figures must agree.  What it makes is worth nothing; that it can be made is the point.
"""

from __future__ import annotations

import argparse
import json
import math
import pathlib
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
DEMO = HERE.parent / "demo/truth.json"  # of `edgecap synth`
SHIPPED = HERE.parent / "weights/stage1.safetensors"


def call(script: str, *args: object) -> str:
    t = time.time()
    r = subprocess.run([sys.executable, str(HERE / script), *map(str, args)], capture_output=True, text=True, check=False)
    print(f"{script:12} {time.time() - t:5.1f} s", flush=True)
    if r.returncode:
        raise SystemExit(f"{script} {args} ended with {r.returncode}:\n{r.stdout}\n{r.stderr}")
    return r.stdout


def main(pack: pathlib.Path, work: pathlib.Path) -> None:
    run, held = work / "run", work / "held"
    print(call("check.py", pack), end="")
    call("prerender.py", pack, work / "scenes", "--n", 8, "--supersample", 1)
    call("prerender.py", pack, held, "--n", 8, "--supersample", 1, "--held", "--seed", 99)
    tiny = ("--cpu", "--tiny", "--ranks", 2, "--sync", 2, "--cache", work / "cache", "--scenes", work / "scenes", "--minutes", 10)
    common = (pack, run, *tiny)
    call("train.py", *common, "--steps", 20)
    call("train.py", *common, "--steps", 30, "--resume", "--muon")
    rows = [json.loads(x) for x in (run / "log.jsonl").read_text().splitlines()]
    assert [r["step"] for r in rows] == list(range(5, 31, 5)), "expected a resumed run to go on where the first one stopped"
    assert all(math.isfinite(r[k]) for r in rows for k in ("hm_real", "hm_syn", "enc", "where")), rows
    assert rows[-1]["enc"] < rows[0]["enc"], "expected the encodings' loss to fall"
    call("composites.py", pack, work / "composites", "--n", 2, "--tiny")
    call("stage2.py", pack, run, "--cpu", "--steps", 60, "--minutes", 1, "--log", 30, "--test", 256, "--batch", 128, "--posed", DEMO)
    measure = ("--scenes", held, "--limit", 8, "--only", "lsp", "scenes", "--thr", 0.01, "--paf", 0.0, "--joints", 3, "--cpu")
    first = json.loads(call("evaluate.py", pack, run, *measure))
    call("export.py", run, "--pack", pack, "--f32")
    files = ("--stage1", run / "stage1.safetensors", "--stage2", run / "stage2.safetensors")
    again = json.loads(call("evaluate.py", pack, work / "again", *files, *measure))
    for k in ("lsp_test", "scenes"):
        assert first[k] == again[k], f"expected the exported weights to measure alike, found {first[k]} and {again[k]}"
    taught = work / "taught"
    call("train.py", pack, taught, *tiny, "--steps", 20, "--init", run / "stage1.safetensors", "--distil", SHIPPED, run / "stage1.safetensors")
    asked = [json.loads(x)["taught"] for x in (taught / "log.jsonl").read_text().splitlines()]
    assert 0 < asked[-1] < asked[0], f"expected the distance from the teachers to fall, found {asked}"
    call("train.py", *common, "--steps", 36, "--resume", "--muon", "--quant-last", 1.0)
    call("export.py", run, "--only", "stage1")
    print("rehearsed")


if __name__ == "__main__":
    ap = argparse.ArgumentParser(description=__doc__)
    ap.add_argument("pack", type=pathlib.Path)
    ap.add_argument("work", type=pathlib.Path, nargs="?", help="folder to keep; one that is deleted afterwards when not given")
    a = ap.parse_args()
    if a.work:
        main(a.pack, a.work)
    else:
        with tempfile.TemporaryDirectory() as d:
            main(a.pack, pathlib.Path(d))
