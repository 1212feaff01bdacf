"""Constant tensors, made once a device: to make one on a GPU waits until the GPU has done all it was asked to."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import torch
from torch import Tensor


def constant(values: Sequence[float], device: torch.device) -> Tensor:
    """A tensor of these values on a device. Not to be written to."""
    return _made(tuple(values), device)


@cache
def _made(values: tuple[float, ...], device: torch.device) -> Tensor:
    with torch.inference_mode(False):
        return torch.tensor(values, device=device)
