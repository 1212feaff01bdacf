"""The network: its heads, teachers, normalisation, quantisation, and files of weights. No data needed."""

from __future__ import annotations

import json
import pathlib
import sys
import tempfile
import unittest

import torch

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path[:0] = [str(KIT), str(KIT / "tests")]

import export
import quant
import targets
import weights
from crowd import crowd
from distil import SEEN, Teachers, mirror_encodings, mirror_maps
from model import SelecSLSNet, Stage2, channel_mask, stage2_input
from renorm import LIMITS, BatchRenorm2d
from skeleton import BONES_AT, FLIP14, NB, NJ, ROOT
from stage2 import mirror3d


class Distillation(unittest.TestCase):
    WIDTH = 256

    def labels(self, j: torch.Tensor, rel: torch.Tensor) -> targets.Targets:
        seen, size = torch.ones(1, len(j[0]), NJ), torch.full((1, len(j[0])), 150.0)
        return targets.synthetic(j, seen, rel, size, size / 50, 40, self.WIDTH // 8)

    def test_maps_of_the_mirror_image_are_those_of_the_mirrored_people(self) -> None:
        j = crowd((70, 60), (180, 90))
        rel = torch.randn(1, 2, NB, 3, generator=torch.Generator().manual_seed(1))
        flipped = (j * torch.tensor([-1.0, 1.0]) + torch.tensor([self.WIDTH - 1.0, 0.0]))[:, :, FLIP14]
        here, there = self.labels(j, rel), self.labels(flipped, mirror3d(rel.flatten(0, 1)).view_as(rel))
        self.assertLess((mirror_maps(there.maps) - here.maps).abs().max(), 1e-4)
        self.assertLess((mirror_encodings(there.enc) - here.enc).abs().max(), 1e-4)
        self.assertGreater((there.maps - here.maps).abs().max(), 0.5)  # they do differ unmirrored

    def test_folded_and_together_the_teachers_say_the_mean(self) -> None:
        nets = []
        with tempfile.TemporaryDirectory() as d:
            files = [pathlib.Path(d) / f"{k}.safetensors" for k in range(2)]
            for k, f in enumerate(files):
                torch.manual_seed(k)
                net = SelecSLSNet().eval()
                for m in net.modules():
                    if isinstance(m, BatchRenorm2d):
                        m.running_mean.normal_(0, 0.1)
                        m.running_var.uniform_(0.5, 2)
                net.head2d.out.bias.data[:NJ] += SEEN * torch.arange(NJ) / 6  # some joints are seen, others not
                weights.write(f, export.slim(net.state_dict(), True), {})
                nets.append(net)
            teachers = Teachers(files, torch.device("cpu"), False)
        x = torch.rand(2, 3, 64, 96) - 0.5
        with torch.no_grad():
            plain = [net(x) for net in nets]
            other = [(mirror_maps(y), mirror_encodings(e)) for y, e in (net(x.flip(3)) for net in nets)]
        for turn in range(2):  # every network sees the mirror image every second time
            t = teachers.answer(x, turn)
            both = [plain[0], other[1]] if turn == 0 else [other[0], plain[1]]
            maps, enc = ((a + b) / 2 for a, b in zip(*both))
            self.assertLess((t.maps - maps).abs().max(), 1e-4)
            self.assertLess((t.enc - enc).abs().max(), 1e-4)
            seen = maps[:, :NJ] > SEEN
            self.assertTrue(0 < seen.sum() < seen.numel())
            for b in range(NB):
                want = torch.stack([seen[:, k] for k in range(NJ) if b in BONES_AT[k]]).any(0) if b != ROOT else torch.zeros_like(seen[:, 0])
                self.assertTrue(torch.equal(t.enc_weight[:, 3 * b] > 0, want))


class Files(unittest.TestCase):
    def test_weights_come_back(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            path = pathlib.Path(d) / "w.safetensors"
            net = SelecSLSNet().eval()
            weights.write(path, export.slim(net.state_dict(), f32=True), {"contract": json.dumps({"step": 3})})
            other = SelecSLSNet().eval()
            meta = weights.load_into(other, path)
            x = torch.randn(1, 3, 64, 64)
            with torch.no_grad():
                for a, b in zip(net(x), other(x)):
                    self.assertTrue(torch.equal(a, b))
            self.assertEqual(json.loads(meta["contract"]), {"step": 3})
            with self.assertRaises(SystemExit):
                weights.load_into(Stage2(), path)
            path.write_bytes(path.read_bytes()[:100])
            with self.assertRaises(SystemExit):
                weights.read(path)

    def test_unsupervised_channels_cannot_reach_the_answer(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            path = pathlib.Path(d) / "s.safetensors"
            export.export_stage2(Stage2().eval(), {"step": 1, "report": {}}, path, f32=True)
            s2 = Stage2()
            weights.load_into(s2, path)
            uv, conf, enc = torch.randn(5, NJ, 2) * 50, torch.rand(5, NJ), torch.randn(5, NJ, 63)
            with torch.no_grad():
                a, b = (s2.eval()(stage2_input(uv, conf, enc, m)) for m in (channel_mask(), torch.ones(NJ, 63)))
            self.assertTrue(torch.allclose(a, b, atol=1e-5))


class Network(unittest.TestCase):
    def test_skipping_the_3d_head_changes_nothing_else(self) -> None:
        net = SelecSLSNet().eval()
        x = torch.randn(3, 3, 64, 96)
        with torch.no_grad():
            y, e = net(x)
            y2, e2 = net(x, 2)
        self.assertEqual(tuple(y.shape), (3, 40, 8, 12))
        self.assertEqual(tuple(e2.shape), (1, 63, 8, 12))
        self.assertTrue(torch.allclose(y, y2, atol=1e-5) and torch.allclose(e[2:], e2, atol=1e-5))


class Normalisation(unittest.TestCase):
    def pair(self) -> tuple[BatchRenorm2d, torch.nn.BatchNorm2d]:
        torch.manual_seed(3)
        ours, theirs = BatchRenorm2d(5), torch.nn.BatchNorm2d(5)
        torch.nn.init.uniform_(theirs.weight, 0.5, 2)
        torch.nn.init.normal_(theirs.bias)
        ours.load_state_dict(theirs.state_dict())
        return ours, theirs

    def test_training_answers_as_the_running_statistics_do(self) -> None:
        ours, theirs = self.pair()
        ours.momentum = 0.5
        for _ in range(20):
            ours(torch.randn(8, 5, 12, 12) * 2 + 1)
        fixed = theirs.eval()
        fixed.load_state_dict(ours.state_dict())
        x = torch.randn(2, 5, 12, 12) * 4 - 1  # twice as wide as the others and shifted: within the limits
        self.assertLess(float((ours(x) - fixed(x)).abs().max()), 1e-4)
        theirs.train()
        self.assertGreater(float((theirs(x) - ours.eval()(x)).abs().max()), 1)

    def test_what_is_far_off_is_bounded(self) -> None:
        ours, _ = self.pair()
        y = (ours(100 * torch.randn(4, 5, 32, 32) + 1000) - ours.bias[:, None, None]) / ours.weight[:, None, None]
        self.assertAlmostEqual(float(y.std()), LIMITS[0], delta=0.02)
        self.assertAlmostEqual(float(y.mean()), LIMITS[1], delta=0.02)

    def test_statistics_and_fixed_answers_are_those_of_batch_normalisation(self) -> None:
        ours, theirs = self.pair()
        for _ in range(3):
            x = torch.randn(4, 5, 6, 6) * 3 + 2
            ours(x), theirs(x)
        for name in ("running_mean", "running_var"):
            self.assertLess(float((getattr(ours, name) - getattr(theirs, name)).abs().max()), 1e-5)
        self.assertLess(float((ours.eval()(x) - theirs.eval()(x)).abs().max()), 1e-5)

    def test_the_network_uses_it_everywhere(self) -> None:
        kinds = [type(m) for m in SelecSLSNet().modules() if isinstance(m, torch.nn.BatchNorm2d)]
        self.assertEqual(set(kinds), {BatchRenorm2d})


class FakeQuantisation(unittest.TestCase):
    def test_channels_have_ranges_of_their_own_and_7_bits(self) -> None:
        relu = quant.QuantReLU(3)
        x = torch.linspace(-1, 1, 4000).view(2, 1, 40, 50) * torch.tensor([8.0, 2.0, 0.0])[None, :, None, None]
        relu.train()(x)
        y = relu.eval()(x)
        # the layer's range, the mean of it and the channel's own, and next to nothing
        steps = torch.tensor([8.0, 4.0, 0.8]) / 127
        levels = y / steps[None, :, None, None]
        torch.testing.assert_close(levels, levels.round(), atol=1e-4, rtol=0)
        self.assertLessEqual(float((y - x.relu()).abs().amax((0, 2, 3)).sub(steps / 2).max()), 1e-6)
        self.assertEqual(len(y[:, 0].unique()), 128)
        self.assertEqual(float(y[:, 2].abs().max()), 0.0)

    def test_a_wild_picture_does_not_stretch_the_ranges(self) -> None:
        relu = quant.QuantReLU(2).train()
        x = torch.ones(5, 2, 4, 4) * torch.tensor([1.0, 0.5])[:, None, None]
        x[3] *= 50
        relu(x)
        self.assertEqual(relu.amax.tolist(), [1.0, 0.5])
        relu(x[:1] * 0.1)
        torch.testing.assert_close(relu.amax, torch.tensor([0.95, 0.475]))

    def test_pictures_that_are_no_numbers_leave_the_ranges_as_they_are(self) -> None:
        relu = quant.QuantReLU(2).train()
        x = torch.ones(5, 2, 4, 4) * torch.tensor([1.0, 0.5])[:, None, None]
        for bad in (torch.nan, torch.inf):
            x[3, 1, 2, 2] = bad
            relu(x)
            self.assertEqual(relu.amax.tolist(), [1.0, 0.5])
            relu(x[3:4])
            self.assertEqual(relu.amax.tolist(), [1.0, 0.5], "nothing was seen, so nothing is forgotten")

    def test_gradients_pass_what_is_rounded_and_not_what_is_clipped(self) -> None:
        relu = quant.QuantReLU(1)
        relu.amax.fill_(1.0)
        x = torch.tensor([-0.5, 0.3, 1.5]).view(1, 1, 1, 3).requires_grad_()
        relu.eval()(x).sum().backward()
        self.assertEqual(x.grad.flatten().tolist(), [0.0, 1.0, 0.0])

    def test_every_activation_of_the_network_is_rounded_and_comes_back(self) -> None:
        torch.manual_seed(4)
        net = quant.prepare(SelecSLSNet())
        self.assertFalse([n for n, m in net.named_modules() if isinstance(m, torch.nn.ReLU)])
        net.train()(torch.rand(2, 3, 64, 64) - 0.5)
        ranges = quant.ranges(net)
        self.assertTrue(all(r > 0 for r in ranges.values()))
        other = quant.prepare(SelecSLSNet())
        other.load_state_dict(net.state_dict())
        self.assertEqual(quant.ranges(other), ranges)


if __name__ == "__main__":
    unittest.main()
