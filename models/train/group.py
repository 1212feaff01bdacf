"""Peaks and people from the maps, simply: for evaluation only (the engine has its own, faster association)."""

from __future__ import annotations

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from skeleton import LIMBS, NECK, NJ, STRIDE


def refine(h: np.ndarray, y: int, x: int) -> tuple[float, float]:
    """Sub-cell position of a maximum, of the parabola through the logarithms, as in the program."""

    def off(a: float, b: float, c: float) -> float:
        d = a - 2 * b + c
        return float(np.clip(0.5 * (a - c) / d, -0.5, 0.5)) if d < -1e-6 else 0.0

    def level(y: int, x: int) -> float:
        return float(np.log(max(h[y, x], 0.01)))

    H, W = h.shape
    dx = off(level(y, x - 1), level(y, x), level(y, x + 1)) if 0 < x < W - 1 else 0.0
    dy = off(level(y - 1, x), level(y, x), level(y + 1, x)) if 0 < y < H - 1 else 0.0
    return x + dx, y + dy


def argmax_joints(hm: Tensor) -> np.ndarray:
    """Best position of every joint, [B, 14, 2] pixels: for pictures of one person."""
    a = hm.float().cpu().numpy()
    out = np.zeros((*a.shape[:2], 2), np.float32)
    for b in range(a.shape[0]):
        for j in range(a.shape[1]):
            y, x = np.unravel_index(a[b, j].argmax(), a.shape[2:])
            out[b, j] = refine(a[b, j], int(y), int(x))
    return out * STRIDE + (STRIDE - 1) / 2


def people(maps: Tensor, thr: float = 0.5, paf_thr: float = 0.25, min_joints: int = 8, neck_thr: float | None = None) -> list[np.ndarray]:
    """One picture's maps [40, h, w] -> people as [14, 3] (pixels, score; score 0 = absent).  People without a neck are dropped; `neck_thr` is its
    threshold, where it has one of its own."""
    m = maps.float()
    top = F.max_pool2d(m[None, :NJ], 3, 1, 1)[0]
    least = torch.full((NJ, 1, 1), thr)
    if neck_thr is not None:
        least[NECK] = neck_thr
    hm, paf, is_peak = m[:NJ].cpu().numpy(), m[NJ:].cpu().numpy(), ((m[:NJ] >= top) & (m[:NJ] > least.to(m.device))).cpu().numpy()
    H, W = hm.shape[1:]
    peaks = []
    for j in range(NJ):
        ys, xs = np.nonzero(is_peak[j])
        p = sorted(((*refine(hm[j], y, x), hm[j, y, x]) for y, x in zip(ys, xs)), key=lambda q: -q[2])[:24]
        peaks.append(np.array(p, np.float32).reshape(-1, 3))
    owner: list[dict[int, int]] = [{} for _ in range(NJ)]  # peak -> person
    out: list[np.ndarray] = []
    for root, (x, y, s) in enumerate(peaks[1]):  # the tree is rooted at the neck
        q = np.zeros((NJ, 3), np.float32)
        q[1] = x, y, s
        owner[1][root] = len(out)
        out.append(q)
    for limb, (c, p) in enumerate(LIMBS):  # parents come before children in this order
        cand = []
        for i, a in enumerate(peaks[c]):
            for k, who in owner[p].items():
                b = peaks[p][k]
                d = b[:2] - a[:2]
                L = float(np.hypot(*d))
                if L > 40:
                    continue
                u = d / max(L, 1e-3)
                t = np.linspace(0, 1, 10)
                at = np.clip(np.round(a[:2] + t[:, None] * d).astype(int), 0, [W - 1, H - 1])
                v = paf[2 * limb, at[:, 1], at[:, 0]] * u[0] + paf[2 * limb + 1, at[:, 1], at[:, 0]] * u[1]
                if (v.mean() > paf_thr and (v > 0.6 * paf_thr).mean() > 0.6) or L < 0.7:
                    cand.append((v.mean() + 0.1 * a[2], i, k, who))
        taken: set[int] = set()
        for _score, i, _k, who in sorted(cand, reverse=True):
            if i in owner[c] or who in taken:
                continue
            owner[c][i] = who
            taken.add(who)
            out[who][c] = peaks[c][i]
    keep = [q for q in out if (q[:, 2] > 0).sum() >= min_joints]
    for q in keep:
        q[:, :2] = q[:, :2] * STRIDE + (STRIDE - 1) / 2
    return keep
