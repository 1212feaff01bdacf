"""3D of real people from calibrated views: python views.py CALIBRATION --seen A.jsonl B.jsonl ... --measured A.jsonl B.jsonl ...

Several synchronised, calibrated films of one person, a file a camera in the calibration's order, as `edgecap infer --jsonl` writes them.
The 2D of `--seen` (another detector's, say `tests/reference/blazepose.py`) is triangulated; against that stands the 3D of `--measured`,
every view by itself: the mean error of shoulders, elbows, wrists, hips, knees and ankles after alignment by a similarity (PA-MPJPE).
"""

from __future__ import annotations

import argparse
import json
import pathlib
import sys
import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np
import torch

from measure import procrustes
from skeleton import NJ

SUBPIXELS = 64.0  # parts of a pixel in which QTM counts
LEAST_CONFIDENCE = 0.3
AGREE = 30.0  # pixels within which all views must see a joint where it was triangulated
SAME = 0.12  # of the person's height: mean distance of the joints up to which a report is this person
MEASURED = range(2, NJ)  # head top and neck are marked differently by everybody


@dataclass
class View:
    """A pinhole camera with radial and tangential distortion (OpenCV's k1, k2, p1, p2): x right, y down, z forward, metres."""

    focal: np.ndarray  # [2]
    centre: np.ndarray  # [2]
    distortion: np.ndarray  # [4]
    rotation: np.ndarray  # [3, 3] world -> camera
    position: np.ndarray  # [3]

    def distort(self, x: np.ndarray) -> np.ndarray:
        k1, k2, p1, p2 = self.distortion
        r = (x**2).sum(-1, keepdims=True)
        a, b = x[..., :1], x[..., 1:]
        skew = np.concatenate([2 * p1 * a * b + p2 * (r + 2 * a * a), p1 * (r + 2 * b * b) + 2 * p2 * a * b], -1)
        return x * (1 + k1 * r + k2 * r * r) + skew

    def project(self, at: np.ndarray) -> np.ndarray:
        """World points [..., 3] -> pixels [..., 2]."""
        p = (at - self.position) @ self.rotation.T
        return self.distort(p[..., :2] / p[..., 2:]) * self.focal + self.centre

    def ray(self, uv: np.ndarray) -> np.ndarray:
        """Pixels [..., 2] -> undistorted x/z, y/z."""
        seen = (uv - self.centre) / self.focal
        x = seen
        for _ in range(20):
            x = x - (self.distort(x) - seen)
        return x


def read_qtm(path: pathlib.Path) -> list[View]:
    """A calibration of Qualisys Track Manager: rows of the rotation are the camera's axes, x right, y up, z backward; millimetres."""

    def numbers(node: ET.Element | None, *keys: str) -> np.ndarray:
        if node is None or not set(keys) <= set(node.attrib):
            raise SystemExit(f"expected cameras with <intrinsic> and <transform> and their {', '.join(keys[:2])} ... in {path}: give a .qca.txt")
        return np.array([float(node.attrib[k]) for k in keys])

    views = []
    for c in ET.parse(path).getroot().iter("camera"):
        lens, pose = c.find("intrinsic"), c.find("transform")
        rows = numbers(pose, *(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))).reshape(3, 3)
        views.append(
            View(
                numbers(lens, "focalLengthU", "focalLengthV") / SUBPIXELS,
                numbers(lens, "centerPointU", "centerPointV") / SUBPIXELS,
                numbers(lens, "radialDistortion1", "radialDistortion2", "tangentalDistortion1", "tangentalDistortion2"),
                rows * np.array([[1], [-1], [-1]]),
                numbers(pose, "x", "y", "z") / 1000,
            )
        )
    return views


def triangulate(views: list[View], uv: np.ndarray, conf: np.ndarray) -> np.ndarray:
    """Pixels [views, 14, 2] with confidences [views, 14] -> world joints [14, 3]; not a number where fewer than three views see a joint
    or one of them sees it elsewhere."""
    out = np.full((NJ, 3), np.nan)
    for j in range(NJ):
        seen = [k for k in range(len(views)) if conf[k, j] >= LEAST_CONFIDENCE]
        if len(seen) < 3:
            continue
        rows = []
        for k in seen:
            v = views[k]
            m = np.concatenate([v.rotation, -(v.rotation @ v.position)[:, None]], 1)
            x, y = v.ray(uv[k, j])
            rows += [conf[k, j] * (x * m[2] - m[0]), conf[k, j] * (y * m[2] - m[1])]
        p = np.linalg.svd(np.array(rows))[2][-1]
        p = p[:3] / p[3]
        if all(np.linalg.norm(views[k].project(p) - uv[k, j]) < AGREE for k in seen):
            out[j] = p
    return out


def people(path: pathlib.Path) -> dict[int, list[dict]]:
    """Moment -> people."""
    frames = map(json.loads, path.read_text().splitlines())
    return {frame["frame"]: frame["people"] for frame in frames}


def errors(view: View, truth: dict[int, np.ndarray], found: dict[int, list[dict]]) -> list[float]:
    """PA-MPJPE, millimetres, of every moment in which the person was found."""
    out = []
    for moment, joints in truth.items():
        ok = np.isfinite(joints[:, 0])
        if ok.sum() < 9:
            continue
        at = view.project(joints)
        height = np.ptp(at[ok, 1])
        near = []
        for p in found.get(moment, []):
            q = np.array(p["joints2d"])
            both = ok & (q[:, 2] > 0)
            if both.sum() >= 6:
                near.append((float(np.linalg.norm(q[both, :2] - at[both], axis=1).mean()), p))
        best = min(near, key=lambda n: n[0], default=None)
        if best is None or best[0] > SAME * height:
            continue
        use = [j for j in MEASURED if ok[j]]
        a, t = (torch.tensor(np.array(x)[use], dtype=torch.float32)[None] for x in (best[1]["joints3d"], joints))
        out.append(float((procrustes(a, t) - t).norm(dim=-1).mean()) * 1000)
    return out


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("calibration", type=pathlib.Path, help=".qca.txt")
    ap.add_argument("--seen", type=pathlib.Path, nargs="+", required=True)
    ap.add_argument("--measured", type=pathlib.Path, nargs="+", required=True)
    a = ap.parse_args(argv)
    views = read_qtm(a.calibration)
    if not len(views) == len(a.seen) == len(a.measured):
        raise SystemExit(f"expected a file for each of {len(views)} cameras, found {len(a.seen)} and {len(a.measured)}")
    seen = [people(f) for f in a.seen]
    truth = {}
    for moment in sorted(set.intersection(*(set(s) for s in seen))):
        if all(s[moment] for s in seen):
            j = np.array([s[moment][0]["joints2d"] for s in seen])
            truth[moment] = triangulate(views, j[..., :2], j[..., 2])
    pooled: list[float] = []
    for view, path in zip(views, a.measured):
        e = errors(view, truth, people(path))
        pooled += e
        print(f"{path.name:24} found {len(e):4} of {len(truth)}" + (f", PA-MPJPE {np.mean(e):6.1f} mm" if e else ""))
    print(f"{'all':24} found {len(pooled):4} of {len(truth) * len(views)}" + (f", PA-MPJPE {np.mean(pooled):6.1f} mm" if pooled else ""))


if __name__ == "__main__":
    main(sys.argv[1:])
