"""Tiles and whole frames of photos in which everybody is labelled, drawn from what everyday.py packed."""

from __future__ import annotations

import math
import pathlib
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

import depth
from augment import GREYS, turn
from coco17 import LABELLED, UNKNOWN
from real import decode, each
from skeleton import FLIP14, FLIP21, NJ

ASPECT = (0.6, 1.7)  # of what was squeezed
FRAME = (512, 320)  # pixels of the whole frame, longer side along the picture's
FILLED = 0.85  # of a tile's length, by a photo that is shrunk for small people: beyond it there is nothing to learn from
SMALLEST = 32  # px of stature: smaller people are neither demanded nor forbidden
HALVED = 0.55  # below this scale a photo is halved first, so that nothing between its pixels is missed
HALVINGS = 3  # kept of every photo, where all are kept decoded
# How tall somebody is by a part in sight: the means of two sets of joints, and how often their distance goes into a stature.
PARTS = [([1], [8, 11], 2.9), ([2], [5], 3.8), ([0], [1], 5.0), *(([a], [b], 3.9) for a, b in ((8, 9), (9, 10), (11, 12), (12, 13)))]


def _ends() -> tuple[Tensor, Tensor]:
    """[parts, 14]: what a part's vector takes of every joint, times the stature it stands for; and which joints it needs."""
    vector = torch.zeros(len(PARTS), NJ)
    for row, (a, b, times) in zip(vector, PARTS):
        row[a], row[b] = times / len(a), -times / len(b)
    return vector, (vector != 0).float()


VECTOR, NEEDED = _ends()


def stature(joints: Tensor, labelled: Tensor, box: Tensor) -> Tensor:
    """Pixels [n] of people with joints [n, 14, 2] and boxes of longer side `box` [n]: the largest that any part in sight asks for, since none
    looks longer than it is."""
    known = labelled.float() @ NEEDED.T > NEEDED.sum(1) - 0.5
    best = ((VECTOR @ joints).norm(dim=-1) * known).amax(1)
    return torch.where(best > 0, best, box)


def halved(image: Tensor) -> Tensor:
    """uint8 [3, h, w] -> means of 2×2 pixels."""
    return F.avg_pool2d(image[None].float(), 2, ceil_mode=True, count_include_pad=False)[0].round().to(torch.uint8)


@dataclass
class Batch:
    image: Tensor  # float 0..1 [B, 3, H, W]
    joints2d: Tensor  # [B, P, 14, 2]
    labelled: Tensor  # bool [B, P, 14]
    unknown: Tensor  # bool [B, P, 14]: neither demanded nor forbidden inside the person's box
    size_px: Tensor  # [B, P], 0 = nobody
    box: Tensor  # bool [B, P, h, w] at stride 8
    rel3d: Tensor  # [B, P, 21, 3] the teacher's 3D about the pelvis, metres at canonical stature, view-aligned
    lifted: Tensor  # bool [B, P]: it is to be trusted
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
        rel3d, lifted = depth.read(folder, len(self.state))
        self.rel3d, self.lifted = torch.from_numpy(rel3d).float(), torch.from_numpy(lifted)
        self.lends = bool(lifted.any())  # whether anybody lends depth
        self.pictures = np.memmap(folder / "pictures.bin", np.uint8, "r")
        self.g = torch.Generator().manual_seed(seed)
        self.kept: list[list[Tensor]] = []

    def keep_decoded(self) -> None:
        """Keep every photo in memory, whole and shrunk (a gigabyte for 1,200): processes forked afterwards share them."""
        self.kept = each(lambda i: self._shrunk(i, HALVINGS), len(self.size))

    def _shrunk(self, i: int, halvings: int) -> list[Tensor]:
        out = [torch.from_numpy(decode(self.pictures[self.offset[i] : self.offset[i + 1]].tobytes())).permute(2, 0, 1)]
        for _ in range(halvings):
            out.append(halved(out[-1]))
        return out

    def _uniform(self, low: float, high: float) -> float:
        return low + (high - low) * float(torch.rand((), generator=self.g))

    def _log_uniform(self, low: float, high: float) -> float:
        return math.exp(self._uniform(math.log(low), math.log(high)))

    def picture(self, i: int, halvings: int = 0) -> Tensor:
        """uint8 [3, h, w]"""
        if self.kept:
            return self.kept[i][min(halvings, HALVINGS)]
        return self._shrunk(i, halvings)[-1]

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

        return Batch(torch.stack([t[0] for t in tiles]), *(padded(k) for k in range(1, 8)), torch.stack([t[8] for t in tiles]))

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
        w, h = self.size[i].tolist()
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
        angle = turn(W != H, self.g)
        mirrored = self._uniform(0, 1) < 0.5
        co, si = math.cos(angle), math.sin(angle)
        rotation = torch.tensor([[co, -si], [si, co]])
        A = rotation @ torch.diag(z * stretch * torch.tensor([-1.0 if mirrored else 1.0, 1.0]))
        back = torch.linalg.inv(A)

        def source(step: int, first: float) -> Tensor:
            """Places in the photo of the tile's pixels, every `step`-th from `first` on: [h, w, 2]."""
            xs, ys = torch.arange(first, W, step), torch.arange(first, H, step)
            p = torch.stack(torch.meshgrid(xs, ys, indexing="xy"), -1) - half
            return p @ back.T + centre

        q = source(1, 0.0)
        extent = torch.tensor([w, h])
        grid = (q * 2 + 1) / extent - 1
        halvings, left = 0, z * min(ax, ay)
        while left < HALVED:
            halvings, left = halvings + 1, 2 * left
        image = self.picture(i, halvings)[None].float() / 255
        tile = F.grid_sample(image, grid[None], align_corners=False, padding_mode="border")[0]
        inside = ((q > -0.5) & (q < extent - 0.5)).all(-1)
        grey = GREYS[int(torch.randint(len(GREYS), (), generator=self.g))]
        tile = torch.where(inside, tile, torch.tensor(grey))

        placed = (joints - centre) @ A.T + half
        rel3d = self.rel3d[own].clone()
        if mirrored:
            placed, state = placed[:, FLIP14], state[:, FLIP14]
            rel3d = rel3d[:, FLIP21] * torch.tensor([-1.0, 1.0, 1.0])
        # stretching is left out: photos that lend depth are stretched by a few per cent alone, less than BlazePose errs by
        rel3d[..., :2] = rel3d[..., :2] @ rotation.T
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
        known = labelled[keep], (state == UNKNOWN)[keep], size[keep], covered[keep], rel3d[keep], self.lifted[own][keep]
        return tile, placed[keep], *known, hazy
