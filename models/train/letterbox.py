"""A picture of any size -> the network's input frame, as the runtime does it: uniform scale, centred, padded with mid grey."""

from __future__ import annotations

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

GREY = 128


def letterbox(image: np.ndarray, W: int = 512, H: int = 320) -> tuple[Tensor, float, float, float]:
    """uint8 [h, w, 3] -> float [1, 3, H, W] in 0..255, and scale, du, dv: input = original * scale + offset (pixel centres integers)."""
    h, w = image.shape[:2]
    s = min(W / w, H / h)
    nh, nw = min(H, round(h * s)), min(W, round(w * s))
    t = torch.from_numpy(np.array(image)).permute(2, 0, 1)[None].float()
    t = F.interpolate(t, size=(nh, nw), mode="bilinear", antialias=True, align_corners=False)
    y, x = (H - nh) // 2, (W - nw) // 2
    t = F.pad(t, (x, W - nw - x, y, H - nh - y), value=GREY)
    return t, s, 0.5 * s - 0.5 + x, 0.5 * s - 0.5 + y


def to_original(people: list[np.ndarray], s: float, du: float, dv: float) -> list[np.ndarray]:
    """Joints [14, 3] in input pixels -> original pixels."""
    return [np.concatenate([(q[:, :2] - [du, dv]) / s, q[:, 2:]], 1) for q in people]
