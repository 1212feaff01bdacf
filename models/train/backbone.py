"""Public SelecSLS backbones as a start: weights of SelecSLS-60 trained on ImageNet, of github.com/mehtadushy/SelecSLS-Pytorch or of
timm (`selecsls60`, `selecsls60b`), whose names of the core are ours.

Their 3x3 convolutions are dense, ours have groups: each group keeps its own block of the dense weights, made as strong as the whole
was.  Their pictures are normalised by ImageNet's mean and deviation: that goes into the first convolution.  Their classifier goes,
the heads start anew.  What groups lose, training has to learn again.
"""

from __future__ import annotations

import pathlib

import torch
from torch import Tensor

import weights
from convert import state_dict
from model import SelecSLSNet

MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
CORE = ("stem.", "features.")


def start(net: SelecSLSNet, path: pathlib.Path) -> None:
    """Fill a network from our own safetensors, or its core from a public backbone (`.pth`, or safetensors without heads)."""
    is_ours = path.suffix == ".safetensors"
    tensors = weights.read(path)[0] if is_ours else state_dict(path)
    if is_ours and any(k.startswith("head2d.") for k in tensors):
        weights.load_into(net, path)
        return
    core = fitted(net, {k: v for k, v in tensors.items() if k.startswith(CORE)}, path)
    net.load_state_dict(core, strict=False)
    print(f"the core is that of {path.name}, the heads start anew", flush=True)


def fitted(net: SelecSLSNet, dense: dict[str, Tensor], path: pathlib.Path) -> dict[str, Tensor]:
    """The core of a public backbone in the shapes of ours."""
    own = {k: v for k, v in net.state_dict().items() if k.startswith(CORE) and not k.endswith("num_batches_tracked")}
    missing = sorted(set(own) - set(dense))
    if missing:
        raise SystemExit(
            f"{path}: expected the tensors of SelecSLS-60's core, missing {len(missing)}, first {missing[0]}: take the plain "
            "state dict, not one that was pruned or fused"
        )
    core = {k: blocks(dense[k].float(), own[k]) for k in own}
    wrong = [k for k in own if core[k].shape != own[k].shape]
    if wrong:
        k = wrong[0]
        raise SystemExit(
            f"{path}: expected SelecSLS-60, found {k} of shape {list(dense[k].shape)}, not {list(own[k].shape)}: other sizes have "
            "other channels"
        )
    # The backbone saw (p - MEAN) / DEVIATION of p in 0..1, ours sees p - 0.5.
    mean, deviation = (torch.tensor(v).view(1, 3, 1, 1) for v in (MEAN, DEVIATION))
    core["stem.1.running_mean"] = core["stem.1.running_mean"] - (core["stem.0.weight"] * (0.5 - mean) / deviation).sum((1, 2, 3))
    core["stem.0.weight"] = core["stem.0.weight"] / deviation
    return core


def blocks(dense: Tensor, own: Tensor) -> Tensor:
    """The blocks on the diagonal of a dense convolution's weights, where ours has groups."""
    if dense.ndim != 4 or dense.shape == own.shape or own.ndim != 4 or dense.shape[1] % own.shape[1]:
        return dense
    groups = dense.shape[1] // own.shape[1]
    if dense.shape[0] % groups:
        return dense
    rows, columns = dense.shape[0] // groups, own.shape[1]
    kept = [dense[g * rows : (g + 1) * rows, g * columns : (g + 1) * columns] for g in range(groups)]
    # Fewer inputs add up to less: variances add, deviations are their root.
    return torch.cat(kept) * groups**0.5
