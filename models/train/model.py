"""SelecSLS Net (XNect stage I: core, 2D head, 3D head) and the stage II network, in PyTorch.

Stage I input: RGB, x / 255 - 0.5, NCHW.  Output at stride 8; cell (r, c) is centred on pixel (8c + 3.5, 8r + 3.5), pixel centres
being integers.  Core parameter names follow the public SelecSLS-Pytorch repository.
Stage II input: 14 x (u, v, confidence, 63 encodings); output 21 x 3, metres relative to the pelvis, canonical stature.
"""

from __future__ import annotations

import torch
import torch.nn as nn
import torch.nn.functional as F
from torch import Tensor

from renorm import BatchRenorm2d
from skeleton import BONES_AT, NB, NJ, NL

# (in, skip, k, out, stride); skip == 0 marks the first module of a level
MODULES = [
    (32, 0, 64, 64, 2),
    (64, 64, 64, 128, 1),
    (128, 0, 128, 128, 2),
    (128, 128, 128, 128, 1),
    (128, 128, 128, 288, 1),
    (288, 0, 288, 288, 2),
    (288, 288, 288, 288, 1),
    (288, 288, 288, 288, 1),
    (288, 288, 288, 416, 1),
]
ENC = 3 * NB


def groups3(cout: int) -> int:
    return 4 if cout > 192 else 2 if cout > 96 else 1


class Conv2d(nn.Conv2d):
    """Convolution that can run its groups as one dense convolution with zeros off the diagonal blocks.

    GPUs are often slower on grouped convolutions than on a dense one with several times the arithmetic; train.py times both.
    `fake_quant` (set by quant.prepare) rounds weights as the int8 engine will.
    """

    dense = False
    fake_quant = None

    def forward(self, x: Tensor) -> Tensor:
        w = self.weight if self.fake_quant is None else self.fake_quant(self.weight)
        g = self.groups
        if g > 1 and self.dense:
            o, i, kh, kw = w.shape
            eye = torch.eye(g, device=w.device, dtype=w.dtype)
            w = (w.view(g, o // g, 1, i, kh, kw) * eye.view(g, 1, g, 1, 1, 1)).reshape(o, g * i, kh, kw)
            g = 1
        return F.conv2d(x, w, self.bias, self.stride, self.padding, 1, g)


class ConvTranspose2d(nn.ConvTranspose2d):
    dense = False
    fake_quant = None

    def forward(self, x: Tensor) -> Tensor:  # type: ignore[override]
        w = self.weight if self.fake_quant is None else self.fake_quant(self.weight)
        g = self.groups
        if g > 1 and self.dense:
            i, o, kh, kw = w.shape
            eye = torch.eye(g, device=w.device, dtype=w.dtype)
            w = (w.view(g, i // g, 1, o, kh, kw) * eye.view(g, 1, g, 1, 1, 1)).reshape(i, g * o, kh, kw)
            g = 1
        return F.conv_transpose2d(x, w, self.bias, self.stride, self.padding, 0, g)


def cbr(cin: int, cout: int, k: int, stride: int = 1, groups: int = 1) -> nn.Sequential:
    return nn.Sequential(Conv2d(cin, cout, k, stride, k // 2, groups=groups, bias=False), BatchRenorm2d(cout), nn.ReLU(inplace=True))


def up(cin: int, cout: int, groups: int) -> nn.Sequential:
    return nn.Sequential(ConvTranspose2d(cin, cout, 4, 2, 1, groups=groups, bias=False), BatchRenorm2d(cout), nn.ReLU(inplace=True))


class SelecSLSBlock(nn.Module):
    def __init__(self, cin: int, skip: int, k: int, cout: int, stride: int):
        super().__init__()
        self.first = skip == 0
        self.conv1 = cbr(cin, k, 3, stride, groups3(k))
        self.conv2 = cbr(k, k, 1)
        self.conv3 = cbr(k, k // 2, 3, 1, groups3(k // 2))
        self.conv4 = cbr(k // 2, k, 1)
        self.conv5 = cbr(k, k // 2, 3, 1, groups3(k // 2))
        self.conv6 = cbr(2 * k + skip, cout, 1)

    def forward(self, x: Tensor, skip: Tensor | None) -> tuple[Tensor, Tensor]:
        d1 = self.conv1(x)
        d2 = self.conv3(self.conv2(d1))
        d3 = self.conv5(self.conv4(d2))
        if self.first:
            out = self.conv6(torch.cat([d1, d2, d3], 1))
            return out, out
        assert skip is not None
        return self.conv6(torch.cat([d1, d2, d3, skip], 1)), skip


class Head2D(nn.Module):
    def __init__(self, nout: int = NJ + 2 * NL):
        super().__init__()
        self.reduce = cbr(416, 256, 1)
        self.up = up(256, 192, 4)
        self.conv1 = cbr(192, 128, 3)
        self.conv2 = cbr(128, 96, 3, 1, 4)
        self.out = Conv2d(96, nout, 3, 1, 1)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        f = self.conv1(self.up(self.reduce(x)))
        return self.out(self.conv2(f)), f


class Head3D(nn.Module):
    def __init__(self, nout: int = ENC):
        super().__init__()
        self.reduce = cbr(416, 256, 1)
        self.up = up(256, 192, 4)
        self.conv1 = cbr(192, 160, 3)
        self.conv2 = cbr(160 + 128, 160, 1)
        self.conv3 = cbr(160, 128, 3, 1, 4)
        self.out = Conv2d(128, nout, 3, 1, 1)

    def forward(self, x: Tensor, f: Tensor) -> Tensor:
        y = self.conv1(self.up(self.reduce(x)))
        return self.out(self.conv3(self.conv2(torch.cat([y, f], 1))))


class SelecSLSNet(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.stem = cbr(3, 32, 3, 2)
        self.features = nn.ModuleList(SelecSLSBlock(*m) for m in MODULES)
        self.head2d = Head2D()
        self.head3d = Head3D()
        for m in self.modules():
            if isinstance(m, nn.Conv2d):
                nn.init.kaiming_normal_(m.weight, mode="fan_out" if m.groups == 1 else "fan_in", nonlinearity="relu")
            elif isinstance(m, nn.ConvTranspose2d):
                fan = m.in_channels // m.groups * 4  # each output pixel receives (k/s)^2 = 4 taps of cin/groups channels
                nn.init.normal_(m.weight, std=(2.0 / fan) ** 0.5)
        for h in (self.head2d, self.head3d):
            nn.init.normal_(h.out.weight, std=0.01)
            nn.init.zeros_(h.out.bias)

    def forward(self, x: Tensor, first3d: int = 0) -> tuple[Tensor, Tensor]:
        """Heatmaps and PAFs [B, 40, h, w], encodings [B - first3d, 63, h, w] (metres, canonical stature) of the pictures from
        `first3d` on: pictures without 3D labels need not pay for the 3D head."""
        x, s = self.stem(x), None
        for f in self.features:
            x, s = f(x, s)
        y, f2 = self.head2d(x)
        return y, self.head3d(x[first3d:], f2[first3d:])

    def set_dense_groups(self, on: bool) -> None:
        for m in self.modules():
            if isinstance(m, (Conv2d, ConvTranspose2d)):
                m.dense = on


def channel_mask(device: torch.device | str = "cpu") -> Tensor:
    """[14, 63]: 1 where a channel is supervised at an evidence joint."""
    m = torch.zeros(NJ, NB, 3, device=device)
    for j, bones in enumerate(BONES_AT):
        m[j, bones] = 1
    return m.flatten(1)


class Stage2(nn.Module):
    """924 -> 384 -> 384 -> 384 -> 192 -> 63."""

    WIDTHS = [NJ * (3 + ENC), 384, 384, 384, 192]

    def __init__(self) -> None:
        super().__init__()
        w = self.WIDTHS
        for i in range(4):
            setattr(
                self, f"fc{i + 1}", nn.Sequential(nn.Linear(w[i], w[i + 1], bias=False), nn.BatchNorm1d(w[i + 1]), nn.ReLU(inplace=True))
            )
        self.fc5 = nn.Sequential(nn.Linear(w[4], ENC))
        for m in self.modules():
            if isinstance(m, nn.Linear):
                nn.init.kaiming_normal_(m.weight, nonlinearity="relu")
        nn.init.zeros_(self.fc5[0].bias)
        with torch.no_grad():
            self.fc5[0].weight.mul_(0.1)

    def forward(self, x: Tensor) -> Tensor:
        for i in range(1, 6):
            x = getattr(self, f"fc{i}")(x)
        return x.unflatten(-1, (NB, 3))


def stage2_input(uv: Tensor, conf: Tensor, enc: Tensor, mask: Tensor) -> Tensor:
    """uv [N, 14, 2] pixels, conf [N, 14] (0 = not seen), enc [N, 14, 63] -> [N, 924].

    (u, v) is relative to the neck (to the mean of the seen joints where the neck is missing) and divided by the RMS radius of the
    seen joints.  Channels that carry no supervision at a joint are zeroed here; export folds that into fc1's weights, so a caller at
    run time may feed the raw 63-vectors.
    """
    seen = (conf > 0).float()
    count = seen.sum(1).clamp_min(1)
    mean = (uv * seen[..., None]).sum(1) / count[:, None]
    origin = torch.where((conf[:, 1:2] > 0), uv[:, 1], mean)
    rel = (uv - origin[:, None]) * seen[..., None]
    rms = (rel.square().sum((1, 2)) / count).sqrt().clamp_min(1e-3)
    return torch.cat([rel / rms[:, None, None], conf[..., None], enc * mask * seen[..., None]], 2).flatten(1)
