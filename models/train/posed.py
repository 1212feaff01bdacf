"""People of `edgecap synth --stills --truth-only`, without pictures: poses that motion capture has few of, such as squats, lunges, sitting, kneeling,
lying, and whatever joints allow, in front of the cameras that the stills have."""

from __future__ import annotations

import pathlib

import torch
from torch import Tensor

from body import canonical
from skeleton import FLIP14, FLIP21, NECK, NJ, ROOT
from truth import load

LEAST = 4  # joints inside the picture, the neck among them: fewer are not reported
HELD = 16  # every so many are measured with


class Posed:
    """n people: `uv` [n, 14, 2] pixels, `rel` [n, 21, 3] metres about the pelvis at canonical stature, view-aligned, `size` [n] stature in pixels,
    `inside` bool [n, 14]: joints in the picture."""

    def __init__(self, truth: pathlib.Path, device: torch.device, seed: int):
        people = [(f["camera"]["fx"], p) for f in load(truth)["frames"] for p in f["people"]]
        if len(people) <= HELD:
            raise SystemExit(f"expected more than {HELD} people in {truth}, found {len(people)}: write it with edgecap synth --stills --truth-only")
        cam = torch.tensor([p["joints3d"] for _, p in people], dtype=torch.float32)
        stature = torch.tensor([p["stature"] for _, p in people])
        uv = torch.tensor([p["joints2d"][:NJ] for _, p in people], dtype=torch.float32)
        inside = torch.tensor([p["visibility"][:NJ] for _, p in people]) > 0
        size = torch.tensor([f for f, _ in people]) * stature / cam[:, ROOT, 2].clamp_min(0.3)
        ok = (cam[:, :, 2].amin(1) > 0.3) & inside[:, NECK] & (inside.sum(1) >= LEAST)
        self.uv, self.rel, self.size, self.inside = (t[ok].to(device) for t in (uv, canonical(cam, stature), size, inside))
        if len(self) <= HELD:
            raise SystemExit(f"expected more than {HELD} people of {LEAST} joints in the picture in {truth}, found {len(self)}: write more --frames")
        self.drawn = (torch.arange(len(self), device=device) % HELD).nonzero()[:, 0]
        self.g = torch.Generator(device=device).manual_seed(seed)

    def __len__(self) -> int:
        return len(self.uv)

    def held(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Those that `sample` never draws."""
        return tuple(t[::HELD] for t in (self.uv, self.rel, self.size, self.inside))  # type: ignore[return-value]

    def sample(self, n: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """`uv`, `rel`, `size` and `inside` of n people, every second as in a mirror."""
        d = self.uv.device
        i = self.drawn[torch.randint(len(self.drawn), (n,), generator=self.g, device=d)]
        uv, rel, size, inside = (t[i] for t in (self.uv, self.rel, self.size, self.inside))
        m = torch.rand(n, 1, 1, generator=self.g, device=d) < 0.5
        left = torch.tensor([-1.0, 1.0, 1.0], device=d)
        uv, rel = torch.where(m, uv[:, FLIP14] * left[:2], uv), torch.where(m, rel[:, FLIP21] * left, rel)
        return uv, rel, size, torch.where(m[..., 0], inside[:, FLIP14], inside)
