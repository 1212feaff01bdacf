"""Batch renormalisation (Ioffe 2017): batch normalisation whose answers in training are those of the running statistics.

With few tiles in a batch, a picture with extreme values is normalised by its own extremes: training never sees what the network
answers once the statistics are fixed.  Here it does.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

LIMITS = (3.0, 5.0)  # of the ratio of deviations r and of the shift d in running deviations: the paper's final values


class BatchRenorm2d(nn.BatchNorm2d):
    """Parameters, buffers and answers in eval mode are nn.BatchNorm2d's."""

    def forward(self, x: Tensor) -> Tensor:
        if not self.training:
            return super().forward(x)
        assert self.momentum is not None
        with torch.no_grad():
            mean, std = self.running_mean.clone(), (self.running_var + self.eps).sqrt()
            batch_mean, batch_var = torch.batch_norm_update_stats(x, self.running_mean, self.running_var, self.momentum)
            r = ((batch_var + self.eps).sqrt() / std).clamp(1 / LIMITS[0], LIMITS[0])
            d = ((batch_mean - mean) / std).clamp(-LIMITS[1], LIMITS[1])
        return F.batch_norm(x, None, None, self.weight * r, self.bias + self.weight * d, training=True, eps=self.eps)
