"""Data-parallel training on one machine's cores: one single-threaded process a core, gradients averaged over gloo.

Two one-thread processes beat one process of two threads, and do not collapse when something else wants a core: threads of one process
wait for each other at every layer, processes once a step.
"""

from __future__ import annotations

import datetime
import os
import socket
import subprocess
import sys

import torch
import torch.distributed as dist
from torch import Tensor, nn

VARIABLE = "TRAIN_RANK"


def launch(count: int) -> list[subprocess.Popen[bytes]]:
    """Start ranks 1.. as copies of this command; returns them.  In a child, does nothing."""
    if count < 2 or VARIABLE in os.environ:
        return []
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port = str(s.getsockname()[1])
    os.environ |= {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port}
    return [
        subprocess.Popen([sys.executable, *sys.orig_argv[1:]], env=os.environ | {VARIABLE: str(r)}) for r in range(1, count)
    ]


class Group:
    """The processes that train together; alone, every method costs nothing."""

    def __init__(self, count: int):
        self.count, self.rank = count, int(os.environ.get(VARIABLE, 0))
        if count > 1:
            torch.set_num_threads(1)
            # long: a paused process (SIGSTOP) must not end the run
            dist.init_process_group("gloo", rank=self.rank, world_size=count, timeout=datetime.timedelta(hours=12))

    @property
    def first(self) -> bool:
        return self.rank == 0

    def same(self, values: list[float]) -> list[float]:
        """Rank 0's values, everywhere: the clock and the wish to stop."""
        if self.count == 1:
            return values
        t = torch.tensor(values, dtype=torch.float64)
        dist.broadcast(t, 0)
        return t.tolist()

    def any(self, wish: bool) -> bool:
        """True everywhere if it is true anywhere."""
        if self.count == 1:
            return wish
        t = torch.tensor(float(wish))
        dist.all_reduce(t)
        return bool(t > 0)

    def wait(self) -> None:
        """Until every rank is here."""
        if self.count > 1:
            dist.barrier()

    def same_weights(self, net: nn.Module) -> None:
        if self.count > 1:
            for t in net.state_dict().values():
                dist.broadcast(t, 0)

    def average(self, tensors: list[Tensor]) -> None:
        """Mean over the ranks, in place, in one message."""
        if self.count == 1:
            return
        flat = torch.cat([t.reshape(-1) for t in tensors])
        dist.all_reduce(flat)
        flat /= self.count
        for t, v in zip(tensors, flat.split([t.numel() for t in tensors])):
            t.copy_(v.view_as(t))

    def average_grads(self, net: nn.Module) -> None:
        grads = []
        for p in net.parameters():
            if not p.requires_grad:
                continue
            if p.grad is None:
                p.grad = torch.zeros_like(p)
            grads.append(p.grad)
        self.average(grads)

    def average_statistics(self, net: nn.Module) -> None:
        """Batch norm's running statistics: every rank saw other pictures."""
        self.average([b for n, b in net.named_buffers() if n.endswith(("running_mean", "running_var"))])
