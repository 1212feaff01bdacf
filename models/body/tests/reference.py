"""Posed bodies by NumPy, for the program's tests to agree with: python reference.py BODY.npz OUT.npz."""

from __future__ import annotations

import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
from pictures import load  # noqa: E402
from tree import PARENTS  # noqa: E402


def rotations(vectors: np.ndarray) -> np.ndarray:
    """Rotation vectors [n, 3] -> matrices [n, 3, 3] (Rodrigues)."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    x, y, z = (vectors / np.maximum(angle[:, 0], 1e-12)).T
    o = np.zeros_like(x)
    k = np.stack([o, -z, y, z, o, -x, -y, x, o], 1).reshape(-1, 3, 3)
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def posed(body: dict, beta: np.ndarray, theta: np.ndarray, pelvis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and joints of a shape, 24 rotation vectors and the pelvis' place."""
    rest = body["v_template"] + body["shapedirs"] @ beta
    joints, local = body["J_regressor"] @ rest, rotations(theta)
    turn, place = local.copy(), np.tile(pelvis, (24, 1)).astype(float)
    for j, a in enumerate(PARENTS):
        if a >= 0:
            turn[j] = turn[a] @ local[j]
            place[j] = place[a] + turn[a] @ (joints[j] - joints[a])
    moved = np.einsum("jab,jvb->jva", turn, rest[None] - joints[:, None]) + place[:, None]
    return np.einsum("vj,jva->va", body["weights"], moved), place


def main(source: str, out: str) -> None:
    body, rng = load(source), np.random.default_rng(7)
    beta = rng.normal(size=(3, body["shapedirs"].shape[2]))
    theta = rng.normal(size=(3, 24, 3)) * 0.5
    pelvis = rng.normal(size=(3, 3)) + [0, 0, 3]
    chosen = np.arange(0, len(body["v_template"]), 41)
    both = [posed(body, *case) for case in zip(beta, theta, pelvis)]
    np.savez_compressed(
        out, beta=beta, theta=theta, pelvis=pelvis, chosen=chosen,
        vertices=np.stack([v[chosen] for v, _ in both]), joints=np.stack([j for _, j in both]),
    )  # fmt: skip


if __name__ == "__main__":
    main(*sys.argv[1:])
