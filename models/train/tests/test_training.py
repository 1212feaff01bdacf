"""A training run: its optimiser, its clock, its processes. No data needed."""

from __future__ import annotations

import os
import pathlib
import subprocess
import sys
import tempfile
import unittest
from unittest import mock

import numpy as np
import torch

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(KIT))

import checkpoint
import clock
import muon
from muon import Muon, orthogonal


class Optimiser(unittest.TestCase):
    def test_updates_keep_directions_and_lose_strengths(self) -> None:
        torch.manual_seed(3)
        for shape in ((2, 24, 40), (1, 40, 24), (3, 16, 200), (2, 96, 8)):
            m = torch.randn(shape)
            u, strengths, vt = torch.linalg.svd(m, full_matrices=False)
            self.assertGreater(float((strengths[:, 0] / strengths[:, -1]).min()), 1.5)
            o = orthogonal(m).float()
            inside = u.mT @ o @ vt.mT  # diagonal where the singular vectors are the same
            kept = inside.diagonal(dim1=1, dim2=2)
            self.assertTrue(bool(((kept > 0.6) & (kept < 1.3)).all()), kept)
            self.assertLess(float((inside - torch.diag_embed(kept)).abs().max()), 0.05)

    def test_updates_stay_small_where_most_directions_are_weak(self) -> None:
        torch.manual_seed(5)
        for shape in ((2, 64, 288), (4, 24, 288), (1, 24, 30)):
            for weakest in (1e-2, 1e-4, 1e-6, 0.0):
                u, strengths, vt = torch.linalg.svd(torch.randn(shape), full_matrices=False)
                strengths = torch.logspace(0, -6, shape[1]).clamp_min(weakest) * (torch.arange(shape[1]) < (3 if weakest == 0 else shape[1]))
                for fast in (True, False):
                    with mock.patch.object(muon, "bf16_pays", lambda _, fast=fast: fast):
                        o = orthogonal(u * strengths @ vt).float()
                    self.assertLess(float(torch.linalg.svdvals(o).max()), 1.3, (shape, weakest, fast))

    def _two_layers(self) -> tuple[torch.nn.Sequential, Muon]:
        torch.manual_seed(4)
        net = torch.nn.Sequential(torch.nn.Conv2d(8, 8, 3, padding=1, groups=2), torch.nn.Conv2d(8, 4, 1))
        net = net.to(memory_format=torch.channels_last)
        first = net[0].weight
        rest = [p for p in net.parameters() if p is not first]
        return net, Muon([(first, 2)], [dict(params=rest, weight_decay=0.0)], lr=0.02, wd=0.0, fused=True)

    def _fit(self, net: torch.nn.Sequential, opt: torch.optim.Optimizer, steps: int) -> float:
        torch.manual_seed(5)
        x, y = torch.randn(4, 8, 6, 6), torch.randn(4, 4, 6, 6)
        for _ in range(steps):
            opt.zero_grad()
            loss = (net(x) - y).square().mean()
            loss.backward()
            opt.step()
        return float(loss.detach())

    def test_every_parameter_learns(self) -> None:
        net, opt = self._two_layers()
        before = [p.detach().clone() for p in net.parameters()]
        start, end = self._fit(net, opt, 1), self._fit(net, opt, 60)
        self.assertLess(end, 0.8 * start)
        for p, was in zip(net.parameters(), before):
            self.assertGreater(float((p.detach() - was).abs().max()), 1e-3)

    def test_a_step_is_as_long_as_the_rate_says(self) -> None:
        net, opt = self._two_layers()
        was = net[0].weight.detach().clone()
        self._fit(net, opt, 1)
        length = float((net[0].weight.detach() - was).square().mean().sqrt())
        self.assertAlmostEqual(length, 0.02 * 0.2, delta=0.02 * 0.2 * 0.25)

    def test_the_momentum_survives_a_checkpoint(self) -> None:
        net, opt = self._two_layers()
        self._fit(net, opt, 5)
        with tempfile.TemporaryDirectory() as d:
            folder = pathlib.Path(d) / "ckpt"
            checkpoint.save(folder, net, net, opt, {"step": 5})
            other, again = self._two_layers()
            checkpoint.load(folder, other, other, again, torch.device("cpu"))
            third, cold = self._two_layers()
            checkpoint.load(folder, third, third, None, torch.device("cpu"))
        for p, q in zip(net.parameters(), other.parameters()):
            self.assertEqual(set(opt.state[p]), set(again.state[q]))
            m = opt.state[p]["exp_avg"]
            self.assertLess(float((m - again.state[q]["exp_avg"]).abs().max()), 1e-3 * float(m.abs().max()))
        on, taken_up, forgotten = self._fit(net, opt, 4), self._fit(other, again, 4), self._fit(third, cold, 4)
        self.assertLess(abs(taken_up - on), 0.2 * abs(forgotten - on))

    def test_a_run_goes_on_with_either_optimizer(self) -> None:
        net, opt = self._two_layers()
        self._fit(net, opt, 5)
        with tempfile.TemporaryDirectory() as d:
            folder = pathlib.Path(d) / "ckpt"
            checkpoint.save(folder, net, net, opt, {"step": 5})
            other, _ = self._two_layers()
            adam = torch.optim.AdamW(other.parameters(), lr=1e-3, fused=True)
            checkpoint.load(folder, other, other, adam, torch.device("cpu"))
            self.assertNotIn(other[0].weight, adam.state, "the momentum alone is no state of Adam's")
            self.assertIn(other[1].weight, adam.state)
            before = other[0].weight.detach().clone()
            self._fit(other, adam, 3)
            self.assertGreater(float((other[0].weight.detach() - before).abs().max()), 0)
            checkpoint.save(folder, other, other, adam, {"step": 8})
            third, back = self._two_layers()
            checkpoint.load(folder, third, third, back, torch.device("cpu"))
        self.assertEqual(set(back.state[third[0].weight]), {"exp_avg"})
        self._fit(third, back, 1)


class Time(unittest.TestCase):
    def seconds(self, *gaps: float) -> float:
        """What counts of a run whose start takes the first of these gaps and whose steps take the others."""
        at = iter(np.cumsum([1000.0, *gaps]).tolist())
        with mock.patch("clock.time.monotonic", lambda: next(at)):
            c = clock.Clock()
            c.whole()
            for _ in gaps[1:]:
                c.step()
        return c.seconds

    def test_of_a_pause_no_more_counts_than_a_step_may_take(self) -> None:
        self.assertEqual(self.seconds(500, 1, 1, 1), 503)
        self.assertEqual(self.seconds(500, 1, 1, 40000, 1), 503 + clock.ALLOWED)
        self.assertEqual(self.seconds(0, 30, 30, 30, 40000, 30), 120 + 30 * clock.LONGEST)
        self.assertEqual(self.seconds(0, 1, 1, clock.ALLOWED, 1), 3 + clock.ALLOWED, "algorithms that are chosen are no pause")


class Ranks(unittest.TestCase):
    def test_two_processes_agree(self) -> None:
        code = (
            "import torch, ranks\n"
            "children = ranks.launch(2)\n"
            "g = ranks.Group(2)\n"
            "t = [torch.full((3,), 1.0 + 2 * g.rank), torch.full((2, 2), 4.0 * g.rank)]\n"
            "g.average(t)\n"
            "assert g.same([7.0 + g.rank]) == [7.0]\n"
            "assert t[0].tolist() == [2.0] * 3 and t[1].flatten().tolist() == [2.0] * 4, t\n"
            "print('agreed', flush=True)\n"
            "[c.wait() for c in children]\n"
        )
        with tempfile.TemporaryDirectory() as d:
            script = pathlib.Path(d) / "two.py"
            script.write_text(code)
            env = os.environ | {"PYTHONPATH": str(KIT)}
            r = subprocess.run([sys.executable, str(script)], env=env, capture_output=True, text=True, timeout=120, check=False)
        self.assertEqual(r.stdout.count("agreed"), 2, r.stderr)


if __name__ == "__main__":
    unittest.main()
