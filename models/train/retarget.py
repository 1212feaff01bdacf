"""Motion that comes as joint positions, on our body: Human3.6M's and Bandai Namco's (research and non-commercial terms, so not for
the open model).

Every bone is turned by the least rotation, from its parent's, that points it where the source's points; pelvis and chest have two
directions each and so a whole rotation. Only directions are taken over: lengths are those of our body.
"""

from __future__ import annotations

import pathlib

import numpy as np

# The points that are read, under one name: where each set has them. x to the person's left, y up, z forward.
H36M = {
    "pelvis": "pelvis", "spine": "spine", "neck": "neck", "head": "head", "face": "nose",
    "l_shoulder": "l_shoulder", "l_elbow": "l_elbow", "l_wrist": "l_wrist", "l_hip": "l_hip", "l_knee": "l_knee", "l_ankle": "l_ankle", "l_toe": "l_toe",
    "r_shoulder": "r_shoulder", "r_elbow": "r_elbow", "r_wrist": "r_wrist", "r_hip": "r_hip", "r_knee": "r_knee", "r_ankle": "r_ankle", "r_toe": "r_toe",
}  # fmt: skip
BANDAI = {
    "pelvis": "Hips", "spine": "Chest", "neck": "Neck", "head": "Head",
    "l_shoulder": "UpperArm_L", "l_elbow": "LowerArm_L", "l_wrist": "Hand_L", "l_hip": "UpperLeg_L", "l_knee": "LowerLeg_L", "l_ankle": "Foot_L", "l_toe": "Toes_L",
    "r_shoulder": "UpperArm_R", "r_elbow": "LowerArm_R", "r_wrist": "Hand_R", "r_hip": "UpperLeg_R", "r_knee": "LowerLeg_R", "r_ankle": "Foot_R", "r_toe": "Toes_R",
}  # fmt: skip
# Bones below pelvis and chest, parents first: parent, and the points that a bone leads from and to.
LIMBS = {
    f"{side}{bone}": (parent if parent == "Spine1" or parent == "Hips" else side + parent, f"{s}_{a}", f"{s}_{b}")
    for s, side in (("l", "Left"), ("r", "Right"))
    for bone, parent, a, b in (
        ("UpLeg", "Hips", "hip", "knee"),
        ("Leg", "UpLeg", "knee", "ankle"),
        ("Foot", "Leg", "ankle", "toe"),
        ("Arm", "Spine1", "shoulder", "elbow"),
        ("ForeArm", "Arm", "elbow", "wrist"),
    )
}
# Two of the four real photos with 3D are of these: they stay for measuring.
MEASURED = ("S1_directions_1", "S5_sittingdown_2")


def unit(v: np.ndarray) -> np.ndarray:
    """Directions [..., 3] of vectors."""
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-9)


def basis(left: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Axes [..., 3, 3] as columns: x along `left`, y as near `up` as that allows."""
    x = unit(left)
    y = unit(up - (up * x).sum(-1, keepdims=True) * x)
    return np.stack([x, y, np.cross(x, y)], -1)


def between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Rotations [..., 3, 3] of least angle that take directions a to directions b."""
    a, b = unit(a), unit(b)
    k, c = np.cross(a, b), (a * b).sum(-1)[..., None, None]
    z = np.zeros_like(k[..., 0])
    K = np.stack([z, -k[..., 2], k[..., 1], k[..., 2], z, -k[..., 0], -k[..., 1], k[..., 0], z], -1).reshape(*k.shape, 3)
    return np.eye(3) + K + K @ K / np.maximum(1 + c, 1e-6)


def bone_rotations(at: dict[str, np.ndarray], rest: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Global rotations [n, 3, 3] of our bones, from the points `at` [n, 3] of the source and those of our body at rest [3]."""

    def frame(left: tuple[str, str], up: tuple[str, str]) -> np.ndarray:
        there, here = (basis(p[left[0]] - p[left[1]], p[up[0]] - p[up[1]]) for p in (at, rest))
        return there @ here.T

    g = {"Hips": frame(("l_hip", "r_hip"), ("spine", "pelvis")), "Spine1": frame(("l_shoulder", "r_shoulder"), ("neck", "spine"))}
    up, rest_up = at["head"] - at["neck"], rest["head"] - rest["neck"]
    if "face" in at:
        forward = at["face"] - (at["neck"] + at["head"]) / 2
        g["Head"] = basis(np.cross(up, forward), up) @ basis(np.array([1.0, 0.0, 0.0]), rest_up).T
    else:
        g["Head"] = between(g["Spine1"] @ rest_up, up) @ g["Spine1"]
    for bone, (parent, a, b) in LIMBS.items():
        g[bone] = between(g[parent] @ (rest[b] - rest[a]), at[b] - at[a]) @ g[parent]
    return g


def local_rotations(positions: np.ndarray, joints: list[str], points: dict[str, str], body: dict[str, np.ndarray]) -> np.ndarray:
    """Local quaternions (w first) [n, driven bones, 4] of `positions` [n, joints, 3] in any unit."""
    from pack import BONES, JOINTS21, slerp_half, to_local

    at = {ours: positions[:, joints.index(theirs)].astype(float) for ours, theirs in points.items()}
    rest = {j: body["points"][len(BONES) + i].astype(float) for i, j in enumerate(JOINTS21)}
    rest |= {f"{s}_toe": body["points"][BONES.index(f"{side}ToeBase")].astype(float) for s, side in (("l", "Left"), ("r", "Right"))}
    g = bone_rotations(at, rest)
    g["LowerBack"], g["Spine"] = slerp_half(g["Hips"], g["Spine1"], 0.33), slerp_half(g["Hips"], g["Spine1"], 0.67)
    g["Neck"], g["Neck1"] = slerp_half(g["Spine1"], g["Head"], 0.4), slerp_half(g["Spine1"], g["Head"], 0.7)
    for side in ("Left", "Right"):
        g |= {f"{side}Shoulder": g["Spine1"], f"{side}Hand": g[f"{side}ForeArm"], f"{side}ToeBase": g[f"{side}Foot"]}
    return to_local(g, body["bone_parent"])


def more_motion(data: pathlib.Path, body: dict[str, np.ndarray]) -> tuple[list[np.ndarray], list[str], list[int]]:
    """Local quaternions, names and lengths of the clips that lie in the folder `data`; a set that is not there is left out."""
    quat: list[np.ndarray] = []
    names: list[str] = []
    lengths: list[int] = []
    for file, prefix, points in (("h36m_s1_s5_s6_10fps.npz", "h36m", H36M), ("bandai.npz", "bandai", BANDAI)):
        if not (data / file).exists():
            continue
        z = np.load(data / file, allow_pickle=False)
        of = z["clip"] if "clip" in z else np.repeat(np.arange(len(z["names"])), z["lengths"])
        q = local_rotations(z["positions_mm"], list(z["joints"]), points, body)
        for i, name in enumerate(z["names"]):
            if name not in MEASURED:
                quat.append(q[of == i])
                names.append(f"{prefix}/{name}")
                lengths.append(int((of == i).sum()))
    return quat, names, lengths
