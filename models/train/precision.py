"""Which arithmetic a device is fast at."""

from __future__ import annotations

import time
from functools import cache

import torch
import torch.nn.functional as F

TRIES = 3


@cache
@torch.enable_grad()  # an optimiser asks from where gradients are off
def bf16_pays(device: torch.device) -> bool:
    """Whether a convolution of Stage I, forward and backward, takes less time in bf16 than in f32.  GPUs have it; of CPUs only those with
    AVX512-BF16 or AMX, and not all of these: Zen 5 takes half the time, a Sapphire Rapids whose AMX is masked 1.6 times as long."""
    if device.type == "cuda":
        return True
    has = torch.cpu.get_capabilities()
    if not (has.get("avx512_bf16") or has.get("amx_bf16")):
        return False
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        return _seconds(torch.bfloat16) < _seconds(torch.float32)
    finally:
        torch.set_num_threads(threads)


def _seconds(dtype: torch.dtype) -> float:
    """Processor time, which others on the machine hardly change, of the quickest of a few rounds of one grouped 3×3 layer
    at an eighth of 256² and of one 1×1 layer, as training runs them."""
    x = torch.rand(4, 128, 32, 32).contiguous(memory_format=torch.channels_last)
    grouped = torch.rand(128, 64, 3, 3).contiguous(memory_format=torch.channels_last).requires_grad_()
    dense = torch.rand(128, 128, 1, 1).contiguous(memory_format=torch.channels_last).requires_grad_()
    best = float("inf")
    for _ in range(TRIES + 1):  # the first one plans
        began = time.process_time()
        with torch.autocast("cpu", torch.bfloat16, enabled=dtype == torch.bfloat16):
            y = F.conv2d(F.conv2d(x, grouped, padding=1, groups=2), dense)
        y.float().sum().backward()
        best = min(best, time.process_time() - began)
    return best
