"""BlazePose's depth of people in photos of everyday life: python depth.py EVERYDAY [--processes N] [--limit N] [--model heavy.tflite].

EVERYDAY is a folder of everyday.py. Adds `depth.npz`, one row a person of people.npz, in its order:

    rel3d   f16   [people, 21, 3] joints relative to the pelvis, metres at 1.70 m stature, x right, y down, z forward, view-aligned; 0 unless lifted
    lifted  bool  [people] the answer agrees closely enough with the person's labels to lend its depth

Everybody whose trunk and most of whose joints are labelled is cut out with a margin and shown to BlazePose alone. Its world landmarks are in the
axes of the cut-out's own camera, which looks along the ray through its middle. View-aligned axes look along the ray through the neck, a few degrees
away for most people and more for those close to the camera: near enough for a teacher that errs by as much. Needs mediapipe, as teacher.py does.
"""

from __future__ import annotations

import argparse
import pathlib
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from multiprocessing import Pool as Processes

import numpy as np
from PIL import Image

import teacher
import terms
from coco17 import LABELLED
from real import decode
from skeleton import JOINTS21

FILE = "depth.npz"
LEAST_JOINTS = 8  # labelled ones: with fewer there is too little to agree with
TRUNK = [2, 5, 8, 11]
LEAST_PX = 96  # of the box's longer side: BlazePose guesses at smaller people
MARGIN = 0.3  # of the box's longer side, on every side: its detector overlooks people who fill a picture
SHOWN_PX = 256  # at least, of a cut-out's longer side: what BlazePose's networks look at

Job = tuple[bytes, np.ndarray]  # a photo's file, boxes [n, 4] of people in it
Answer = tuple[np.ndarray, np.ndarray]  # landmarks [33, 4] in the photo's pixels, world landmarks [33, 3]; zeros where nobody is seen
Ask = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray | None]]  # as `teacher.ask`


def read(folder: pathlib.Path, people: int) -> tuple[np.ndarray, np.ndarray]:
    """`rel3d` and `lifted` of a folder of so many people; where it has no depth.npz nobody is lifted."""
    path = folder / FILE
    if not path.exists():
        return np.zeros((people, len(JOINTS21), 3), np.float16), np.zeros(people, bool)
    z = np.load(path)
    rel3d, lifted = z["rel3d"], z["lifted"]
    if len(rel3d) != people or len(lifted) != people:
        raise SystemExit(f"expected {people} rows in {path}, one a person of people.npz, found {len(lifted)}: run depth.py on this folder again")
    return rel3d, lifted


def write(folder: pathlib.Path, rel3d: np.ndarray, lifted: np.ndarray) -> None:
    np.savez_compressed(folder / FILE, rel3d=rel3d, lifted=lifted)


@dataclass(frozen=True)
class Crop:
    """A rectangle of a photo, as it is shown to BlazePose. Pixel centres are integers in both."""

    left: int  # photo's pixels
    top: int
    width: int
    height: int
    shown: tuple[int, int]  # width and height after enlarging

    @classmethod
    def around(cls, box: np.ndarray) -> Crop:
        """With a margin round the box [4], which may leave the photo."""
        margin = MARGIN * float((box[2:] - box[:2]).max())
        (left, top), (right, bottom) = np.floor(box[:2] - margin).astype(int).tolist(), np.ceil(box[2:] + margin).astype(int).tolist()
        width, height = right - left, bottom - top
        scale = max(1.0, SHOWN_PX / max(width, height))
        return cls(left, top, width, height, (max(round(width * scale), 1), max(round(height * scale), 1)))

    def cut(self, image: np.ndarray) -> np.ndarray:
        """The rectangle of uint8 [h, w, 3], enlarged; what lies beyond the photo is like its edge."""
        rows = np.arange(self.top, self.top + self.height).clip(0, image.shape[0] - 1)
        columns = np.arange(self.left, self.left + self.width).clip(0, image.shape[1] - 1)
        own = image[rows[:, None], columns]
        if self.shown == (self.width, self.height):
            return own
        return np.asarray(Image.fromarray(own).resize(self.shown, Image.Resampling.BICUBIC))

    def to_photo(self, xy: np.ndarray) -> np.ndarray:
        """Pixels [..., 2] of what is shown -> the photo's, in double precision."""
        return (np.asarray(xy, np.float64) + 0.5) * [self.width / self.shown[0], self.height / self.shown[1]] - 0.5 + [self.left, self.top]

    def from_photo(self, xy: np.ndarray) -> np.ndarray:
        """The inverse of `to_photo`."""
        return (np.asarray(xy, np.float64) + 0.5 - [self.left, self.top]) * [self.shown[0] / self.width, self.shown[1] / self.height] - 0.5


def look(job: Job, ask: Ask) -> list[Answer]:
    """What is seen of everybody whose box is given, one after the other."""
    buf, boxes = job
    image = decode(buf)
    out = []
    for box in boxes:
        crop = Crop.around(box)
        flat, world, _ = ask(crop.cut(image))
        if flat.any():
            flat = np.concatenate([crop.to_photo(flat[:, :2]), flat[:, 2:]], 1)
        out.append((flat, world))
    return out


def asked(z: dict[str, np.ndarray], limit: int = 0) -> np.ndarray:
    """Rows of people.npz of whom BlazePose is asked; with `limit` so many of them, spread over all. Squeezed photos have no depth to lend."""
    known = z["state"] == LABELLED
    long = (z["box"][:, 2:] - z["box"][:, :2]).max(1)
    squeezed = np.repeat(z["stretched"], np.diff(z["start"]))
    who = np.nonzero((known.sum(1) >= LEAST_JOINTS) & known[:, TRUNK].all(1) & (long >= LEAST_PX) & ~squeezed)[0]
    return who[np.linspace(0, len(who) - 1, limit).astype(int)] if 0 < limit < len(who) else who


def lend(folder: pathlib.Path, answers: Callable[[Iterable[Job]], Iterable[list[Answer]]], limit: int = 0) -> None:
    """Write depth.npz; `answers`: `look` at every job, in order."""
    z = dict(np.load(folder / "people.npz"))
    files = np.memmap(folder / "pictures.bin", np.uint8, "r")
    who, people = asked(z, limit), len(z["state"])
    photo = np.repeat(np.arange(len(z["size"])), np.diff(z["start"]))[who]
    labels = np.concatenate([z["joints"], (z["state"] == LABELLED)[..., None]], 2)

    def jobs() -> Iterator[Job]:
        for i in np.unique(photo):
            yield files[z["offset"][i] : z["offset"][i + 1]].tobytes(), z["box"][who[photo == i]]

    rel3d, lifted = np.zeros((people, len(JOINTS21), 3), np.float16), np.zeros(people, bool)
    statures = []
    for n, (row, (flat, world)) in enumerate(zip(who, (a for found in answers(jobs()) for a in found), strict=True), 1):
        if flat.any():
            joints, tall = teacher.canonical(world)
            statures.append(tall)
            lifted[row] = teacher.lends(*teacher.agreement(teacher.evidence(flat), labels[row]), tall)
            rel3d[row] = joints * lifted[row]
        if n % 500 == 0:
            print(f"{n} of {len(who)} people: lend depth {lifted.sum() / n:.2f}", flush=True)
    write(folder, rel3d, lifted)
    median = f"{np.median(statures):.2f} m" if statures else "unknown"
    print(f"{people} people, {len(who)} asked of, {lifted.sum()} lend depth ({lifted.sum() / max(len(who), 1):.2f}); median stature {median}")
    if terms.is_open(folder):
        terms.mark(folder, terms.ingredients(folder) | terms.DEPTH)
        print(f"{folder} stays open: {terms.FILE} names BlazePose, too")


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("folder", type=pathlib.Path)
    ap.add_argument("--model", type=pathlib.Path, help="pose_landmark_heavy.tflite (npm package @mediapipe/pose); without it the wheel's own")
    ap.add_argument("--processes", type=int, default=1)
    ap.add_argument("--limit", type=int, default=0, help="people to ask of, spread over all")
    a = ap.parse_args(argv)
    teacher.require_mediapipe()
    with Processes(a.processes, teacher.start, (a.model, False)) as pool:
        lend(a.folder, lambda jobs: pool.imap(partial(look, ask=teacher.ask), jobs, chunksize=4), a.limit)


if __name__ == "__main__":
    main(sys.argv[1:])
