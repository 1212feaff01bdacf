"""The map from COCO's joints to neck and head top without anybody's labels: python coco17_open.py PACK [--people 4000].

People of the CC0 body in poses of motion capture, seen from all round; nose, eyes and ears are places on its mesh. Prints the shares
that `coco17.OPEN` holds and how far they are off, in torso lengths. Least absolute error, shares of a rule add up to 1.
"""

from __future__ import annotations

import argparse
import pathlib
import sys

import numpy as np
import torch
from torch import Tensor

from body import Body, Mocap
from coco17 import HEAD_TOP, NECK

RULES = {
    "neck": (NECK, ("shoulders", "ears")),
    "head_top_of_face": (HEAD_TOP, ("ears", "eyes", "nose", "shoulders")),
    "head_top_of_ears": (HEAD_TOP, ("ears", "shoulders")),
}
ERROR = 0.02  # of a teacher's face points, torso lengths in x and in y
R_SHOULDER, L_SHOULDER, R_HIP, L_HIP = 2, 5, 8, 11


def face(body: Body) -> dict[str, list[int]]:
    """Vertices whose mean is the nose, the eyes (both) and the ears (both)."""
    v, at = body.verts, body.field
    skin = body.part == 0
    eye = body.fields[:, at["eye"]]
    eyes = [int(torch.where(skin & (v[:, 0] * side > 0), eye, torch.inf).argmin()) for side in (1, -1)]
    level = v[eyes, 1].mean()
    chin = v[:, 1] > level - 0.05
    head = skin & (body.fields[:, at["head"]] > 0.7) & chin & (v[:, 1] < level + 0.03)
    ahead = v[:, 2] - 10 * v[:, 0].abs()
    nose = [int(torch.where(head, ahead, -torch.inf).argmax())]
    # what stands out sideways, behind the eyes: the whole shell of the ear
    behind = head & (v[:, 2] < v[eyes, 2].mean() - 0.03)
    ears = [i for side in (1, -1) for i in (behind & (v[:, 0] * side > (v[behind, 0] * side).max() - 0.012)).nonzero()[:, 0].tolist()]
    return {"nose": nose, "eyes": eyes, "ears": ears}


@torch.no_grad()
def seen(body: Body, clips: Tensor, people: int, seed: int) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """Places [n, 2] of the parts of a face and of the middle of the shoulders, joints [n, 14, 2], torso lengths [n]."""
    g = torch.Generator().manual_seed(seed)
    torch.manual_seed(seed)
    parts = face(body)
    chosen = [i for p in parts.values() for i in p]
    kept: list[tuple[Tensor, Tensor]] = []
    for _ in range(0, people, 100):
        w, stature = body.random_shapes(100, g)
        rest_v, rest_p = body.shaped(w, stature)
        assert rest_v is not None
        yaw = torch.rand(100, generator=g) * 2 * torch.pi
        R, pos, joints = body.kinematics(body.random_poses(clips, 100, g), rest_p, yaw)
        v, _ = body.skin_mesh(R, pos, rest_p, rest_v)
        tilt = torch.randn(100, generator=g) * 0.25  # of the camera
        rows = torch.stack([torch.zeros(100), tilt.cos(), tilt.sin()], 1)
        view = torch.stack([torch.tensor([1.0, 0, 0]).expand(100, 3), -rows], 1)  # x right, y down
        kept.append(((v[:, chosen] @ view.mT), joints[:, :14] @ view.mT))
    points, joints = (torch.cat(t).numpy() for t in zip(*kept))
    at, part = 0, {}
    for name, ids in parts.items():
        part[name] = points[:, at : at + len(ids)].mean(1)
        at += len(ids)
    part["shoulders"] = joints[:, [R_SHOULDER, L_SHOULDER]].mean(1)
    torso = np.linalg.norm(part["shoulders"] - joints[:, [R_HIP, L_HIP]].mean(1), axis=1)
    rng = np.random.default_rng(seed)
    # exact places would earn shares that blow a teacher's errors up
    part = {k: v + ERROR * torso[:, None] * rng.standard_normal(v.shape) for k, v in part.items()}
    return part, joints, torso


def shares(part: dict[str, np.ndarray], truth: np.ndarray, names: tuple[str, ...], scale: np.ndarray) -> np.ndarray:
    """Shares of the named parts, adding up to 1, whose blend lies nearest to `truth` [n, 2] by absolute error over `scale` [n]."""
    last = part[names[-1]]
    A = np.stack([part[n] - last for n in names[:-1]], -1) / scale[:, None, None]
    b = (truth - last) / scale[:, None]
    w = np.ones(len(b))
    for _ in range(50):  # least squares, weighed again until they are least distances
        x = np.linalg.lstsq((A * w[:, None, None]).reshape(-1, A.shape[2]), (b * w[:, None]).reshape(-1), rcond=None)[0]
        w = np.maximum(np.linalg.norm(A @ x - b, axis=1), 1e-3) ** -0.5
    return np.append(x, 1 - x.sum())


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("pack", type=pathlib.Path)
    ap.add_argument("--people", type=int, default=4000)
    a = ap.parse_args(argv)
    cpu = torch.device("cpu")
    part, joints, torso = seen(Body(a.pack, cpu), Mocap(a.pack, cpu).train, a.people, 5)
    near = torso > 0.25  # metres: seen from above or lying towards the camera a torso is no measure
    for rule, (joint, names) in RULES.items():
        p, t, s = {n: part[n][near] for n in names}, joints[near, joint], torso[near]
        x = shares(p, t, names, s)
        off = np.linalg.norm(sum(w * p[n] for w, n in zip(x, names)) - t, axis=1) / s
        print(f"{rule}: {dict(zip(names, x.round(3).tolist()))}, {np.median(off):.3f} apart, {100 * (off < 0.2).mean():.0f} % within 0.2")


if __name__ == "__main__":
    main(sys.argv[1:])
