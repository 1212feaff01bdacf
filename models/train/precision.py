"""Which arithmetic a device is fast at."""

from __future__ import annotations

from functools import cache

import torch


@cache
def bf16_pays(device: torch.device) -> bool:
    """bf16 products are at least as fast as f32: GPUs, and CPUs with AVX512-BF16 or AMX. Elsewhere they are emulated, several times slower."""
    if device.type == "cuda":
        return True
    has = torch.cpu.get_capabilities()
    return bool(has.get("avx512_bf16") or has.get("amx_bf16"))
