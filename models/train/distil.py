"""What several networks say together, as labels: Stage I learns the mean that it would take `--flip-test` and several models to see.

Labels say nothing of bystanders, of joints that nobody marked, or of the depth of most photos' people; the teachers answer everywhere.
Their depth is too shallow, so they are silent about it where better is to be had (`leave_depth`).
"""

from __future__ import annotations

import pathlib

import torch
import torch.nn.functional as F
from torch import Tensor, nn

import targets
import weights
from model import SelecSLSNet, channel_mask
from skeleton import FLIP14, FLIP21, LIMBS, NB, NJ, NL

SEEN = 0.3  # a joint map this high says that the encodings are to be read here
ROUND = 2  # cells round those where labels lend encodings: teachers see a joint there, too


def mirror_maps(y: Tensor) -> Tensor:
    """Heatmaps and part affinity fields [B, 40, h, w] of the mirror image, as those of the picture (and the other way round)."""
    joints, fields = y[:, :NJ], y[:, NJ:].unflatten(1, (NL, 2))
    other = [LIMBS.index((FLIP14[a], FLIP14[b])) for a, b in LIMBS]
    fields = fields[:, other] * torch.tensor([-1.0, 1.0], device=y.device)[:, None, None]
    return torch.cat([joints[:, FLIP14], fields.flatten(1, 2)], 1).flip(3)


def mirror_encodings(e: Tensor) -> Tensor:
    """Encodings [B, 63, h, w] of the mirror image, as those of the picture (and the other way round)."""
    left = torch.tensor([-1.0, 1.0, 1.0], device=e.device)[:, None, None]
    return (e.unflatten(1, (NB, 3))[:, FLIP21] * left).flatten(1, 2).flip(3)


def fold(net: SelecSLSNet) -> SelecSLSNet:
    """Batch norm folded into the convolutions before it, which answer the same in less time."""
    for block in net.modules():
        if isinstance(block, nn.Sequential) and isinstance(block[0], nn.Conv2d) and isinstance(block[1], nn.BatchNorm2d):
            conv, bn = block[0], block[1]
            assert bn.running_mean is not None and bn.running_var is not None
            w, b = torch.nn.utils.fusion.fuse_conv_bn_weights(
                conv.weight, conv.bias, bn.running_mean, bn.running_var, bn.eps, bn.weight, bn.bias
            )
            conv.weight, conv.bias = w, b
            block[1] = nn.Identity()
    return net


def leave_depth(t: targets.Targets, labels: targets.Targets, lends: bool) -> None:
    """Take out of the teachers' answers `t` what better labels say: every encoding of rendered tiles, which come after the real ones (those of
    `labels`). Where people of real tiles lend depth (`lends`) the teachers are silent about the depth of all real people, since theirs is 0.35
    to 0.6 of a bone's and would hold the others' back, and about all of a bone in and round the cells where labels lend it."""
    n = len(labels.maps)
    t.enc_weight[n:] = 0
    if lends:
        t.enc_weight[:n] *= 1 - F.max_pool2d(labels.enc_weight, 2 * ROUND + 1, 1, ROUND)
        t.enc_weight[:n, 2::3] = 0


class Teachers:
    """Networks that answer together; every second one is shown the mirror image, which one changes from turn to turn."""

    def __init__(self, files: list[pathlib.Path], dev: torch.device, bf16: bool):
        self.bf16 = bf16
        self.reads = (channel_mask(dev) > 0).float()  # [14, 63]
        self.nets = []
        for f in files:
            net = SelecSLSNet().to(dev, memory_format=torch.channels_last)
            weights.load_into(net, f)
            self.nets.append(fold(net.eval()).requires_grad_(False))

    @torch.no_grad()
    def answer(self, x: Tensor, turn: int) -> targets.Targets:
        """Targets of the pictures x [B, 3, H, W] as the network takes them: maps count everywhere, encodings where a joint
        is seen. `turn` counts the questions about pictures of their kind: in odd ones the other networks see the mirror
        image."""
        answers = []
        for k, net in enumerate(self.nets):
            other = (k + turn) % 2 == 1
            with torch.autocast(x.device.type, torch.bfloat16, enabled=self.bf16):
                y, e = net(x.flip(3) if other else x)
            y, e = y.float(), e.float()
            answers.append((mirror_maps(y), mirror_encodings(e)) if other else (y, e))
        maps, enc = (torch.stack(a).mean(0) for a in zip(*answers))
        seen = (maps[:, :NJ] > SEEN).float()
        read = torch.einsum("bjhw,jc->bchw", seen, self.reads).clamp_max(1)
        return targets.Targets(maps, torch.ones_like(maps), enc, read)
