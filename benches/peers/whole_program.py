"""Whole programs for people in pictures on the same photos or film: processor time a frame, and what it buys.

    whole_program.py photos --photos FOLDER --labels FILE      time and accuracy
    whole_program.py film --long FILM --short FILM             time a frame; two films that differ in length alone
"""

import argparse
import sys
import tempfile
from pathlib import Path

import cv2

from peers import machine
from whole import labels, measure, reports, score, systems, tfjs

# Where program.py looks for what is made out of the peers' files.
MADE = Path(__file__).resolve().parent / ".cache"
# Photos of each shape (wide, upright, square) in the short run.
OF_SHAPE = 2
# Ours unless --ours names others.
OURS = {
    "photos": ["best", "balanced", "fast", "256x160"],
    "film": ["default", "default/portable", "15-looks", "fast", "best"],
}


def main() -> None:
    args = arguments()
    entries = measure.able(systems.ours(args.ours or OURS[args.what]) + systems.PEERS, args.models)
    MADE.mkdir(exist_ok=True)
    if any(e.program == "movenet" for e in entries):
        tfjs.convert(args.models / "movenet-multipose.json", MADE / "movenet-multipose.pb")
    measure.pin()
    with tempfile.TemporaryDirectory() as folder:
        rows = (photos if args.what == "photos" else film)(args, entries, Path(folder))
    print("\n".join("| " + " | ".join(row) + " |" for row in rows))
    facts = machine.facts()
    print(
        f"\n{facts['cpu']} (family {facts['family']}, model {facts['model']}), one thread on one processor,"
        f" {' '.join(facts['isa'])}; medians of {args.rounds} rounds in alternating order; load {facts['load']:.1f}."
    )


def arguments() -> argparse.Namespace:
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--models", type=Path, default=MADE / "whole", help="the peers' files: README.md")
    common.add_argument("--rounds", type=int, default=3)
    common.add_argument("--ours", nargs="+", help="rows of ours: default, a quality, N-looks or WxH; with /portable or /direct those algorithms")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    kinds = parser.add_subparsers(dest="what", required=True)
    of_photos = kinds.add_parser("photos", parents=[common])
    of_photos.add_argument("--photos", type=Path, required=True)
    of_photos.add_argument("--labels", type=Path, required=True, help="formats: whole/labels.py")
    of_photos.add_argument("--split", default="test")
    of_photos.add_argument("--true", action="store_true", help="of JSON lines: COCO's own labels, not the teachers'")
    of_film = kinds.add_parser("film", parents=[common])
    of_film.add_argument("--long", type=Path, required=True)
    of_film.add_argument("--short", type=Path, required=True)
    return parser.parse_args()


def photos(args: argparse.Namespace, entries: list[systems.System], folder: Path) -> list[list[str]]:
    truth = labels.read(args.labels, args.split, args.true)
    truth = [p for p in truth if (args.photos / p.name).exists()]
    if not truth:
        sys.exit(f"expected photos named as in {args.labels} (split {args.split}) in {args.photos}, found none")
    files = [args.photos / p.name for p in truth]
    every, few = link(files, folder / "long"), link(one_of_each_shape(files), folder / "short")
    timings = measure.race(entries, args.models, every, few, args.rounds, folder)
    rows = heads(["CPU a photo", "its networks", "found", "mean OKS", "reports right"])
    for i, (entry, timing) in enumerate(zip(entries, timings, strict=True)):
        reported, total = reports.read(folder / f"{i}.jsonl"), score.Score()
        for picture in truth:
            score.add(total, picture, reported.get(picture.name, []))
        right = f"{100 * total.precision():.0f} %" if any(p.everybody for p in truth) else "–"
        rows.append(cells(entry, timing, [f"{100 * total.found():.1f} %", f"{total.mean_oks():.3f}", right]))
    print(f"\n{len(files)} photos, {len(total.oks)} people judged:\n")
    return rows


def film(args: argparse.Namespace, entries: list[systems.System], folder: Path) -> list[list[str]]:
    long, short = (measure.Input(f, frames(f)) for f in (args.long, args.short))
    timings = measure.race(entries, args.models, long, short, args.rounds, folder)
    rows = heads(["CPU a frame", "its networks", "people a frame"])
    for i, (entry, timing) in enumerate(zip(entries, timings, strict=True)):
        lines = (folder / f"{i}.jsonl").read_text().splitlines()
        rows.append(cells(entry, timing, [f"{reports.people(lines) / long.frames:.1f}"]))
    return rows


def heads(of_figures: list[str]) -> list[list[str]]:
    names = ["system", "version", *of_figures, "licence"]
    return [names, ["---"] * len(names)]


def cells(entry: systems.System, timing: measure.Timing, figures: list[str]) -> list[str]:
    inside = timing.networks()
    name = f"**{entry.name}**" if not entry.program else entry.name
    times = [f"{timing.median():.1f} ms", "–" if inside is None else f"{inside:.1f} ms"]
    return [name, timing.version, *times, *figures, entry.licence]


def link(files: list[Path], folder: Path) -> measure.Input:
    """A folder of links to these files alone."""
    folder.mkdir()
    for file in files:
        (folder / file.name).symlink_to(file.resolve())
    return measure.Input(folder, len(files))


def one_of_each_shape(files: list[Path]) -> list[Path]:
    """OF_SHAPE wide, upright and square photos each, as far as there are: whatever a shape costs once is start-up."""
    chosen: dict[int, list[Path]] = {}
    for file in files:
        picture = cv2.imread(str(file))
        if picture is None:
            sys.exit(f"expected a photo, found {file}, which cannot be decoded")
        height, width = picture.shape[:2]
        same = chosen.setdefault((width > height) - (width < height), [])
        if len(same) < OF_SHAPE:
            same.append(file)
    return sorted(f for same in chosen.values() for f in same)


def frames(film_file: Path) -> int:
    reader, count = cv2.VideoCapture(str(film_file)), 0
    while reader.grab():
        count += 1
    return count


if __name__ == "__main__":
    main()
