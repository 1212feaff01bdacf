"""MakeHuman's CC0 base mesh: vertices, faces, joint markers, morph targets and skinning weights as arrays.

Coordinates of the files are decimetres, x to the person's left, y up, z forward; everything returned is metres.
"""

from __future__ import annotations

import gzip
import json
import pathlib
from functools import cache

import numpy as np

DECIMETRE = 0.1
BODY_VERTICES = 13380  # the first ones; behind them come clothes helpers and the joints' marker cubes


class BaseMesh:
    """Base mesh of the folder `root` (3dobjs, targets, rigs, mesh_metadata)."""

    def __init__(self, root: pathlib.Path):
        self.root = root
        self.vertices, self.faces = _read_obj(root / "3dobjs" / "base.obj")
        groups = json.loads((root / "mesh_metadata" / "basemesh_vertex_groups.json").read_text())
        self._groups = {k: np.concatenate([np.arange(a, b + 1) for a, b in v]) for k, v in groups.items()}

    def marker(self, vertices: np.ndarray, name: str) -> np.ndarray:
        """Middle [..., 3] of the marker cube `name`, which morph targets move along with the body."""
        return vertices[..., self._groups[name], :].mean(-2)

    @cache
    def target(self, name: str) -> tuple[np.ndarray, np.ndarray] | None:
        """Vertex indices [k] and offsets [k, 3] of a morph target; None where MakeHuman has none of that name (its average)."""
        path = self.root / "targets" / f"{name}.target.gz"
        if not path.exists():
            return None
        rows = [line.split() for line in gzip.open(path, "rt") if line.strip() and not line.startswith("#")]
        if not rows:
            return None
        return np.array([int(r[0]) for r in rows]), np.array([[float(x) for x in r[1:4]] for r in rows]) * DECIMETRE

    def weights(self, rig: str, columns: dict[str, int], count: int) -> np.ndarray:
        """Skinning weights [BODY_VERTICES, count]; `columns` says which of our joints a bone of the rig moves."""
        bones = json.loads((self.root / "rigs" / "standard" / f"weights.{rig}.json").read_text())["weights"]
        out = np.zeros((len(self.vertices), count))
        for bone, entries in bones.items():
            if bone in columns:
                index = np.array([i for i, _ in entries], int)
                np.add.at(out[:, columns[bone]], index, [w for _, w in entries])
        out = out[:BODY_VERTICES]
        bare = out.sum(1) <= 0
        if bare.any():
            raise SystemExit(f"expected every vertex to follow a bone of {rig}, found {bare.sum()} that follow none")
        return out / out.sum(1, keepdims=True)


def _read_obj(path: pathlib.Path) -> tuple[np.ndarray, np.ndarray]:
    vertices, faces, group = [], [], ""
    for line in path.open():
        if line.startswith("v "):
            vertices.append([float(x) for x in line.split()[1:4]])
        elif line.startswith("g "):
            group = line.split()[1]
        elif line.startswith("f ") and group == "body":
            q = [int(t.split("/")[0]) - 1 for t in line.split()[1:]]
            faces.extend([q[0], q[k], q[k + 1]] for k in range(1, len(q) - 1))
    return np.array(vertices) * DECIMETRE, np.array(faces)
