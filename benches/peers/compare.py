"""Ours and other people's engines on the same networks with the same weights, in alternating turns, in one run.

Every engine has a process of its own that waits while others run. The picture is 512x320, batch 1; the peers get it as a
ready float tensor, ours as bytes. Writes results.json and the tables made from it, results.md.
"""

import argparse
import datetime
import json
import statistics
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from peers import agreement, machine, pictures, table
from peers.prepare import Job, Models, prepare
from peers.process import Worker

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
OURS = ROOT / "target/release/examples/peer_ours"
# Engines that a forced instruction set reaches: the variable that oneDNN reads, by our name for the set.
ONEDNN = {"avx2": "AVX2", "avxvnni": "AVX2_VNNI", "avx512": "AVX512_CORE", "avx512vnni": "AVX512_CORE_VNNI", "amx": "AVX512_CORE_AMX"}
# Spinning helper threads of one engine fall asleep before the next engine's turn.
SETTLE_S = 0.1


@dataclass(frozen=True)
class Entry:
    """One engine with one precision; `like` is the precision of ours that it is compared with."""

    engine: str
    precision: str
    like: str

    def command(self, m: Models, threads: int, height: int, width: int) -> list:
        if self.engine == "ours":
            model = m.ours_int8 if self.precision == "int8" else m.weights
            return [OURS, "worker", model, m.net.name, self.precision, threads, height, width]
        int8 = {"openvino": m.openvino_int8, "onnxruntime": m.onnx_int8}
        model = int8[self.engine] if self.precision == "int8" else m.ncnn if self.engine == "ncnn" else m.onnx
        return [sys.executable, HERE / "worker.py", self.engine, model, threads, self.precision, height, width]


def entries(args, facts: dict) -> list[Entry]:
    found = [Entry("ours", "int8", "int8"), Entry("ours", "f32", "f32")]
    for engine in args.engines:
        found += [Entry(engine, "int8", "int8")] if engine != "ncnn" else []
        found += [Entry(engine, "f32", "f32")]
        if engine == "openvino" and not args.isa and {"avx512_bf16", "amx_bf16"} & set(facts["isa"]):
            found.append(Entry(engine, "default", "f32"))
    return found


def say(text: str) -> None:
    print(f"[{time.strftime('%H:%M:%S')}] {text}", file=sys.stderr, flush=True)


def arguments() -> argparse.Namespace:
    a = argparse.ArgumentParser(prog="run.sh", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = lambda text: [t for t in text.split(",") if t]
    a.add_argument("--networks", type=names, default=["selecsls", "resnet50"], metavar="NAME,…")
    a.add_argument("--weights", action="append", default=[], metavar="NETWORK=FILE", help="safetensors of a network; random otherwise")
    a.add_argument("--pictures", type=Path, metavar="DIR", help="photographs for calibration and agreement; made ones otherwise")
    a.add_argument("--calibrate", type=int, default=32, metavar="N", help="pictures for calibration")
    a.add_argument("--check", type=int, default=8, metavar="N", help="other pictures, for agreement; 0 leaves it out")
    a.add_argument("--engines", type=names, default=["openvino", "onnxruntime", "ncnn"], metavar="NAME,…")
    a.add_argument("--threads", type=lambda t: [int(n) for n in names(t)], default=[1, 2], metavar="N,…")
    a.add_argument("--rounds", type=int, default=10, help="turns of every engine; 0 measures agreement only")
    a.add_argument("--runs", type=int, default=4, help="timed inferences in a turn")
    a.add_argument("--isa", choices=list(ONEDNN), help="cap the instruction set of ours and of OpenVINO; the others cannot be capped and stay out")
    a.add_argument("--prepare", action="store_true", help="make all model files, measure nothing: then measuring starts at once")
    a.add_argument("--out", type=Path, default=HERE / ".cache", metavar="DIR", help="where results.json and results.md go")
    args = a.parse_args()
    if args.isa:
        args.engines = [e for e in args.engines if e == "openvino"]
    unknown = set(args.engines) - {"openvino", "onnxruntime", "ncnn"}
    if unknown:
        a.error(f"expected engines openvino, onnxruntime, ncnn, found {', '.join(sorted(unknown))}")
    pairs = [w.split("=", 1) for w in args.weights]
    if any(len(p) != 2 or p[0] not in args.networks for p in pairs):
        a.error(f"expected --weights NETWORK=FILE for one of {', '.join(args.networks)}, found {args.weights}")
    args.weights = {n: Path(f) for n, f in pairs}
    return args


def main() -> None:
    args = arguments()
    height, width = 320, 512
    facts = machine.facts()
    if args.pictures:
        every = pictures.load(args.pictures, args.calibrate + args.check, height, width)
    else:
        every = pictures.made(7, args.calibrate + args.check, height, width)
    if len(every) <= args.check:
        raise SystemExit(f"expected more than {args.check} pictures, to check by these and to calibrate by others, found {len(every)}")
    # Alternate, so that both sets spread over the folder.
    checked_at = {i * len(every) // args.check for i in range(args.check)}
    checked = [p for i, p in enumerate(every) if i in checked_at]
    calibration = [p for i, p in enumerate(every) if i not in checked_at]
    vnni = {"avx512_vnni", "avx_vnni", "amx_int8"} & set(facts["isa"])
    environment = {"EDGECAP_ISA": args.isa, "ONEDNN_MAX_CPU_ISA": ONEDNN[args.isa]} if args.isa else {}
    results = {
        "made": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "machine": facts,
        "forced_isa": args.isa,
        "size": [width, height],
        "pictures": {"photographs": args.pictures is not None, "calibration": len(calibration), "agreement": len(checked)},
        "rounds": args.rounds,
        "runs": args.runs,
        "networks": [],
    }
    models = []
    for name in args.networks:
        job = Job(
            toml=ROOT / "models" / f"{name}.toml",
            weights=args.weights.get(name),
            calibration=np.stack(calibration),
            ours=OURS,
            requirements=HERE / "requirements.txt",
            reduce_range=not vnni,
            cache=HERE / ".cache",
        )
        models.append(prepare(job, say))
    if args.prepare:
        return
    for m in models:
        gmac = m.net.macs(height, width) / 1e9
        found = {"network": m.net.name, "trained": m.trained, "gmac": gmac, "agreement": [], "speed": []}
        results["networks"].append(found)
        chosen = entries(args, facts)
        if args.check:
            found["agreement"] = agree(m, chosen, np.stack(checked), environment)
        for threads in args.threads if args.rounds else []:
            found["speed"] += race(m, chosen, threads, (height, width), args, environment)
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / "results.json").write_text(json.dumps(results, indent=1) + "\n")
    text = table.render(results)
    (args.out / "results.md").write_text(text)
    print(text)
    say(f"written: {args.out / 'results.json'}, {args.out / 'results.md'}")
    bad = [a for n in results["networks"] for a in n["agreement"] if agreement.strays(a)]
    if bad:
        sys.exit(f"our f32 maps are not those of ONNX Runtime: {bad}")


def agree(m: Models, chosen: list[Entry], checked, environment: dict) -> list[dict]:
    """Every engine's maps beside those of ONNX Runtime in f32."""
    _, height, width, _ = checked.shape
    reference, found = None, []
    # ONNX Runtime in f32 is the reference even where it is not measured.
    with tempfile.TemporaryDirectory() as folder:
        raw, out = Path(folder, "pictures.u8"), Path(folder, "maps.f32")
        checked.tofile(raw)
        judge = Entry("onnxruntime", "f32", "f32")
        for e in [judge] + [e for e in chosen if e != judge]:
            say(f"{m.net.name}: maps of {e.engine} {e.precision}")
            with Worker(e.command(m, 1, height, width), environment) as w:
                w.maps(raw, out)
            maps = agreement.read(out, height // 8, width // 8)
            if reference is None:
                reference = maps
            found.append({"engine": e.engine, "precision": e.precision} | agreement.compare(reference, maps, m.trained))
    return found


def race(m: Models, chosen: list[Entry], threads: int, size: tuple[int, int], args, environment: dict) -> list[dict]:
    """Times of every engine, turn by turn, each round beginning with another engine."""
    say(f"{m.net.name}: {threads} threads")
    workers = []
    try:
        for e in chosen:
            workers.append(Worker(e.command(m, threads, *size), environment))
        ms: list[list[float]] = [[] for _ in chosen]
        cpu: list[list[float]] = [[] for _ in chosen]
        last: list[dict] = [{} for _ in chosen]
        for w in workers:
            w.run(2)
        for round in range(args.rounds):
            for turn in range(len(chosen)):
                i = (round + turn) % len(chosen)
                time.sleep(SETTLE_S)
                workers[i].run(1)
                last[i] = workers[i].run(args.runs)
                ms[i] += last[i]["ms"]
                cpu[i] += last[i]["cpu_ms"]
    finally:
        for w in workers:
            w.__exit__()
    medians = [statistics.median(t) for t in ms]
    ours = {e.precision: t for e, t in zip(chosen, medians) if e.engine == "ours"}
    return [
        {
            "engine": e.engine,
            "precision": e.precision,
            "threads": threads,
            "version": w.ready["version"],
            "note": w.ready["note"],
            "median_ms": median,
            "p99_ms": sorted(times)[min(len(times) - 1, int(0.99 * len(times)))],
            "cpu_ms": statistics.median(cpu_times),
            "runs": len(times),
            "ours_over_theirs": ours[e.like] / median,
            "first_ms": w.ready["first_ms"],
            "peak_mb": end["peak_mb"],
        }
        for e, w, median, times, cpu_times, end in zip(chosen, workers, medians, ms, cpu, last)
    ]


if __name__ == "__main__":
    main()
