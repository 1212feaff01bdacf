"""How the system does on ten clips that no training has seen: python clips.py [--keep FOLDER] [--fps 6] [options of `edgecap infer`, such as --flip-test].

Renders them (`edgecap synth`, ten seconds each, two to six people who walk, wave, squat and hide each other: the same scenes at every rate), runs `infer`
and `fit` on each as on any film, and prints what `eval` says before and after the fit; in sum every person found counts alike.
"""

from __future__ import annotations

import argparse
import json
import pathlib
import shutil
import sys
import tempfile

from choices import Program

SEEDS = range(501, 511)
SECONDS = 10


def people_of(seed: int) -> int:
    return 2 + (seed - SEEDS[0]) % 5


def unfinished(folder: pathlib.Path) -> pathlib.Path:
    """An empty place in `folder` for what gets its name once it is whole: a `synth` that is stopped keeps what there is."""
    place = folder / "unfinished"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    return place


def render(program: Program, folder: pathlib.Path, seed: int, fps: int) -> tuple[pathlib.Path, pathlib.Path]:
    """The clip and its truth; those of an earlier call are taken as they are."""
    clip, truth = folder / f"{seed}.avi", folder / str(seed)
    if not clip.exists():
        of = ["--frames", SECONDS * fps, "--fps", fps, "--people", people_of(seed), "--seed", seed, "--quality", 40]
        place = unfinished(folder)
        program("synth", *of, "--out", place / truth.name, "--clip", place / clip.name)
        shutil.rmtree(truth, ignore_errors=True)
        (place / truth.name).rename(truth)
        (place / clip.name).rename(clip)  # last: it says that both are there
    return clip, truth / "truth.json"


def row(report: dict) -> dict:
    found = report["finding"][1]
    pose = report.get("pose3d") or dict(truth=report["coco"]["people"], people=0, mpjpe_mm=0.0, canonical_mpjpe_mm=0.0, n_mpjpe_mm=0.0, pa_mpjpe_mm=0.0, pck150=0.0)
    who = report.get("identity") or dict(idf1=0.0, truth=0, predicted=0, switches=0)
    return dict(
        truth=pose["truth"],
        matched=pose["people"],
        mpjpe=pose["mpjpe_mm"],
        same_size=pose["canonical_mpjpe_mm"],
        scaled=pose["n_mpjpe_mm"],
        pa=pose["pa_mpjpe_mm"],
        pck=pose["pck150"],
        asked=found["people"],
        found=found["found"],
        reports=found["predictions"],
        switches=who["switches"],
        appearances=who["truth"] + who["predicted"],
        idf1=who["idf1"],
    )


def total(rows: list[dict]) -> dict:
    """Counts add up; errors are means over everybody who was matched, IDF1 over everybody true or reported."""
    counts = {k: sum(r[k] for r in rows) for k in ("truth", "matched", "asked", "found", "reports", "switches", "appearances")}

    def mean(key: str, over: str) -> float:
        return sum(r[over] * r[key] for r in rows) / max(counts[over], 1)

    return counts | {k: mean(k, "matched") for k in ("mpjpe", "same_size", "scaled", "pa", "pck")} | dict(idf1=mean("idf1", "appearances"))


def line(name: str, r: dict) -> str:
    share = f"{r['matched']} of {r['truth']} ({100 * r['matched'] / max(r['truth'], 1):.1f} %)"
    found = f"{100 * r['found'] / max(r['asked'], 1):.1f} %, {100 * r['found'] / max(r['reports'], 1):.1f} % right"
    who = f"{100 * r['idf1']:.1f} %, {r['switches']}" if r["appearances"] else "–"
    return f"| {name} | {share} | {found} | {r['mpjpe']:.1f} / {r['same_size']:.1f} / {r['scaled']:.1f} / {r['pa']:.1f} mm | {100 * r['pck']:.1f} % | {who} |"


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--edgecap", type=pathlib.Path, default=pathlib.Path(__file__).resolve().parents[2] / "target/release/edgecap")
    ap.add_argument("--keep", type=pathlib.Path, help="folder for the clips; those in it are not rendered again")
    ap.add_argument("--fps", type=int, default=6, help="frames a second; a folder of --keep holds clips of one rate")
    ap.add_argument("--threads", type=int, default=2)
    a, options = ap.parse_known_args(argv)
    program = Program(a.edgecap, a.threads)
    sums: dict[str, list[dict]] = {"before the fit": [], "after the fit": []}
    print("| clip | people with 3D | found at OKS ≥ 0.5 | MPJPE / at 1.70 m / N-MPJPE / PA-MPJPE | 3DPCK@150 | IDF1, switches |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as d:
        work = pathlib.Path(d)
        clips = a.keep or work
        clips.mkdir(parents=True, exist_ok=True)
        for seed in SEEDS:
            clip, truth = render(program, clips, seed, a.fps)
            seen, fitted = work / "seen.jsonl", work / "fitted.jsonl"
            program("infer", "--input", clip, "--jsonl", seen, "--threads", a.threads, *options)
            program("fit", "--input", seen, "--jsonl", fitted)
            for (name, rows), file in zip(sums.items(), (seen, fitted)):
                rows.append(row(json.loads(program("eval", "--predictions", file, "--truth", truth, "--json", "-"))))
                print(line(f"{seed}, {people_of(seed)} people, {name}", rows[-1]), flush=True)
    for name, rows in sums.items():
        print(line(f"all, {name}", total(rows)))


if __name__ == "__main__":
    main(sys.argv[1:])
