"""A mesh of fewer vertices by half-edge collapse: what is kept is a subset, so morph targets and weights carry over.

Quadric error metric (Garland & Heckbert 1997), plus a price for collapsing over a change of skinning weights.
"""

from __future__ import annotations

import heapq

import numpy as np

SHAPE_PRICE = 1e-9  # prefers short edges where the surface is flat
WEIGHT_PRICE = 2e-7  # keeps rings of vertices at the joints
LEAST_COSINE = 0.2  # a face may turn this far


def decimate(vertices: np.ndarray, faces: np.ndarray, weight: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Kept vertices (indices, ascending) and their faces, at most `count` vertices where the surface allows it."""
    quadrics = _quadrics(vertices, faces)
    corners = [list(f) for f in faces]
    alive = np.ones(len(faces), bool)
    at: list[set[int]] = [set() for _ in vertices]
    edges: dict[tuple[int, int], int] = {}
    for k, f in enumerate(corners):
        for a, b in ((f[0], f[1]), (f[1], f[2]), (f[2], f[0])):
            at[a].add(k)
            e = (min(a, b), max(a, b))
            edges[e] = edges.get(e, 0) + 1
    border = {v for e, n in edges.items() if n == 1 for v in e}
    keep = np.zeros(len(vertices), bool)
    keep[faces.ravel()] = True
    left, version = int(keep.sum()), np.zeros(len(vertices), int)

    def cost(u: int, v: int) -> float:
        h = np.append(vertices[v], 1)
        length = float(((vertices[u] - vertices[v]) ** 2).sum())
        seam = float(np.abs(weight[u] - weight[v]).sum()) * length**0.5
        return float(h @ (quadrics[u] + quadrics[v]) @ h) + SHAPE_PRICE * length + WEIGHT_PRICE * seam

    heap: list[tuple[float, int, int, int, int]] = []

    def push(u: int, v: int) -> None:
        if u not in border:
            heapq.heappush(heap, (cost(u, v), u, v, int(version[u]), int(version[v])))

    def ring(v: int) -> set[int]:
        return {x for k in at[v] for x in corners[k]} - {v}

    def folds(u: int, v: int, k: int) -> bool:
        p = vertices[corners[k]]
        q = vertices[[v if x == u else x for x in corners[k]]]
        n, m = np.cross(p[1] - p[0], p[2] - p[0]), np.cross(q[1] - q[0], q[2] - q[0])
        return bool(n @ m <= LEAST_COSINE * np.linalg.norm(n) * np.linalg.norm(m))

    for a, b in edges:
        push(a, b)
        push(b, a)
    while left > count and heap:
        _, u, v, of_u, of_v = heapq.heappop(heap)
        if not keep[u] or not keep[v] or version[u] != of_u or version[v] != of_v:
            continue
        shared = at[u] & at[v]
        # More than two common neighbours would pinch the surface.
        if len(shared) != 2 or len(ring(u) & ring(v)) != 2 or any(folds(u, v, k) for k in at[u] - shared):
            continue
        for k in shared:
            alive[k] = False
            for x in corners[k]:
                at[x].discard(k)
        for k in at[u]:
            corners[k] = [v if x == u else x for x in corners[k]]
            at[v].add(k)
        at[u], keep[u] = set(), False
        quadrics[v] += quadrics[u]
        left -= 1
        version[v] += 1
        for x in ring(v):
            push(v, x)
            push(x, v)
    kept = np.nonzero(keep)[0]
    number = np.full(len(vertices), -1)
    number[kept] = np.arange(len(kept))
    return kept, number[np.array([f for f, a in zip(corners, alive) if a])]


def _quadrics(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    normal = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    area = np.linalg.norm(normal, axis=1) + 1e-12
    normal = normal / area[:, None]
    plane = np.c_[normal, -(normal * vertices[faces[:, 0]]).sum(1)]
    out = np.zeros((len(vertices), 4, 4))
    for k in range(3):
        np.add.at(out, faces[:, k], plane[:, :, None] * plane[:, None, :] * area[:, None, None])
    return out
