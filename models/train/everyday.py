"""Whole photos of everyday life in which everybody is labelled: python everyday.py PHOTOS LABELS FOLDER [--open].

PHOTOS holds a folder of JPEG files a source, LABELS a `SOURCE.jsonl.gz` each, the folder above LABELS `sources.json`. FOLDER gets `pictures.bin`
(the files as they are, mapped by training) and `people.npz`. Only photos whose `split` is train are taken, without
those that are like one of the test split (`apart.py`); with `--open` only those whose terms allow commercial use, with
joints by rules that no academic labels made, and `attribution.txt` names every photo, and who is to be named for it
where its row has a `credit`.
"""

from __future__ import annotations

import argparse
import gzip
import json
import pathlib
import re
import sys

import numpy as np

import apart
import depth
import terms
from coco17 import ABSENT, LABELLED, LSP, OPEN, UNKNOWN, to14

# What a joint needs to be believed: TinyPose's confidence, how far its four looks lie apart (of the box's longer side), and how far MoveNet's is
# (of the root of the box's area), by how well the two agree about the person (OKS of the limbs).
CONFIDENT, SPREAD = 0.3, 0.05
GAP_AGREED, GAP_DOUBTED = 0.25, 0.10
AGREED, DOUBTED = 0.7, 0.5
UNSEEN = 0.08  # a confidence this low says that the joint is not in the picture
LEAST = 4  # labelled joints; with fewer nobody knows enough about the person
SHARE = dict(stanford40=1.0, human_dataset_v2=0.8, free_exercise=0.8, animals_with_people=0.8, animals_no_people=0.5, vikram=1.0, coco128=1.0)  # 1 for others
BY_HAND = 1.5  # photos labelled by hand, against 1 for those of teachers
STRETCHED = {"human_dataset_v2"}  # squeezed into squares
# Where COCO's joints of somebody upright lie in the box, shares of it: a guess at people without joints.
STANDING = np.array(
    [[0.5, 0.1], [0.54, 0.08], [0.46, 0.08], [0.58, 0.09], [0.42, 0.09], [0.7, 0.21], [0.3, 0.21], [0.78, 0.36], [0.22, 0.36]]
    + [[0.8, 0.5], [0.2, 0.5], [0.62, 0.52], [0.38, 0.52], [0.62, 0.74], [0.38, 0.74], [0.62, 0.95], [0.38, 0.95]]
)
OPEN_IMAGES = "those of Open Images alone, listed as CC BY 2.0"
TEACHERS = {
    "labels by YOLOX-nano, PP-TinyPose, MoveNet Thunder": "Apache-2.0",
    "boxes of human_dataset_v2": "CC BY 4.0 as their uploader states",
    "neck and head top by coco17.OPEN": "this project's, of the CC0 body",
}


def states(person: dict, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """One labelled person -> joints [17, 2] in pixels and what is known of each [17]; all `UNKNOWN` for somebody unsure, whose joints are guesses."""
    if "true" in person:
        t = np.array(person["true"], np.float32)
        return t[:, :2] * [width, height], np.where(t[:, 2] > 0, LABELLED, UNKNOWN).astype(np.uint8)
    if "kp" not in person:
        x0, y0, x1, y1 = person["box"]
        return (STANDING * [x1 - x0, y1 - y0] + [x0, y0]) * [width, height], np.full(17, UNKNOWN, np.uint8)
    k, spread, gap = (np.array(person[key], np.float32) for key in ("kp", "spread", "gap"))
    beyond = ((k[:, :2] < -0.01) | (k[:, :2] > 1.01)).any(1)
    sure = (k[:, 2] >= CONFIDENT) & (spread <= SPREAD) & ~beyond
    sure &= gap <= (GAP_AGREED if person.get("agree", 0) >= AGREED else GAP_DOUBTED)
    sure &= person.get("agree", 0) >= DOUBTED
    unseen = (k[:, 2] < UNSEEN) | (beyond & (k[:, 2] < CONFIDENT))
    unseen &= person.get("agree", 0) >= DOUBTED
    return k[:, :2] * [width, height], np.where(sure, LABELLED, np.where(unseen, ABSENT, UNKNOWN)).astype(np.uint8)


def wanted(row: dict, source: dict, only_open: bool) -> bool:
    """Whether a photo may be trained on: of the train split, with everybody labelled, and open where only that is wanted."""
    if row["split"] != "train" or row.get("more"):
        return False
    if not only_open:
        return True
    return source["open"] is True or (source["open"] == "origin openimages" and row.get("origin") == "openimages")


def attribution(source: str, row: dict) -> str:
    """A photo's line: where it is from. Open Images' photos are named by the id under which Open Images names author, title and licence."""
    if row.get("origin") != "openimages":
        return f"{source} {row['src']}"
    found = re.search(r"(?<![0-9a-f])[0-9a-f]{16}(?![0-9a-f])", row["src"])
    if not found:
        raise SystemExit(f"expected an Open Images id of 16 hexadecimal digits in {row['src']}, found none: its origin is not known")
    return f"openimages {found[0]}"


def named(path: pathlib.Path) -> frozenset[str]:
    """Photos of a file like attribution.txt, without their credits, or ids, one a line."""
    return frozenset(line.partition("\t")[0] for line in path.read_text(encoding="utf-8").splitlines())


def pack(photos: pathlib.Path, labels: pathlib.Path, out: pathlib.Path, only_open: bool, without: frozenset[str] = frozenset()) -> None:
    """`without`: lines of attribution.txt, or their Open Images ids, of photos to leave out."""
    sources = json.loads((labels.parent / "sources.json").read_text())
    out.mkdir(parents=True, exist_ok=True)
    terms.unmark(out)  # until all of it is known to be open
    # All of them first: a photo of any source may be like one of another's test split.
    labelled = [(name, json.loads(line)) for name in sources for line in gzip.open(labels / f"{name}.jsonl.gz", "rt")]
    like_test = apart.like_test(labelled)
    # What an earlier pack left describes pictures that are about to be replaced.
    for name in ("people.npz", "attribution.txt", depth.FILE):
        (out / name).unlink(missing_ok=True)
    rules = OPEN if only_open else LSP
    names: list[tuple[str, dict]] = []
    offset, size, start, weight, stretched, origin = [0], [], [0], [], [], []
    joints, state, box = [], [], []
    with open(out / "pictures.bin", "wb") as f:
        for at, (name, source) in enumerate(sources.items()):
            n, left = 0, 0
            for (of, row), like in zip(labelled, like_test):
                if of != name or not wanted(row, source, only_open):
                    continue
                if like:
                    left += 1
                    continue
                if without and not without.isdisjoint({line := attribution(name, row), line.partition(" ")[2]}):
                    continue
                w, h = row["size"]
                known = [states(p, w, h) for p in row["people"]]
                xy = np.array([k[0] for k in known], np.float32).reshape(-1, 17, 2)
                j, s = to14(xy, np.array([k[1] for k in known], np.uint8).reshape(-1, 17), rules)
                sure = (s == LABELLED).sum(1) >= LEAST
                if len(s) and not sure.any():
                    continue
                s[~sure] = UNKNOWN
                data = (photos / name / row["file"]).read_bytes()
                f.write(data)
                offset.append(offset[-1] + len(data))
                size.append((w, h))
                joints.append(j)
                state.append(s)
                box.append(np.array([p["box"] for p in row["people"]], np.float32).reshape(-1, 4) * [w, h, w, h])
                start.append(start[-1] + len(j))
                by_hand = any("true" in p for p in row["people"])
                weight.append(SHARE.get(name, 1.0) * (BY_HAND if by_hand else 1) * (0.5 + 0.5 * float(sure.mean()) if len(s) else 1))
                stretched.append(name in STRETCHED)
                origin.append(at)
                names.append((name, row))
                n += 1
            print(f"{name}: {n} photos; {left} left out that are like one of the test split")
    np.savez(
        out / "people.npz",
        offset=np.array(offset, np.int64),
        size=np.array(size, np.int32),
        start=np.array(start, np.int64),
        weight=np.array(weight, np.float32),
        stretched=np.array(stretched),
        source=np.array(origin, np.uint8),
        sources=np.array(list(sources)),
        joints=np.concatenate(joints).astype(np.float32),
        state=np.concatenate(state),
        box=np.concatenate(box).astype(np.float32),
    )
    if only_open:
        if any("true" in p for _, row in names for p in row["people"]):
            raise SystemExit("expected teachers' labels alone, found COCO's own: a photo of COCO's is among those called open")
        used = sorted({name for name, _ in names})
        stated = {n: OPEN_IMAGES if sources[n]["open"] == "origin openimages" else sources[n]["terms"] for n in used}
        terms.mark(out, {f"photos of {n}, {sources[n]['repo']}": stated[n] for n in used} | TEACHERS)
        lines = ("\t".join([attribution(name, row), *filter(None, [row.get("credit")])]) for name, row in names)
        (out / "attribution.txt").write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    sure = (np.concatenate(state) == LABELLED).any(1)
    print(f"{len(size)} photos, {sure.sum()} people labelled, {(~sure).sum()} neither demanded nor forbidden")


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("photos", type=pathlib.Path)
    ap.add_argument("labels", type=pathlib.Path)
    ap.add_argument("folder", type=pathlib.Path)
    ap.add_argument("--open", action="store_true", help="only photos whose terms allow commercial use")
    ap.add_argument("--without", type=pathlib.Path, help="file of photos to leave out, one a line: lines of attribution.txt, or Open Images ids (attribution.py)")
    a = ap.parse_args(argv)
    pack(a.photos, a.labels, a.folder, a.open, named(a.without) if a.without else frozenset())


if __name__ == "__main__":
    main(sys.argv[1:])
