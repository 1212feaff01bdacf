"""Motion that comes as positions, on our body. No data needed."""

from __future__ import annotations

import pathlib
import sys
import tempfile
import unittest

import numpy as np

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(KIT))

import pack
import retarget
from skeleton import JOINTS21

STANDING = {
    "pelvis": (0, 0, 0), "spine": (0, 20, 0), "neck": (0, 48, 0), "head": (0, 62, 0), "face": (0, 55, 8),
    "shoulder": (16, 44, 0), "elbow": (20, 16, -2), "wrist": (22, -8, 4), "hip": (10, 0, 0), "knee": (11, -42, 1), "ankle": (11, -84, -2), "toe": (12, -90, 12),
}  # fmt: skip


def standing() -> dict[str, np.ndarray]:
    """Points [3] of somebody who stands."""
    out = {}
    for name, p in STANDING.items():
        both = name not in ("pelvis", "spine", "neck", "head", "face")
        for side, sign in (("l_", 1), ("r_", -1)) if both else (("", 1),):
            out[side + name] = np.array(p, float) * [sign, 1, 1]
    return out


def moved(seed: int, n: int = 40) -> dict[str, np.ndarray]:
    """Points [n, 3] of people in any pose: every point of somebody who stands, a third of a limb off."""
    rng = np.random.default_rng(seed)
    return {k: p + 12 * rng.standard_normal((n, 3)) * (k not in ("pelvis",)) for k, p in standing().items()}


class Retarget(unittest.TestCase):
    def test_bones_point_where_the_source_s_do(self) -> None:
        at, rest = moved(1), standing()
        g = retarget.bone_rotations(at, rest)
        ends = {bone: (a, b) for bone, (_, a, b) in retarget.LIMBS.items()} | {"Head": ("neck", "head"), "Spine1": ("r_shoulder", "l_shoulder"), "Hips": ("r_hip", "l_hip")}
        for bone, (a, b) in ends.items():
            with self.subTest(bone=bone):
                np.testing.assert_allclose(retarget.unit(g[bone] @ (rest[b] - rest[a])), retarget.unit(at[b] - at[a]), atol=1e-9)
                np.testing.assert_allclose(g[bone] @ np.swapaxes(g[bone], 1, 2), np.broadcast_to(np.eye(3), g[bone].shape), atol=1e-9)
                np.testing.assert_allclose(np.linalg.det(g[bone]), 1, atol=1e-9)

    def test_who_stands_as_our_body_does_is_not_turned(self) -> None:
        rest = standing()
        for bone, r in retarget.bone_rotations({k: p[None] for k, p in rest.items()}, rest).items():
            np.testing.assert_allclose(r[0], np.eye(3), atol=1e-9, err_msg=bone)

    def test_the_face_says_where_a_head_looks(self) -> None:
        at = {k: p[None] for k, p in standing().items()}
        at["face"] = at["face"] + [8, 0, 0]
        self.assertGreater((retarget.bone_rotations(at, standing())["Head"][0] @ [0, 0, 1])[0], 0.5)

    def test_photos_that_are_measured_with_lend_no_motion(self) -> None:
        names = ["S1_directions_1", "S1_eating_1"]
        rest = standing()
        body = {"points": np.zeros((len(pack.BONES) + len(JOINTS21), 3)), "bone_parent": np.array([max(i - 1, -1) for i in range(len(pack.BONES))])}
        for name, p in rest.items():
            if name in JOINTS21:
                body["points"][len(pack.BONES) + JOINTS21.index(name)] = p
        for s, side in (("l", "Left"), ("r", "Right")):
            body["points"][pack.BONES.index(f"{side}ToeBase")] = rest[f"{s}_toe"]
        with tempfile.TemporaryDirectory() as folder:
            points = np.stack([np.tile(rest[ours], (5, 1)) for ours in retarget.H36M], 1)
            np.savez(pathlib.Path(folder) / "h36m_s1_s5_s6_10fps.npz", positions_mm=points, joints=list(retarget.H36M.values()), names=names, lengths=[2, 3])
            quat, taken, lengths = retarget.more_motion(pathlib.Path(folder), body)
        self.assertEqual((taken, lengths), (["h36m/S1_eating_1"], [3]))
        self.assertEqual(quat[0].shape, (3, len(pack.DRIVEN), 4))


if __name__ == "__main__":
    unittest.main()
