"""Weights that have grown beyond use, back at the size of others: python rescale.py STAGE1.safetensors OUT.safetensors.

Batch normalisation behind a convolution hides how large its weights are: answers stay the same, but steps of a usual rate no longer move weights of
a thousand times the usual size. Every output channel is scaled by itself, with the statistics behind it.
"""

from __future__ import annotations

import argparse
import pathlib
import sys

import torch
from torch import Tensor, nn

import weights
from model import SelecSLSNet

GROWN = 0.5  # root mean square of a channel's weights; those of healthy layers have 0.03 to 0.3
USUAL = 0.1


def channels(conv: nn.Module, w: Tensor) -> Tensor:
    """A view of the weights in which the first dimension is the output channel."""
    if isinstance(conv, nn.ConvTranspose2d):
        groups = conv.groups
        return w.unflatten(0, (groups, -1)).transpose(1, 2).flatten(0, 1)
    return w


def rescale(net: nn.Module) -> dict[str, int]:
    """Scales grown channels of every convolution with a batch norm behind it; how many, by the convolution's name."""
    found = {}
    for name, pair in net.named_modules():
        if not isinstance(pair, nn.Sequential) or len(pair) < 2 or not isinstance(pair[1], nn.BatchNorm2d):
            continue
        conv, norm = pair[0], pair[1]
        w = conv.weight.data
        size = channels(conv, w).flatten(1).square().mean(1).sqrt()
        by = torch.where(size > GROWN, USUAL / size, 1.0)
        if isinstance(conv, nn.ConvTranspose2d):
            w.unflatten(0, (conv.groups, -1)).mul_(by.view(conv.groups, 1, -1, 1, 1))
        else:
            w.mul_(by[:, None, None, None])
        norm.running_mean.mul_(by)
        norm.running_var.mul_(by.square())
        if (size > GROWN).any():
            found[f"{name}.0"] = int((size > GROWN).sum())
    return found


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("stage1", type=pathlib.Path)
    ap.add_argument("out", type=pathlib.Path)
    a = ap.parse_args(argv)
    net = SelecSLSNet()
    meta = weights.load_into(net, a.stage1)
    for name, count in rescale(net).items():
        print(f"{name}: {count} channels")
    kept = weights.read(a.stage1)[0]
    weights.write(a.out, {k: v for k, v in net.state_dict().items() if k in kept}, meta)


if __name__ == "__main__":
    main(sys.argv[1:])
