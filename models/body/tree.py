"""SMPL's 24 joints on MakeHuman's mesh, skinning, and the T-pose that every sampled body is brought to.

Axes: x to the person's left, y up, z forward.
"""

from __future__ import annotations

import numpy as np

from makehuman import BaseMesh

JOINTS = (
    "pelvis l_hip r_hip spine1 l_knee r_knee spine2 l_ankle r_ankle spine3 l_foot r_foot neck l_collar r_collar head "
    "l_shoulder r_shoulder l_elbow r_elbow l_wrist r_wrist l_hand r_hand"
).split()
PARENTS = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21]
MARKERS = (
    "pelvis l-upper-leg r-upper-leg spine-4 l-knee r-knee spine-3 l-ankle r-ankle spine-2 l-foot-1 r-foot-1 neck "
    "l-clavicle r-clavicle head l-shoulder r-shoulder l-elbow r-elbow l-hand r-hand l-hand-3 r-hand-3"
).split()
BONES = (
    "pelvis thigh_l thigh_r spine_01 calf_l calf_r spine_02 foot_l foot_r spine_03 ball_l ball_r neck_01 clavicle_l "
    "clavicle_r head upperarm_l upperarm_r lowerarm_l lowerarm_r hand_l hand_r"
).split()
FINGERS = ("index", "middle", "ring", "pinky", "thumb")
# Joint -> (the joint its bone points at, where that bone points in the rest pose).
REST = {j: (c, (1, 0, 0)) for j, c in ((16, 18), (18, 20), (20, 22))}
REST |= {j: (c, (-1, 0, 0)) for j, c in ((17, 19), (19, 21), (21, 23))}
REST |= {j: (c, (0, -1, 0)) for j, c in ((1, 4), (4, 7), (2, 5), (5, 8))}
FLAT = (7, 8, 10, 11)  # feet keep the ground's direction whatever the leg did

JOINTS21 = (
    "head_top neck r_shoulder r_elbow r_wrist l_shoulder l_elbow l_wrist r_hip r_knee r_ankle l_hip l_knee l_ankle pelvis "
    "spine head r_hand l_hand r_foot_tip l_foot_tip"
).split()
BETWEEN = {"neck": ("neck", "spine-1", 0.08), "spine": ("spine-3", "spine-2", 0.8)}  # markers, and how far from the first to the second
BETWEEN |= {f"{side}_foot_tip": (f"{side}-toe-2-3", f"{side}-foot-2", 0.3) for side in "lr"}
PELVIS = 0.75  # how far from the middle of the hips to the marker
CARRIER21 = np.array([15, 12, 17, 19, 21, 16, 18, 20, 2, 5, 8, 1, 4, 7, 0, 6, 15, 23, 22, 11, 10])  # joint that moves each of the 21


def joints24(mesh: BaseMesh, bodies: np.ndarray) -> np.ndarray:
    """[n, 24, 3] of bodies [n, vertices, 3] of the whole base mesh."""
    return np.stack([mesh.marker(bodies, f"joint-{m}") for m in MARKERS], 1)


def joints21(mesh: BaseMesh, bodies: np.ndarray, crown: int) -> np.ndarray:
    """[n, 21, 3]: the joints that edgecap reports; `crown` is the vertex at the top of the head.

    Neck, spine, pelvis and the tips of feet lie between markers where `models/skeleton.toml` has them on a person of the same stature.
    """
    at = {"head_top": bodies[:, crown], "head": mesh.marker(bodies, "joint-head")}
    at |= {name: _between(mesh, bodies, *markers) for name, markers in BETWEEN.items()}
    parts = dict(
        shoulder="shoulder", elbow="elbow", wrist="hand", hip="upper-leg", knee="knee", ankle="ankle", hand="finger-3-1"
    )
    for side in "lr":
        at |= {f"{side}_{ours}": mesh.marker(bodies, f"joint-{side}-{theirs}") for ours, theirs in parts.items()}
    hips = (at["l_hip"] + at["r_hip"]) / 2
    at["pelvis"] = hips + PELVIS * (mesh.marker(bodies, "joint-pelvis") - hips)
    return np.stack([at[name] for name in JOINTS21], 1)


def _between(mesh: BaseMesh, bodies: np.ndarray, first: str, second: str, share: float) -> np.ndarray:
    return (1 - share) * mesh.marker(bodies, f"joint-{first}") + share * mesh.marker(bodies, f"joint-{second}")


def weights(mesh: BaseMesh) -> np.ndarray:
    """Skinning weights [body vertices, 24] of MakeHuman's game rig; fingers move with the hands."""
    columns = {bone: j for j, bone in enumerate(BONES)}
    columns |= {f"{f}_0{k}_{side}": 22 + (side == "r") for f in FINGERS for k in (1, 2, 3) for side in "lr"}
    return mesh.weights("game_engine", columns, 24)


def rotation_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Least rotations [n, 3, 3] that take directions a [n, 3] to b [3]."""
    a = a / np.linalg.norm(a, axis=-1, keepdims=True)
    b = np.broadcast_to(b / np.linalg.norm(b), a.shape)
    v, c = np.cross(a, b), (a * b).sum(-1)[..., None, None]
    k = np.zeros((*a.shape[:-1], 3, 3))
    k[..., 0, 1], k[..., 0, 2], k[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    k -= k.swapaxes(-1, -2)
    return np.eye(3) + k + k @ k / (1 + c)


def skin(vertices: np.ndarray, joints: np.ndarray, weight: np.ndarray, turn: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Linear blend skinning: bodies [n, v, 3] with joints [n, 24, 3], moved to joints `place` with global rotations `turn` [n, 24, 3, 3]."""
    out = np.zeros_like(vertices)
    for j in range(weight.shape[1]):
        i = np.nonzero(weight[:, j] > 1e-6)[0]
        moved = np.einsum("nab,nvb->nva", turn[:, j], vertices[:, i] - joints[:, None, j]) + place[:, None, j]
        out[:, i] += weight[i, j][None, :, None] * moved
    return out


def t_pose(
    vertices: np.ndarray, joints: np.ndarray, points: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bodies [n, v, 3], their 24 joints and 21 points with arms sideways and legs down, pelvis above the origin, soles at y = 0.

    Targets differ in posture, too; left in, it would become shape: wrists moved 6 cm with the first components.
    """
    n = len(vertices)
    turn, place = np.tile(np.eye(3), (n, 24, 1, 1)), joints.copy()
    for j, a in enumerate(PARENTS):
        if a >= 0:
            place[:, j] = place[:, a] + np.einsum("nab,nb->na", turn[:, a], joints[:, j] - joints[:, a])
        if j in REST:
            child, towards = REST[j]
            turn[:, j] = rotation_between(joints[:, child] - joints[:, j], np.array(towards, float))
        elif a >= 0 and j not in FLAT:
            turn[:, j] = turn[:, a]
    out = skin(vertices, joints, weight, turn, place)
    moved = place[:, CARRIER21] + np.einsum("nqab,nqb->nqa", turn[:, CARRIER21], points - joints[:, CARRIER21])
    down = place[:, :1] * [1, 0, 1] + out[..., 1].min(1)[:, None, None] * [0, 1, 0]
    return out - down, place - down, moved - down
