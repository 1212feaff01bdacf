"""A ring of rendered scenes on the device; training tiles are random similarity crops of it.

Rendering and training are decoupled: each step replaces a few scenes and draws many tiles, every tile with its own crop, mirror,
roll and camera augmentation.  `reuse` (tiles drawn per rendered scene) is the price knob.
"""

from __future__ import annotations

import pathlib
from dataclasses import dataclass, fields

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

import terms
from augment import GREYS, lying
from constants import constant
from scenes import Generator, Scenes
from skeleton import FLIP14, FLIP21, ROOT

WIDTH = 512  # of a frame as the network takes it, pixels; scenes may be larger
CPU = torch.device("cpu")
REACH = 32  # px: no joint draws anything on a map that is further away
FIELDS = [f.name for f in fields(Scenes) if f.name != "mask"]


@dataclass
class Tiles:
    image: Tensor  # float 0..1 [B, 3, h, w]
    joints2d: Tensor  # [B, P, 14, 2]
    visible: Tensor  # [B, P, 14]
    rel3d: Tensor  # [B, P, 21, 3]
    size_px: Tensor  # [B, P], 0 = nobody of whom a joint is in the tile or at its edge
    depth: Tensor  # [B, P]


class Pool:
    """Scenes to draw tiles from; `data` holds the fields of `Scenes` (without masks), `filled` how many are there."""

    def __init__(self, data: dict[str, Tensor], filled: int, seed: int):
        self.data, self.filled = data, filled
        image = data["image"]
        self.device, self.H, self.W = image.device, image.shape[2], image.shape[3]
        self.g = torch.Generator(device=self.device).manual_seed(seed)

    def refresh(self, n: int) -> None:
        """Replace n scenes by new ones, where scenes are rendered on the way."""

    @torch.no_grad()
    def draw(
        self, B: int, h: int, w: int, zoom: tuple[float, float] = (0.8, 1.3), roll: float = 0.12, close: tuple[float, float] | None = None
    ) -> Tiles:
        """`zoom`: of a frame of at most 512 pixels across, to which larger ones are shrunk first; `close`: somebody has a stature of so many pixels, as far as `zoom` allows, and is placed
        by head and neck three times of four. What lies beyond a scene is of one grey, as where a frame of another shape is padded."""
        d, g, W, H = self.device, self.g, self.W, self.H
        i = torch.randint(self.filled, (B,), generator=g, device=d)
        D = {k: v[i] for k, v in self.data.items() if k != "K"}

        def rand(*s: int) -> Tensor:
            return torch.rand(*s, generator=g, device=d)

        shrink = min(1.0, WIDTH / W)
        z = zoom[0] * (zoom[1] / zoom[0]) ** rand(B) * shrink
        a = (torch.randn(B, generator=g, device=d) * roll).clamp(-3 * roll, 3 * roll)
        if h == w:
            a = a + lying(rand(B))
        fl = rand(B) < 0.5
        # look at one of the people (tiles), or at the whole frame when the tile is as large as the scene
        size = D["size_px"]
        pick = torch.multinomial((size > 0).float() + 1e-6, 1, generator=g)[:, 0]
        picked = D["joints2d"][torch.arange(B, device=d), pick]
        mid = picked.mean(1)
        if close is not None:
            tall = close[0] * (close[1] / close[0]) ** rand(B)
            z = (tall / size[torch.arange(B, device=d), pick].clamp_min(1)).clamp(zoom[0] * shrink, zoom[1])
            mid = torch.where(rand(B, 1) < 0.75, picked[:, :2].mean(1), mid)
        lim = torch.stack([(W - w / z).clamp_min(0) / 2, (H - h / z).clamp_min(0) / 2], 1)
        full = constant([(W - 1) / 2, (H - 1) / 2], d)
        c = mid + (rand(B, 2) - 0.5) * constant([w, h], d) * 0.7 / z[:, None]
        c = torch.minimum(torch.maximum(c, full - lim), full + lim)
        s = torch.where(fl, -1.0, 1.0)
        co, si = z * a.cos(), z * a.sin()
        A = torch.stack([co * s, -si, si * s, co], -1).view(B, 2, 2)  # scene -> tile, about c
        half = constant([(w - 1) / 2, (h - 1) / 2], d)
        Ai = torch.linalg.inv_ex(A)[0]  # inv would wait for the device
        px = torch.stack(
            torch.meshgrid(torch.arange(w, device=d, dtype=torch.float32), torch.arange(h, device=d, dtype=torch.float32), indexing="xy"),
            -1,
        )
        src = (px - half) @ Ai[:, None].transpose(-1, -2) + c[:, None, None]
        grid = (src * 2 + 1) / constant([W, H], d) - 1
        # grey beyond the scene: mirrored people there would be taught as nobody
        grey = constant(GREYS, d)[torch.randint(len(GREYS), (B,), generator=g, device=d)][:, None, None, None]
        img = F.grid_sample(D["image"].float().sub_(255 * grey), grid, align_corners=False, padding_mode="zeros") / 255 + grey
        J = (D["joints2d"] - c[:, None, None]) @ A[:, None].transpose(-1, -2) + half
        f14, f21 = constant(FLIP14, d), constant(FLIP21, d)
        J = torch.where(fl[:, None, None, None], J[:, :, f14], J)
        vis = torch.where(fl[:, None, None], D["visible"][:, :, f14], D["visible"])
        away = torch.maximum(-0.5 - J, J - constant([w - 0.5, h - 0.5], d)).amax(-1)  # pixels from the tile; below 0 inside
        present = (vis.gt(0) & (away < REACH)).any(-1)
        vis = torch.where(away > 0, torch.zeros_like(vis), vis)
        rel = D["rel3d"]
        rel = torch.where(fl[:, None, None, None], rel[:, :, f21] * constant([-1.0, 1.0, 1.0], d), rel)
        ca, sa = a.cos()[:, None, None], a.sin()[:, None, None]
        rel = torch.stack([rel[..., 0] * ca - rel[..., 1] * sa, rel[..., 0] * sa + rel[..., 1] * ca, rel[..., 2]], -1)
        return Tiles(img, J, vis, rel, torch.where(present, size * z[:, None], 0.0), D["joints3d"][:, :, ROOT, 2])


class Rendered(Pool):
    """Scenes rendered on the device while training runs."""

    def __init__(self, gen: Generator, capacity: int, W: int = 512, H: int = 320, first: int = 64):
        self.gen, self.capacity = gen, capacity
        s = gen.render(min(first, capacity), W, H)
        data = {k: torch.empty(capacity, *getattr(s, k).shape[1:], dtype=getattr(s, k).dtype, device=gen.device) for k in FIELDS}
        super().__init__(data, len(s), int(gen.rng.integers(1 << 30)))
        self.at = len(s) % capacity
        self._put(s, 0)

    def _put(self, s: Scenes, at: int) -> None:
        for k, v in self.data.items():
            v[at : at + len(s)] = getattr(s, k)

    def refresh(self, n: int) -> None:
        n = min(n, self.capacity - self.at)
        self._put(self.gen.render(n, self.W, self.H), self.at)
        self.filled = max(self.filled, self.at + n)
        self.at = (self.at + n) % self.capacity


def clear(folder: pathlib.Path) -> None:
    """Makes `folder` one without scenes, so that new files are not taken for finished ones, or for open ones, by what was
    said of others."""
    folder.mkdir(parents=True, exist_ok=True)
    terms.unmark(folder)
    (folder / "filled").unlink(missing_ok=True)


class Stored(Pool):
    """Scenes rendered beforehand into a folder (`prerender.py`), mapped: several processes share one copy.

    The folder may still be filling up: `refresh` looks how far the writer has come.
    """

    def __init__(self, folder: pathlib.Path, seed: int, device: torch.device = CPU):
        """On another device than the CPU the scenes that are there are copied to it, and those that follow as `refresh`
        finds them. A folder without any ends the program."""
        self.folder = folder
        count = self._count()
        self.files = {k: torch.from_numpy(np.load(folder / f"{k}.npy", mmap_mode="c")) for k in FIELDS}
        data = self.files if device == CPU else {k: torch.empty_like(v, device=device) for k, v in self.files.items()}
        super().__init__(data, 0, seed)
        self._extend(count)

    def _count(self) -> int:
        if not (self.folder / "filled").exists():
            raise SystemExit(f"expected scenes in {self.folder}, found none that are written: run what makes them again (prerender.py, truth.py, carry.py)")
        return int((self.folder / "filled").read_text())

    def _extend(self, count: int) -> None:
        """Takes the scenes up to so many."""
        if self.data is not self.files:
            new = slice(self.filled, count)
            for k, v in self.data.items() if count > self.filled else ():
                v[new].copy_(self.files[k][new])
        self.filled = count

    def refresh(self, n: int) -> None:
        self._extend(self._count())
