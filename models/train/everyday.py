"""Whole photos of everyday life in which everybody is labelled: python everyday.py PHOTOS LABELS FOLDER [--open].

PHOTOS holds a folder of JPEG files a source, LABELS a `SOURCE.jsonl.gz` each and `sources.json`. FOLDER gets `pictures.bin`
(the files as they are, mapped by training) and `people.npz`. Only photos whose `split` is train are taken; with `--open` only those whose
terms allow commercial use, with joints by rules that no academic labels made, and `attribution.txt` names every photo, and who is to be
named for it where its row has a `credit`.
"""

from __future__ import annotations

import argparse
import gzip
import json
import math
import pathlib
import re
import sys
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

import terms
from coco17 import ABSENT, LABELLED, LSP, OPEN, UNKNOWN, to14
from real import decode
from skeleton import FLIP14, NJ

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
ASPECT = (0.6, 1.7)  # of what was squeezed
FRAME = (512, 320)  # pixels of the whole frame, longer side along the picture's
GREYS = (0.0, 114 / 255, 128 / 255, 0.5)  # of what lies beyond the picture
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
FILLED = 0.85  # of a tile's length, by a photo that is shrunk for small people: beyond it there is nothing to learn from
SMALLEST = 32  # px of stature: smaller people are neither demanded nor forbidden


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
    rules = OPEN if only_open else LSP
    names: list[tuple[str, dict]] = []
    offset, size, start, weight, stretched, origin = [0], [], [0], [], [], []
    joints, state, box = [], [], []
    with open(out / "pictures.bin", "wb") as f:
        for at, (name, source) in enumerate(sources.items()):
            n = 0
            for line in gzip.open(labels / f"{name}.jsonl.gz", "rt"):
                row = json.loads(line)
                if not wanted(row, source, only_open):
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
            print(f"{name}: {n} photos")
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
    else:
        terms.unmark(out)
    sure = (np.concatenate(state) == LABELLED).any(1)
    print(f"{len(size)} photos, {sure.sum()} people labelled, {(~sure).sum()} neither demanded nor forbidden")


def stature(joints: Tensor, labelled: Tensor, box: Tensor) -> Tensor:
    """Pixels [n] of people with joints [n, 14, 2] and boxes of longer side `box` [n]: the largest that any part in sight asks for, since none
    looks longer than it is."""

    def part(a: list[int], b: list[int], times: float) -> Tensor:
        known = labelled[:, a].all(1) & labelled[:, b].all(1)
        return (joints[:, a].mean(1) - joints[:, b].mean(1)).norm(dim=-1) * times * known

    parts = [part([1], [8, 11], 2.9), part([2], [5], 3.8), part([0], [1], 5.0), *(part([a], [b], 3.9) for a, b in ((8, 9), (9, 10), (11, 12), (12, 13)))]
    best = torch.stack(parts).amax(0)
    return torch.where(best > 0, best, box)


@dataclass
class Batch:
    image: Tensor  # float 0..1 [B, 3, H, W]
    joints2d: Tensor  # [B, P, 14, 2]
    labelled: Tensor  # bool [B, P, 14]
    unknown: Tensor  # bool [B, P, 14]: neither demanded nor forbidden inside the person's box
    size_px: Tensor  # [B, P], 0 = nobody
    box: Tensor  # bool [B, P, h, w] at stride 8
    hazy: Tensor  # bool [B, h, w]: somebody of whom nothing is sure


class Everyday:
    """Draws tiles and whole frames of the photos that `pack` packed."""

    def __init__(self, folder: pathlib.Path, seed: int, away: float = 0.0):
        """`away`: share of tiles that look past everybody, where a photo has such a place."""
        self.away = away
        z = np.load(folder / "people.npz")
        self.offset, self.size, self.start, self.stretched = z["offset"], z["size"], z["start"], z["stretched"]
        self.joints, self.state, self.box = (torch.from_numpy(z[k]) for k in ("joints", "state", "box"))
        self.weight = torch.from_numpy(z["weight"])
        self.pictures = np.memmap(folder / "pictures.bin", np.uint8, "r")
        self.g = torch.Generator().manual_seed(seed)

    def _uniform(self, low: float, high: float) -> float:
        return low + (high - low) * float(torch.rand((), generator=self.g))

    def _log_uniform(self, low: float, high: float) -> float:
        return math.exp(self._uniform(math.log(low), math.log(high)))

    def picture(self, i: int) -> Tensor:
        """uint8 [3, h, w]"""
        return torch.from_numpy(decode(self.pictures[self.offset[i] : self.offset[i + 1]].tobytes())).permute(2, 0, 1)

    @torch.no_grad()
    def batch(
        self,
        n: int,
        H: int,
        W: int,
        zoom: tuple[float, float],
        tall: tuple[float, float] | None = None,
        close: bool = False,
    ) -> Batch:
        """`zoom`: of the photo as the network's frame shows it; `tall`: somebody has a stature of so many pixels instead, as far as the
        photo's sharpness allows; `close`: and is placed by head and neck three times of four."""
        ids = torch.multinomial(self.weight, n, True, generator=self.g).tolist()
        tiles = [self._tile(i, H, W, zoom, tall, close) for i in ids]
        room = max(1, *(len(t[1]) for t in tiles))

        def padded(k: int) -> Tensor:
            return torch.stack([torch.cat([t[k], t[k].new_zeros(room - len(t[k]), *t[k].shape[1:])]) for t in tiles])

        return Batch(torch.stack([t[0] for t in tiles]), *(padded(k) for k in range(1, 6)), torch.stack([t[6] for t in tiles]))

    def _nobody(self, box: Tensor, extent: Tensor, window: Tensor) -> Tensor:
        """The middle of a window [2] of a photo of `extent` [2] with the least of anybody's `box` [P, 4] in it, of some drawn at random."""
        reach = (extent - window).clamp_min(0)
        low = (extent - 1 - reach) / 2 + torch.rand(8, 2, generator=self.g) * reach - window / 2
        both = torch.minimum(low[:, None] + window, box[None, :, 2:]) - torch.maximum(low[:, None], box[None, :, :2])
        hidden = both.clamp_min(0).prod(2).sum(1)
        return low[int(hidden.argmin())] + window / 2

    def _tile(
        self, i: int, H: int, W: int, zoom: tuple[float, float], tall: tuple[float, float] | None, close: bool
    ) -> tuple[Tensor, ...]:
        image = self.picture(i)[None].float() / 255
        h, w = image.shape[2:]
        own = slice(self.start[i], self.start[i + 1])
        joints, state, box = self.joints[own].clone(), self.state[own], self.box[own]
        aspect = self._log_uniform(*ASPECT) if self.stretched[i] else self._log_uniform(0.93, 1.07)
        ax, ay = aspect**0.5, aspect**-0.5
        frame = FRAME if w * ax >= h * ay else FRAME[::-1]
        scale = min(frame[0] / (w * ax), frame[1] / (h * ay))
        z = scale * self._log_uniform(*zoom)
        sure = (state == LABELLED).any(1)
        half = torch.tensor([(W - 1) / 2, (H - 1) / 2])
        middle = torch.tensor([(w - 1) / 2, (h - 1) / 2])
        stretch = torch.tensor([ax, ay])
        centre = middle
        if sure.any():
            who = int(torch.multinomial(sure.float(), 1, generator=self.g))
            b = box[who] * torch.tensor([ax, ay, ax, ay])
            if tall is not None:
                long = (b[2:] - b[:2]).max()
                px = stature(joints[who : who + 1] * stretch, state[who : who + 1] == LABELLED, long[None])[0]
                least = 0.4 * scale if close else FILLED * min(W / (w * ax), H / (h * ay))
                z = min(max(self._log_uniform(*tall) / float(px.clamp_min(1)), least), 2.5 * scale)
            centre = (box[who, :2] + box[who, 2:]) / 2
            if close and (state[who, :2] == LABELLED).all() and self._uniform(0, 1) < 0.75:
                centre = joints[who, :2].mean(0)
            centre = centre + (torch.rand(2, generator=self.g) - 0.5) * torch.tensor([W, H]) * 0.7 / (z * stretch)
        if len(state) == 0 or (self.away and self._uniform(0, 1) < self.away):
            centre = self._nobody(box, torch.tensor([w, h]), torch.tensor([W, H]) / (z * stretch))
        # no more beyond the picture than the tile cannot help to show
        reach = (torch.tensor([w, h]) - torch.tensor([W, H]) / (z * stretch)).clamp_min(0) / 2
        centre = torch.minimum(torch.maximum(centre, middle - reach), middle + reach)
        turn = max(-0.4, min(0.4, 0.12 * float(torch.randn((), generator=self.g))))
        mirrored = self._uniform(0, 1) < 0.5
        co, si = math.cos(turn), math.sin(turn)
        A = torch.tensor([[co, -si], [si, co]]) @ torch.diag(z * stretch * torch.tensor([-1.0 if mirrored else 1.0, 1.0]))
        back = torch.linalg.inv(A)

        def source(step: int, first: float) -> Tensor:
            """Places in the photo of the tile's pixels, every `step`-th from `first` on: [h, w, 2]."""
            xs, ys = torch.arange(first, W, step), torch.arange(first, H, step)
            p = torch.stack(torch.meshgrid(xs, ys, indexing="xy"), -1) - half
            return p @ back.T + centre

        q = source(1, 0.0)
        extent = torch.tensor([w, h])
        grid = (q * 2 + 1) / extent - 1
        shrunk, left = image, z * min(ax, ay)
        while left < 0.55:
            shrunk, left = F.avg_pool2d(shrunk, 2, ceil_mode=True, count_include_pad=False), 2 * left
        tile = F.grid_sample(shrunk, grid[None], align_corners=False, padding_mode="border")[0]
        inside = ((q > -0.5) & (q < extent - 0.5)).all(-1)
        grey = GREYS[int(torch.randint(len(GREYS), (), generator=self.g))]
        tile = torch.where(inside, tile, torch.tensor(grey))

        placed = (joints - centre) @ A.T + half
        if mirrored:
            placed, state = placed[:, FLIP14], state[:, FLIP14]
        labelled = state == LABELLED
        length = ((box[:, 2:] - box[:, :2]) * stretch).amax(1) * z
        size = stature(placed, labelled, length)
        cells = source(8, 3.5)
        margin = 0.06 * (box[:, 2:] - box[:, :2]).amax(1, keepdim=True) + 4 / z
        low, high = box[:, :2] - margin, box[:, 2:] + margin
        covered = ((cells > low[:, None, None]) & (cells < high[:, None, None])).all(-1)
        seen = sure & (size >= SMALLEST)
        hazy = covered[~seen].any(0)
        keep = seen & covered.flatten(1).any(1)
        return tile, placed[keep], labelled[keep], (state == UNKNOWN)[keep], size[keep], covered[keep], hazy


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
