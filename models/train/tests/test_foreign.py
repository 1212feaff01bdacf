"""Weights of others: checkpoints to safetensors, public backbones to a start.  No data needed."""

from __future__ import annotations

import contextlib
import io
import json
import pathlib
import sys
import tempfile
import unittest

import torch

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(KIT))

import backbone
import convert
import weights
from model import Conv2d, SelecSLSNet


def public() -> dict[str, torch.Tensor]:
    """A state dict as the public repository has it: the core with dense convolutions, a classifier, counters."""
    net, out = SelecSLSNet(), {}
    for name, module in net.named_modules():
        if name.startswith(("stem", "features")) and isinstance(module, Conv2d):
            o, i, h, w = module.weight.shape
            out[f"{name}.weight"] = torch.randn(o, i * module.groups, h, w) * 0.1
    for name, value in net.state_dict().items():
        if name.startswith(("stem", "features")) and name not in out:
            noise = torch.rand_like(value) + 0.5 if value.is_floating_point() else value
            out[name] = noise
    out["head.0.0.weight"], out["classifier.0.weight"] = torch.randn(756, 416, 3, 3), torch.randn(1000, 1280)
    return out


class Foreign(unittest.TestCase):
    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        torch.manual_seed(7)

    def quietly(self, call, *args) -> str:
        with contextlib.redirect_stdout(io.StringIO()) as said:
            call(*args)
        return said.getvalue()

    def test_a_checkpoint_becomes_safetensors_with_its_contract(self) -> None:
        net = SelecSLSNet()
        wrapped = {"epoch": 3, "state_dict": {f"module.{k}": v for k, v in net.state_dict().items()}}
        torch.save(wrapped, self.folder / "best.pth")
        (self.folder / "contract.json").write_text(json.dumps({"stride": 8}))
        out = self.folder / "out.safetensors"
        said = self.quietly(convert.main, self.folder / "best.pth", self.folder / "contract.json", out)
        self.assertIn(f"model import {out} --arch", said)
        meta = weights.load_into(SelecSLSNet(), out)
        self.assertEqual(json.loads(meta["contract"]), {"stride": 8})
        # Stage II's contract tells what comes out.
        (self.folder / "stage2.json").write_text(json.dumps({"output": "63"}))
        said = self.quietly(convert.main, self.folder / "best.pth", self.folder / "stage2.json", out)
        self.assertIn(f"model import STAGE1 --stage2 {out} --check", said)
        torch.save([1, 2], self.folder / "list.pt")
        with self.assertRaisesRegex(SystemExit, "found no tensors by name"):
            convert.main(self.folder / "list.pt", self.folder / "contract.json", out)

    def test_a_public_backbone_is_a_start(self) -> None:
        dense, net = public(), SelecSLSNet()
        heads = {k: v.clone() for k, v in net.state_dict().items() if k.startswith("head")}
        torch.save(dense, self.folder / "SelecSLS60_statedict.pth")
        said = self.quietly(backbone.start, net, self.folder / "SelecSLS60_statedict.pth")
        self.assertIn("heads start anew", said)
        own = net.state_dict()
        for name, value in heads.items():
            self.assertTrue(torch.equal(own[name], value), name)
        # A convolution without groups is taken as it is, one of two groups by its blocks.
        same, halves = "features.0.conv2.0.weight", "features.2.conv1.0.weight"
        self.assertTrue(torch.equal(own[same], dense[same]))
        half = dense[halves].shape[1] // 2
        torch.testing.assert_close(own[halves][:64], dense[halves][:64, :half] * 2**0.5)
        torch.testing.assert_close(own[halves][64:], dense[halves][64:, half:] * 2**0.5)
        self.assertTrue(torch.equal(own["features.8.conv6.1.running_var"], dense["features.8.conv6.1.running_var"]))

    def test_the_first_convolution_answers_our_pictures_as_theirs(self) -> None:
        dense, net = public(), SelecSLSNet().eval()
        torch.save(dense, self.folder / "b.pth")
        self.quietly(backbone.start, net, self.folder / "b.pth")
        picture = torch.rand(1, 3, 32, 32)
        mean, deviation = (torch.tensor(v).view(1, 3, 1, 1) for v in (backbone.MEAN, backbone.DEVIATION))
        with torch.no_grad():
            ours = net.stem(picture - 0.5)
            y = torch.nn.functional.conv2d((picture - mean) / deviation, dense["stem.0.weight"], None, 2, 1)
            norm = [dense[f"stem.1.{k}"] for k in ("running_mean", "running_var", "weight", "bias")]
            theirs = torch.nn.functional.batch_norm(y, *norm).relu()
        # Beyond the border theirs saw the mean and ours sees grey.
        torch.testing.assert_close(ours[..., 1:, 1:], theirs[..., 1:, 1:], rtol=1e-4, atol=1e-4)

    def test_timm_safetensors_and_our_own_are_told_apart(self) -> None:
        net, other = SelecSLSNet(), SelecSLSNet()
        floats = {k: v for k, v in public().items() if v.is_floating_point()}
        weights.write(self.folder / "timm.safetensors", floats, {})
        self.assertIn("heads start anew", self.quietly(backbone.start, net, self.folder / "timm.safetensors"))
        own = {k: v for k, v in net.state_dict().items() if v.is_floating_point()}
        weights.write(self.folder / "own.safetensors", own, {})
        self.assertEqual(self.quietly(backbone.start, other, self.folder / "own.safetensors"), "")
        self.assertTrue(torch.equal(other.head3d.out.weight, net.head3d.out.weight))

    def test_other_sizes_and_fused_ones_are_refused(self) -> None:
        dense = public()
        dense["features.1.conv6.0.weight"] = torch.zeros(144, 192, 1, 1)
        torch.save(dense, self.folder / "84.pth")
        with self.assertRaisesRegex(SystemExit, "expected SelecSLS-60, found features.1.conv6.0.weight"):
            backbone.start(SelecSLSNet(), self.folder / "84.pth")
        fused = {k: v for k, v in public().items() if ".1." not in k}
        torch.save(fused, self.folder / "fused.pth")
        with self.assertRaisesRegex(SystemExit, "not one that was pruned or fused"):
            backbone.start(SelecSLSNet(), self.folder / "fused.pth")


if __name__ == "__main__":
    unittest.main()
