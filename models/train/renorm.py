"""Batch renormalisation (Ioffe 2017): batch normalisation whose answers in training are those of the running statistics.

With few tiles in a batch, a picture with extreme values is normalised by its own extremes: training never sees what the network
answers once the statistics are fixed.  Here it does.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

LIMITS = (3.0, 5.0)  # of the ratio of deviations r and of the shift d in running deviations: the paper's final values
PLAIN, FULL = 1000, 4000  # steps from random weights up to which it is batch normalisation, from which the limits are these


def limits_at(step: int) -> tuple[float, float]:
    """Limits of r and d at a step of training from random weights, whose running statistics mean nothing at first."""
    share = min(max((step - PLAIN) / (FULL - PLAIN), 0.0), 1.0)
    return 1 + share * (LIMITS[0] - 1), share * LIMITS[1]


class BatchRenorm2d(nn.BatchNorm2d):
    """Parameters, buffers and answers in eval mode are nn.BatchNorm2d's."""

    limits = LIMITS  # of all of them

    def forward(self, x: Tensor) -> Tensor:
        if not self.training:
            return super().forward(x)
        assert self.momentum is not None
        with torch.no_grad():
            mean, std = self.running_mean.clone(), (self.running_var + self.eps).sqrt()
            batch_mean, batch_var = torch.batch_norm_update_stats(x, self.running_mean, self.running_var, self.momentum)
            r = ((batch_var + self.eps).sqrt() / std).clamp(1 / self.limits[0], self.limits[0])
            d = ((batch_mean - mean) / std).clamp(-self.limits[1], self.limits[1])
        return F.batch_norm(x, None, None, self.weight * r, self.bias + self.weight * d, training=True, eps=self.eps)
