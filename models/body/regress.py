"""Joint regressors: rows over vertices, non-negative, summing to one, that give a joint's place on every body."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

NEAR = 400  # vertices round a joint that may take part
CHOSEN = 80  # of them, spread out
SUM_WEIGHT = 1e3  # metres: how firmly a row sums to one


def regressor(bodies: np.ndarray, joint: np.ndarray, template: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Row [v] for one joint [n, 3] of T-posed bodies [n, v, 3] with sample weights [n]; `template` [v, 3] is the mean body."""
    near = np.argsort(np.linalg.norm(template - (weight[:, None] * joint).sum(0), axis=1))[:NEAR]
    chosen = _spread(template[near], CHOSEN)
    columns = near[chosen]
    root = np.sqrt(weight * len(weight))[:, None, None]
    a = (root * bodies[:, columns]).transpose(0, 2, 1).reshape(-1, len(columns))
    b = (root[..., 0] * joint).reshape(-1)
    x, _ = nnls(np.r_[a, np.full((1, len(columns)), SUM_WEIGHT)].astype(float), np.r_[b, SUM_WEIGHT].astype(float))
    row = np.zeros(len(template))
    row[columns] = x / x.sum()
    return row


def _spread(points: np.ndarray, count: int) -> list[int]:
    """Farthest point sampling: indices of `count` points [n, 3]."""
    chosen = [0]
    gap = np.linalg.norm(points - points[0], axis=1)
    while len(chosen) < min(count, len(points)):
        k = int(gap.argmax())
        chosen.append(k)
        gap = np.minimum(gap, np.linalg.norm(points - points[k], axis=1))
    return chosen
