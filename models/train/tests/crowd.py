"""People standing, for tests that need no data."""

from __future__ import annotations

import numpy as np
import torch

# A person standing, 150 px tall: head top, neck, right arm, left arm, right leg, left leg.
PERSON = np.array(
    [[0, 0], [0, 25], [-18, 28], [-24, 52], [-26, 75], [18, 28], [24, 52], [26, 75], [-10, 75], [-11, 110], [-12, 145], [10, 75], [11, 110], [12, 145]],
    np.float32,
)


def crowd(*at: tuple[float, float]) -> torch.Tensor:
    """[1, P, 14, 2]"""
    return torch.from_numpy(np.stack([PERSON + np.array(p, np.float32) for p in at]))[None]
