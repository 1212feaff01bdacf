"""Errors of 3D poses, and the baseline that Stage II must beat."""

from __future__ import annotations

import torch
from torch import Tensor

from skeleton import JOINTS_OF_BONE, NB, NJ, PARENTS21, ROOT, TOPO21


def procrustes(a: Tensor, b: Tensor) -> Tensor:
    """a aligned to b by a similarity, batched [n, 21, 3]."""
    ma, mb = a.mean(1, keepdim=True), b.mean(1, keepdim=True)
    A, B = a - ma, b - mb
    U, S, Vt = torch.linalg.svd(A.transpose(1, 2) @ B)
    sign = torch.det(U @ Vt).sign()
    D = torch.ones_like(S)
    D[:, 2] = sign
    R = (U * D[:, None]) @ Vt
    s = (S * D).sum(1) / A.square().sum((1, 2)).clamp_min(1e-9)
    return s[:, None, None] * A @ R + mb


def errors(pred: Tensor, rel: Tensor) -> dict[str, float]:
    """Millimetres at canonical stature, joints relative to the pelvis."""
    e = (pred - rel).norm(dim=-1) * 1000
    pa = (procrustes(pred, rel) - rel).norm(dim=-1).mean() * 1000
    t = torch.arange(0, 151, 5, device=e.device)
    auc = (e[:, :14].flatten()[:, None] < t).float().mean()
    return dict(mpjpe=e.mean().item(), pa_mpjpe=pa.item(), pck150=(e[:, :14] < 150).float().mean().item() * 100, auc=auc.item() * 100)


def naive(conf: Tensor, enc: Tensor) -> Tensor:
    """Baseline: chain the bones read off the encodings (first joint seen that carries the bone), zeros where unseen."""
    n = len(conf)
    e = enc.view(n, NJ, NB, 3)
    out = [torch.zeros(n, 3, device=conf.device) for _ in range(NB)]
    for b in TOPO21:
        if b == ROOT:
            continue
        js = JOINTS_OF_BONE[b]
        wgt = (conf[:, js] > 0).float()
        v = (e[:, js, b] * wgt[..., None]).sum(1) / wgt.sum(1, keepdim=True).clamp_min(1)
        out[b] = out[PARENTS21[b]] + v
    return torch.stack(out, 1)
