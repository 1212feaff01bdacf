"""Muon: momentum made orthogonal for the weights of hidden convolutions (Jordan et al. 2024; scale of Liu et al. 2025), AdamW for the rest.

Adam moves a few strong directions of a weight matrix again and again; equal singular values move all of them. What that brings here
is in README.md, On a CPU.
"""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import torch
from torch import Tensor, nn

from precision import bf16_pays

STEPS = 5
# Jordan's quintic: singular values end between 0.66 and 1.2, which serves as well as 1 and takes fewer steps
QUINTIC = (3.4445, -4.7750, 2.0315)
RMS = 0.2  # of an update at rate 1: about that of Adam, so that both share a rate
WIDE = 4  # columns a row from which working on the product of rows costs less


def orthogonal(m: Tensor) -> Tensor:
    """[batch, rows, columns] -> the nearest matrices with almost equal singular values, in bf16 where that is fast."""
    x = m.to(torch.bfloat16 if bf16_pays(m.device) else torch.float32)
    tall = x.shape[1] > x.shape[2]
    if tall:
        x = x.mT.contiguous()
    x = x / (x.float().flatten(1).norm(dim=1)[:, None, None] + 1e-7).to(x.dtype)
    x = _wide(x) if x.shape[2] >= WIDE * x.shape[1] else _square(x)
    return x.mT if tall else x


def _square(x: Tensor) -> Tensor:
    a, b, c = QUINTIC
    for _ in range(STEPS):
        s = x @ x.mT
        x = torch.baddbmm(x, torch.baddbmm(s, s, s, beta=b, alpha=c), x, beta=a)
    return x


def _wide(x: Tensor) -> Tensor:
    """The same steps on x xᵀ alone; what they multiply x by is applied once. In f32: rounded to bf16 the product has negative eigenvalues,
    which the steps raise without bound."""
    a, b, c = QUINTIC
    f = x.float()
    s = f @ f.mT
    total: Tensor | None = None
    for _ in range(STEPS):
        factor = torch.baddbmm(s, s, s, beta=b, alpha=c)
        factor.diagonal(dim1=1, dim2=2).add_(a)
        total = factor if total is None else factor @ total
        s = factor @ s @ factor
    assert total is not None
    return (total @ f).to(x.dtype)


class Muon(torch.optim.Optimizer):
    """`matrices`: weights of convolutions, each with its number of groups; the parameter groups in `rest` are AdamW's, with its `adam` settings.

    All share one rate. The momentum is kept under `exp_avg`, as Adam's is.
    """

    def __init__(self, matrices: list[tuple[nn.Parameter, int]], rest: list[dict[str, Any]], lr: float, wd: float, momentum: float = 0.95, **adam: Any):
        super().__init__([p for p, _ in matrices], {"lr": lr, "weight_decay": wd})
        self.adam = torch.optim.AdamW(rest, lr=lr, **adam)
        self.own = self.param_groups[0]
        self.param_groups = [*self.adam.param_groups, self.own]
        self.state = self.adam.state
        self.momentum = momentum
        # equal shapes are made orthogonal in one go
        self.shapes: dict[tuple[int, ...], list[nn.Parameter]] = defaultdict(list)
        for p, groups in matrices:
            self.shapes[groups, *p.shape].append(p)

    @torch.no_grad()
    def step(self, closure: None = None) -> None:  # type: ignore[override]
        lr, wd = self.own["lr"], self.own["weight_decay"]
        for (groups, rows, *_), same in self.shapes.items():
            ahead = []
            for p in same:
                assert p.grad is not None
                state = self.state[p]
                if "exp_avg" not in state:
                    state["exp_avg"] = torch.zeros_like(p)
                m = state["exp_avg"].lerp_(p.grad, 1 - self.momentum)
                # where weights lie channels last, moving them there copies nothing
                ahead.append(p.grad.lerp(m, self.momentum).movedim(1, -1).reshape(groups, rows // groups, -1))
            u = orthogonal(torch.cat(ahead)).float()
            u *= RMS * max(u.shape[1:]) ** 0.5
            for p, d in zip(same, u.split(groups)):
                moved = p.movedim(1, -1)
                moved.mul_(1 - lr * wd).add_(d.reshape(moved.shape), alpha=-lr)
        self.adam.step()
