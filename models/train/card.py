"""What the program measures for the model card, in one call: python card.py HELD --data DATA [--model M.ecm] [options of `edgecap infer`, such as --flip-test].

HELD keeps the held-out pictures: rendered stills and clips, LSP-test in frames; what is in it is not made again, so every model sees the same. One row a
set, and with `--json` everything that `eval` said. Two calls side by side compare two models: `--model OTHER.ecm`, or float weights with `--stage2`.
"""

from __future__ import annotations

import argparse
import json
import pathlib
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass

import clips
import framed
from choices import Program, folder_of
from real import PEOPLED, held_out

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
TALL = (150, 200, 270)
DEMO = "demo clip"  # as any file, its lens not known
STILLS_SEED = 990017  # pictures that no training has seen


@dataclass
class Pictures:
    """One set: what `infer` reads, how, and what `eval` holds it against."""

    name: str
    pictures: object
    truth: list[object]
    options: tuple[object, ...] = ()


def prepare(program: Program, held: pathlib.Path, data: pathlib.Path) -> None:
    """Renders and frames whatever is missing."""
    held.mkdir(parents=True, exist_ok=True)
    if not (held / "stills").exists():
        stills = clips.unfinished(held) / "stills"
        program("synth", "--stills", "--frames", 120, "--people", 5, "--seed", STILLS_SEED, "--out", stills)
        stills.rename(held / "stills")
    people = str(data / "people2d")
    frames = {f"tall{t}": ["--tall", str(t)] for t in TALL} | {f"cut_{c}": ["--cut", c] for c in framed.CUTS}
    for name, how in frames.items():
        if not (held / name / "annotations.json").exists():
            framed.main([people, str(held / name), *how])


def without(options: list[str], name: str) -> list[str]:
    """`options` without the one of this name and its value, `NAME VALUE` or `NAME=VALUE`: sets of one size cannot have
    it."""
    kept, rest = [], iter(options)
    for option in rest:
        if option == name:
            next(rest, None)
        elif not option.startswith(f"{name}="):
            kept.append(option)
    return kept


def sets(held: pathlib.Path, data: pathlib.Path, work: pathlib.Path) -> Iterator[Pictures]:
    demo = REPOSITORY / "models/demo"
    yield Pictures(DEMO, demo / "demo.avi", ["--truth", demo / "truth.json"])
    yield Pictures("stills", held / "stills", ["--truth", held / "stills/truth.json"])
    labels = sorted((data / "photos").glob("*/annotations.json"))
    photos = folder_of(work, "photos", [p for s in labels for p in s.parent.glob("*.jpg")])
    yield Pictures("photos", photos, ["--truth", *labels])
    for size in ("448x288", "384x240"):
        yield Pictures(f"photos at {size}", photos, ["--truth", *labels], ("--size", size))
    test = ["--split", "test"]
    for folder in sorted(held.glob("*/annotations.json")):
        yield Pictures(f"LSP-test, {folder.parent.name}", folder.parent / "lsp", ["--truth", folder, *test])
    people = data / "people2d/annotations.json"
    rows = [r for r in json.loads(people.read_text()) if r["split"] == "test"]
    lsp = folder_of(work, "lsp", [data / "people2d" / r["file"] for r in rows])
    yield Pictures("LSP-test, 256x256", lsp, ["--truth", people, *test], ("--size", "256x256"))
    yield Pictures("four photos", data / "real3d", ["--truth", data / "real3d/annotations.json"])
    nobody = folder_of(work, "nobody", [p for p in sorted((data / "no_people").glob("*.jpg")) if held_out(p.name) and p.name not in PEOPLED])
    yield Pictures("without people", nobody, ["--no-people"])


def percent(x: float | None) -> str:
    return "–" if x is None else f"{100 * x:.1f}"


def millimetres(x: float | None) -> str:
    return "–" if x is None else f"{x:.1f}"


def similarity(x: float | None) -> str:
    return "–" if x is None else f"{x:.2f}"


def row(name: str, report: dict) -> str:
    """`report` as `eval --json` writes it."""
    if quiet := report.get("quiet"):
        return f"| {name} | quiet {quiet['quiet']} of {quiet['pictures']} | | | | |"
    finding = report["finding"]
    found = f"{percent(finding[1]['recall'])} ({percent(finding[0]['recall'])}) % of {finding[1]['people']}, {percent(finding[1]['precision'])} % right" if finding else "–"
    coco = report.get("coco")
    oks = f"{percent(coco['ap'])} / {percent(coco['ar'])}, {similarity(finding[1]['mean_oks'])}" if coco else "–"
    pose = report.get("pose3d")
    depth = f"{pose['mpjpe_mm']:.1f} / {millimetres(pose['canonical_mpjpe_mm'])} / {pose['n_mpjpe_mm']:.1f} / {pose['pa_mpjpe_mm']:.1f} mm of {pose['people']}" if pose else "–"
    identity = report.get("identity")
    who = f"IDF1 {percent(identity['idf1'])} %, {identity['switches']} switches" if identity else ""
    return f"| {name} | {found} | {oks} | {percent(report.get('pck'))} % | {depth} | {who} |"


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("held", type=pathlib.Path)
    ap.add_argument("--data", type=pathlib.Path, required=True)
    ap.add_argument("--edgecap", type=pathlib.Path, default=REPOSITORY / "target/release/edgecap")
    ap.add_argument("--threads", type=int, default=2)
    ap.add_argument("--only", nargs="*", default=[""], help="sets whose names begin so")
    ap.add_argument("--clips", action="store_true", help="the ten clips of clips.py, too, which are rendered the first time")
    ap.add_argument("--json", type=pathlib.Path, help="everything measured")
    a, options = ap.parse_known_args(argv)
    program = Program(a.edgecap, a.threads)
    prepare(program, a.held, a.data)
    everything: dict[str, dict] = {}
    print("| pictures | found at OKS ≥ 0.5 (≥ 0.3) | AP / AR, mean OKS | PCK@0.2 | MPJPE / at 1.70 m / N-MPJPE / PA-MPJPE | who |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as d:
        work = pathlib.Path(d)
        for s in sets(a.held, a.data, work):
            if not s.name.startswith(tuple(a.only)):
                continue
            lines = work / "people.jsonl"
            chosen = options if not s.options else without(options, "--quality")
            program("infer", "--input", s.pictures, "--threads", a.threads, "--jsonl", lines, *s.options, *chosen)
            everything[s.name] = json.loads(program("eval", "--predictions", lines, *s.truth, "--json", "-"))
            print(row(s.name, everything[s.name]), flush=True)
            if s.name == DEMO:
                fitted = work / "fitted.jsonl"
                program("fit", "--input", lines, "--jsonl", fitted)
                name = f"{s.name}, after the fit"
                everything[name] = json.loads(program("eval", "--predictions", fitted, *s.truth, "--json", "-"))
                print(row(name, everything[name]), flush=True)
            if a.json:  # after every set: the next one may take an hour, or fail
                a.json.write_text(json.dumps(everything))
    if a.clips:
        clips.main(["--keep", str(a.held / "clips"), "--edgecap", str(a.edgecap), "--threads", str(a.threads), *options])


if __name__ == "__main__":
    main(sys.argv[1:])
