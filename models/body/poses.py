"""A prior of poses: motion capture -> rotations of the body's tree -> a mixture of Gaussians in poses.npz.

python poses.py BODY.npz CLIPS.npz poses.npz
CLIPS has `positions_mm` [n, joints, 3] (y up), `clip_names`, `clip_lengths` and `ours21_from_cmu38`, which picks edgecap's 21 joints. Clips called test/...
are held out; the likelihood of both is printed. Rotations about a limb's own axis, which joints do not show, stay as small as they can be.
"""

from __future__ import annotations

import pathlib
import sys

import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.special import logsumexp

from pictures import load
from tree import CARRIER21, JOINTS21, PARENTS

COMPONENTS = 8
EVERY = 8  # of frames at 30 a second
ITERATIONS = 25
WORST = 0.06  # metres: mean distance of a pose that was not understood
TWIST = 0.3  # weight of a rotation against 100 mm of a joint
FLOOR = 0.05**2  # radians²: variance that no direction goes below
SHRINK = 0.05  # how far a covariance goes towards its diagonal
EM_STEPS = 30
# Joints and what they are told against, the trunk apart: shoulders and hips come first.
LIMBS = ((3, 2), (4, 3), (6, 5), (7, 6), (9, 8), (10, 9), (12, 11), (13, 12), (17, 4), (18, 7), (19, 10), (20, 13))
NECK, HEAD = 17, 18  # of CMU's 38 joints: what is called a neck there lies between the shoulder blades
SEEN = {"neck": 0.1, "head": 0.1, "r_hand": 0.3, "l_hand": 0.3, "head_top": 0.0, "spine": 0.0}  # weights of joints, else 1


def cross(v: np.ndarray) -> np.ndarray:
    """Matrices [..., 3, 3] of the cross product with v [..., 3]."""
    x, y, z = np.moveaxis(v, -1, 0)
    o = np.zeros_like(x)
    return np.stack([o, -z, y, z, o, -x, -y, x, o], -1).reshape(*v.shape, 3)


def exponential(v: np.ndarray) -> np.ndarray:
    """Rotation vectors [..., 3] -> matrices (Rodrigues)."""
    angle = np.maximum(np.linalg.norm(v, axis=-1), 1e-9)[..., None, None]
    k = cross(v) / angle
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def logarithm(r: np.ndarray) -> np.ndarray:
    """Matrices -> rotation vectors, angles below pi."""
    v = np.stack([r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]], -1) / 2
    s = np.linalg.norm(v, axis=-1)
    angle = np.arctan2(s, (np.trace(r, axis1=-2, axis2=-1) - 1) / 2)
    return v * np.where(s > 1e-9, angle / np.maximum(s, 1e-9), 1)[..., None]


class Tree:
    """The mean body's joints, and where a pose puts them."""

    def __init__(self, body: dict) -> None:
        self.rest = body["J_regressor"] @ body["v_template"]
        self.own = body["J_regressor_edgecap21"] @ body["v_template"]
        above = np.eye(24, dtype=bool)
        for j, a in enumerate(PARENTS):
            if a >= 0:
                above[j] |= above[a]
        self.above = above[CARRIER21]

    def points(self, place: np.ndarray, local: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pelvis [n, 3] and rotations [n, 24, 3, 3] -> the 21 joints, the 24 joints, global rotations."""
        turn, at = local.copy(), np.zeros((len(place), 24, 3))
        at[:, 0] = place
        for j, a in enumerate(PARENTS):
            if a >= 0:
                turn[:, j] = turn[:, a] @ local[:, j]
                at[:, j] = at[:, a] + turn[:, a] @ (self.rest[j] - self.rest[a])
        return at[:, CARRIER21] + np.einsum("njab,jb->nja", turn[:, CARRIER21], self.own - self.rest[CARRIER21]), at, turn

    def targets(self, joints: np.ndarray) -> np.ndarray:
        """The same directions [n, 21, 3] in the lengths of this body: skeletons of others have other shoulders, hips and bones."""
        middle = lambda p, a, b: (p[..., a, :] + p[..., b, :]) / 2  # noqa: E731
        unit = lambda v: v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-9)  # noqa: E731
        own, out = self.own, np.zeros_like(joints)
        out[:, 14] = middle(joints, 8, 11)
        trunk = middle(joints, 2, 5) - out[:, 14]
        chest = out[:, 14] + unit(trunk) * np.linalg.norm(middle(own, 2, 5) - middle(own, 8, 11))
        for right, left, centre in ((8, 11, out[:, 14]), (2, 5, chest)):
            half = unit(joints[:, left] - joints[:, right]) * np.linalg.norm(own[left] - own[right]) / 2
            out[:, left], out[:, right] = centre + half, centre - half
        for child, parent in LIMBS:
            out[:, child] = out[:, parent] + unit(joints[:, child] - joints[:, parent]) * np.linalg.norm(own[child] - own[parent])
        out[:, 1] = chest + unit(joints[:, 1] - middle(joints, 2, 5)) * np.linalg.norm(own[1] - middle(own, 2, 5))
        out[:, 16] = out[:, 1] + unit(joints[:, 16] - joints[:, 1]) * np.linalg.norm(own[16] - own[1])
        return out

    def solve(self, target: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Joints [n, 21, 3], weight [21] -> rotation vectors [n, 24, 3], mean distance [n]; damped Gauss-Newton."""
        n = len(target)
        left = target[:, 11] - target[:, 8]
        up = target[:, 1] - target[:, 14]
        left /= np.linalg.norm(left, axis=1, keepdims=True)
        up -= left * (up * left).sum(1, keepdims=True)
        up /= np.linalg.norm(up, axis=1, keepdims=True)
        local = np.tile(np.eye(3), (n, 24, 1, 1))
        local[:, 0] = np.stack([left, up, np.cross(left, up)], -1)
        place, w = target[:, 14].copy(), np.sqrt(weight)[:, None]
        for _ in range(ITERATIONS):
            points, at, turn = self.points(place, local)
            frame = np.concatenate([np.tile(np.eye(3), (n, 1, 1, 1)), turn[:, PARENTS[1:]]], 1)
            arm = points[:, :, None] - at[:, None]
            jacobian = np.zeros((n, 21, 3, 75))
            jacobian[..., :3] = np.eye(3)
            moves = -cross(arm) @ frame[:, None] * self.above[None, :, :, None, None]
            jacobian[..., 3:] = moves.transpose(0, 1, 3, 2, 4).reshape(n, 21, 3, 72)
            jacobian = (jacobian * w[..., None]).reshape(n, 63, 75)
            residual = ((points - target) * w).reshape(n, 63, 1)
            normal = jacobian.swapaxes(1, 2) @ jacobian
            pull = jacobian.swapaxes(1, 2) @ residual
            keep = (TWIST * 0.1) ** 2
            normal[:, np.arange(75), np.arange(75)] += 1e-6
            normal[:, np.arange(6, 75), np.arange(6, 75)] += keep
            pull[:, 6:, 0] += keep * logarithm(local[:, 1:]).reshape(n, 69)
            step = -np.linalg.solve(normal, pull)[..., 0].clip(-0.5, 0.5)
            place += step[:, :3]
            local = exponential(step[:, 3:].reshape(n, 24, 3)) @ local
        points, _, _ = self.points(place, local)
        return logarithm(local), np.linalg.norm(points - target, axis=2)[:, 2:14].mean(1)


def mixture(x: np.ndarray, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights [k], means [k, d], covariances [k, d, d] by expectation maximisation from k-means."""
    centre = x.mean(0)
    _, _, axes = np.linalg.svd(x - centre, full_matrices=False)
    _, label = kmeans2((x - centre) @ axes[:12].T, COMPONENTS, minit="++", seed=seed)
    share = np.eye(COMPONENTS)[label]
    for _ in range(EM_STEPS):
        count = share.sum(0) + 1e-9
        mean = share.T @ x / count[:, None]
        covariance = []
        for k in range(COMPONENTS):
            off = x - mean[k]
            c = (share[:, k, None] * off).T @ off / count[k]
            covariance.append((1 - SHRINK) * c + SHRINK * np.diag(np.diag(c)) + FLOOR * np.eye(x.shape[1]))
        covariance = np.stack(covariance)
        share = log_density(x, count / count.sum(), mean, covariance)
        share = np.exp(share - logsumexp(share, axis=1, keepdims=True))
    return count / count.sum(), mean, covariance


def log_density(x: np.ndarray, weight: np.ndarray, mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Of poses [n, d] in every component [n, k]."""
    columns = []
    for w, m, c in zip(weight, mean, covariance):
        factor = np.linalg.cholesky(c)
        z = np.linalg.solve(factor, (x - m).T)
        columns.append(np.log(w) - 0.5 * (z**2).sum(0) - np.log(np.diag(factor)).sum() - 0.5 * len(m) * np.log(2 * np.pi))
    return np.stack(columns, 1)


def mirrored(theta: np.ndarray) -> np.ndarray:
    """Poses [n, 23, 3] of the mirror image: sides exchanged, x kept, y and z turned round."""
    names = "l_hip r_hip spine1 l_knee r_knee spine2 l_ankle r_ankle spine3 l_foot r_foot neck l_collar r_collar head".split()
    names += "l_shoulder r_shoulder l_elbow r_elbow l_wrist r_wrist l_hand r_hand".split()
    other = [names.index({"l_": "r_", "r_": "l_"}.get(n[:2], n[:2]) + n[2:]) for n in names]
    return theta[:, other] * [1, -1, -1]


def main(body: str, clips: str, out: str) -> None:
    tree, data = Tree(load(body)), np.load(clips)
    picked = data["ours21_from_cmu38"].copy()
    picked[[JOINTS21.index("neck"), JOINTS21.index("head")]] = NECK, HEAD
    clip = np.repeat(np.arange(len(data["clip_lengths"])), data["clip_lengths"])
    held_out = np.array([str(n).startswith("test/") for n in data["clip_names"]])[clip]
    joints = tree.targets(data["positions_mm"][:, picked].astype(float) * 1e-3)
    weight = np.array([SEEN.get(n, 1.0) for n in JOINTS21])
    chosen = np.arange(0, len(joints), EVERY)
    parts = [tree.solve(joints[i], weight) for i in np.array_split(chosen, max(1, len(chosen) // 250))]
    theta, off = (np.concatenate(p) for p in zip(*parts))
    good = off < WORST
    print(f"{len(chosen)} poses, {good.sum()} understood, joints {1e3 * np.median(off):.1f} mm off (median)")
    pose = theta[good, 1:]
    test = held_out[chosen][good]
    train = np.concatenate([pose[~test], mirrored(pose[~test])]).reshape(-1, 69)
    weight, mean, covariance = mixture(train)
    for name, x in (("fitted", train), ("held out", pose[test].reshape(-1, 69))):
        density = log_density(x, weight, mean, covariance)
        print(f"{name}: {len(x)} poses, log likelihood {logsumexp(density, axis=1).mean():.1f}")
    print("weights", np.round(weight, 3))
    factor = np.linalg.inv(np.linalg.cholesky(covariance))  # precision = factor' factor
    rows, columns = np.tril_indices(69)
    np.savez_compressed(
        out, weights=weight.astype(np.float32), means=mean.astype(np.float32), factors=factor[:, rows, columns].astype(np.float32)
    )  # fmt: skip
    print(f"{pathlib.Path(out).stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main(*sys.argv[1:])
