"""What int8 costs, per way of choosing ranges: python choices.py STAGE1 STAGE2 --calibrate PHOTOS --data DATA [--scenes FOLDER].

Runs the program itself on the same pictures with float weights and with every calibration, and prints a table: PCK@0.2 of the torso on
LSP-test, COCO's AP and AR on the labelled photos and on stills of `edgecap synth` (FOLDER with truth.json), and photos without people
in which nobody is reported.
"""

from __future__ import annotations

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

from real import PEOPLED, held_out

CHOICES = {
    "max, a range per channel": ["--range", "max", "--own-ranges", "1"],
    "max, halfway": ["--range", "max", "--own-ranges", "0.5"],
    "max, one range per layer": ["--range", "max", "--own-ranges", "0"],
    "percentile 99.99, per channel": ["--range", "percentile:0.9999", "--own-ranges", "1"],
    "mean square error, per channel": ["--range", "mse", "--own-ranges", "1"],
    "max, per channel, biases as they are": ["--range", "max", "--own-ranges", "1", "--no-bias-correction"],
}


class Program:
    def __init__(self, path: pathlib.Path, threads: int):
        self.path, self.threads = path, str(threads)

    def __call__(self, *args: object) -> str:
        r = subprocess.run([str(self.path), *map(str, args)], capture_output=True, text=True, check=False)
        if r.returncode:
            raise SystemExit(f"{self.path} {' '.join(map(str, args))} ended with {r.returncode}:\n{r.stderr}")
        return r.stdout

    def measure(self, model: list[object], pictures: pathlib.Path, size: str, work: pathlib.Path, *truth: object) -> dict:
        lines = work / "people.jsonl"
        self("infer", "--input", pictures, "--size", size, "--threads", self.threads, "--jsonl", lines, *model)
        return json.loads(self("eval", "--predictions", lines, *truth, "--json", "-"))


def folder_of(work: pathlib.Path, name: str, files: list[pathlib.Path]) -> pathlib.Path:
    folder = work / name
    folder.mkdir()
    for f in files:
        (folder / f.name).symlink_to(f.resolve())
    return folder


def conversion(a: argparse.Namespace, options: list[str], file: pathlib.Path) -> list[object]:
    """Arguments of the program that make the model `file` of the weights, ranges chosen by `options`."""
    fitted = ("--association", a.association) if a.association else ()
    size = ("--width", a.size[0], "--height", a.size[1])
    return ["model", "import", a.stage1, "--stage2", a.stage2, *fitted, "--calibrate", a.calibrate, *size, *options, "-o", file]


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("stage1", type=pathlib.Path)
    ap.add_argument("stage2", type=pathlib.Path)
    ap.add_argument("--calibrate", type=pathlib.Path, required=True, help="photos to find ranges with")
    ap.add_argument("--data", type=pathlib.Path, required=True)
    ap.add_argument("--scenes", type=pathlib.Path, help="stills of `edgecap synth`, never trained on")
    ap.add_argument("--edgecap", type=pathlib.Path, default=pathlib.Path(__file__).resolve().parents[2] / "target/release/edgecap")
    ap.add_argument("--association", type=pathlib.Path, help="toml with the thresholds fitted to these weights; models/association.toml holds the default's")
    ap.add_argument("--size", nargs=2, type=int, default=[160, 224], help="width and height that ranges are found at")
    ap.add_argument("--limit", type=int, default=0, help="pictures of LSP-test (0: all)")
    ap.add_argument("--threads", type=int, default=1)
    ap.add_argument("--only", nargs="*", help="some of the choices, by name")
    a = ap.parse_args(argv)
    program = Program(a.edgecap, a.threads)
    labels = a.data / "people2d/annotations.json"
    with tempfile.TemporaryDirectory() as d:
        work = pathlib.Path(d)
        rows = [r for r in json.loads(labels.read_text()) if r["split"] == "test"]
        rows = rows[: a.limit or None]
        test = folder_of(work, "lsp", [a.data / "people2d" / r["file"] for r in rows])
        some = work / "some.json"
        some.write_text(json.dumps(rows))
        sets = sorted((a.data / "photos").glob("*/annotations.json"))
        photos = folder_of(work, "photos", [p for s in sets for p in s.parent.glob("*.jpg")])
        nobody = folder_of(work, "nobody", [p for p in sorted((a.data / "no_people").glob("*.jpg")) if held_out(p.name) and p.name not in PEOPLED])
        print(f"| ranges | LSP-test PCK, {len(rows)} | photos AP / AR | found at OKS ≥ 0.5 | stills AP / AR | quiet of {len(list(nobody.iterdir()))} |")
        print("|---|---|---|---|---|---|")
        for name, options in {"f32": None, **CHOICES}.items():
            if a.only and name not in a.only:
                continue
            if options is None and a.association:
                name += ", thresholds of the default"  # only a model file carries others
            if options is None:
                model: list[object] = ["--model", a.stage1, "--stage2", a.stage2]
            else:
                file = work / "choice.ecm"
                program(*conversion(a, options, file))
                model = ["--model", file]
            lsp = program.measure(model, test, "256x256", work, "--truth", some, "--split", "test")
            several = program.measure(model, photos, "512x320", work, "--truth", *sets)
            row = [f"{100 * lsp['pck']:.1f}", average(several), f"{100 * several['finding'][1]['recall']:.0f} %"]
            row.append(average(program.measure(model, a.scenes, "512x320", work, "--truth", a.scenes / "truth.json")) if a.scenes else "–")
            quiet = program.measure(model, nobody, "512x320", work, "--no-people")["quiet"]
            row.append(f"{100 * quiet['quiet'] / quiet['pictures']:.0f} %")
            print(f"| {name} | " + " | ".join(row) + " |", flush=True)


def average(report: dict) -> str:
    return f"{100 * report['coco']['ap']:.1f} / {100 * report['coco']['ar']:.1f}"


if __name__ == "__main__":
    main(sys.argv[1:])
