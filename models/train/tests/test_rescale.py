"""Weights that have grown, scaled back. No data needed."""

from __future__ import annotations

import pathlib
import sys
import unittest

import torch

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(KIT))

from model import SelecSLSNet
from rescale import GROWN, channels, rescale


class Rescaled(unittest.TestCase):
    def test_answers_stay_and_grown_channels_are_as_large_as_others(self) -> None:
        torch.manual_seed(3)
        net = SelecSLSNet()
        pairs = {"features.6.conv5": [0, 5], "head2d.up": [1, 130], "head3d.conv3": [40]}
        for norm in net.modules():
            if isinstance(norm, torch.nn.BatchNorm2d):
                norm.running_mean.normal_()
                norm.running_var.uniform_(0.5, 2)
        x = torch.rand(1, 3, 64, 64) - 0.5
        with torch.no_grad():
            expected = net.eval()(x)
        for name, grown in pairs.items():
            conv, norm = net.get_submodule(name)[0], net.get_submodule(name)[1]
            by = torch.ones(len(norm.running_mean))
            by[grown] = 1000.0
            view = channels(conv, conv.weight.data)
            view = view * by.view(-1, *[1] * (view.ndim - 1))
            if isinstance(conv, torch.nn.ConvTranspose2d):
                view = view.unflatten(0, (conv.groups, -1)).transpose(1, 2).flatten(0, 1)
            conv.weight.data.copy_(view)
            norm.running_mean.mul_(by)
            norm.running_var.mul_(by.square())
        self.assertEqual(rescale(net), {f"{name}.0": len(grown) for name, grown in pairs.items()})
        with torch.no_grad():
            found = net(x)
        for a, b in zip(expected, found):
            self.assertLess(float((a - b).abs().max()), 1e-4 * float(a.abs().max()))
        for name in pairs:
            conv = net.get_submodule(name)[0]
            size = channels(conv, conv.weight.data).flatten(1).square().mean(1).sqrt()
            self.assertLess(float(size.max()), GROWN)
        self.assertEqual(rescale(net), {}, "nothing is left to do")


if __name__ == "__main__":
    unittest.main()
