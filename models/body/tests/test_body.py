"""python -m unittest discover -s models/body/tests: needs numpy; with MAKEHUMAN set to the assets' folder also scipy."""

from __future__ import annotations

import pathlib
import sys
import tomllib
import unittest

import numpy as np

HERE = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HERE))

import population  # noqa: E402
from decimate import decimate  # noqa: E402
from tree import JOINTS, JOINTS21, PARENTS, REST, rotation_between, t_pose  # noqa: E402


def sphere(rings: int, sectors: int) -> tuple[np.ndarray, np.ndarray]:
    points = [[0, 1, 0], [0, -1, 0]]
    for r in range(1, rings):
        for s in range(sectors):
            a, b = np.pi * r / rings, 2 * np.pi * s / sectors
            points.append([np.sin(a) * np.cos(b), np.cos(a), np.sin(a) * np.sin(b)])
    at = lambda r, s: 2 + (r - 1) * sectors + s % sectors  # noqa: E731
    faces = []
    for s in range(sectors):
        faces += [[0, at(1, s + 1), at(1, s)], [1, at(rings - 1, s), at(rings - 1, s + 1)]]
        for r in range(1, rings - 1):
            faces += [[at(r, s), at(r, s + 1), at(r + 1, s)], [at(r, s + 1), at(r + 1, s + 1), at(r + 1, s)]]
    return np.array(points, float), np.array(faces)


class Generator(unittest.TestCase):
    def test_a_tape_round_a_sphere_is_its_circumference(self):
        vertices, faces = sphere(60, 120)
        self.assertAlmostEqual(population.girth(vertices, faces, 0.01), 2 * np.pi, delta=0.01)
        self.assertAlmostEqual(population.girth(vertices, faces, 0.6), 2 * np.pi * 0.8, delta=0.01)

    def test_a_tape_bridges_a_hollow(self):
        rows = np.array([[0, 0], [2, 0], [2, 2], [1, 0.2], [0, 2.0]])
        hull = population.convex_outline(rows)
        self.assertEqual(sorted(map(tuple, hull)), [(0, 0), (0, 2), (2, 0), (2, 2)])

    def test_weighing_reaches_the_survey(self):
        rng = np.random.default_rng(5)
        male = np.arange(4000) % 2 == 0
        means = np.where(male[:, None], [1.72, 1.02, 0.90, 1.0], [1.66, 0.92, 0.90, 1.05])
        values = means + rng.normal(0, [0.10, 0.11, 0.13, 0.11], (4000, 4))
        w = population.weigh(values, male)
        self.assertGreater(w.effective, 400)
        for sex, is_sex in (("male", male), ("female", ~male)):
            share = w.weight[is_sex] / w.weight[is_sex].sum()
            for k, name in enumerate(population.MEASURES):
                mean, deviation = population.SURVEY[sex][name]
                got = (share * values[is_sex, k]).sum()
                spread = (share * (values[is_sex, k] - got) ** 2).sum() ** 0.5
                self.assertAlmostEqual(got, mean, delta=0.012, msg=f"{sex} {name}")
                self.assertAlmostEqual(spread, deviation, delta=0.018, msg=f"{sex} {name}")

    def test_fewer_vertices_keep_a_sphere_round(self):
        vertices, faces = sphere(24, 48)
        kept, fewer = decimate(vertices, faces, np.ones((len(vertices), 1)), 300)
        self.assertEqual(len(kept), 300)
        self.assertEqual(len(fewer), 2 * 300 - 4)  # Euler: closed, without handles
        p = vertices[kept][fewer]
        volume = np.einsum("fd,fd->f", p[:, 0], np.cross(p[:, 1], p[:, 2])).sum() / 6
        self.assertAlmostEqual(abs(volume), 4 / 3 * np.pi, delta=0.12)

    def test_rotation_between_takes_one_to_the_other(self):
        rng = np.random.default_rng(0)
        a, b = rng.normal(size=(20, 3)), np.array([0.2, -0.5, 1.0])
        r = rotation_between(a, b)
        unit = a / np.linalg.norm(a, axis=1, keepdims=True)
        np.testing.assert_allclose(np.einsum("nab,nb->na", r, unit), np.tile(b / np.linalg.norm(b), (20, 1)), atol=1e-12)
        np.testing.assert_allclose(r @ r.swapaxes(1, 2), np.tile(np.eye(3), (20, 1, 1)), atol=1e-12)

    def test_the_rest_pose_does_not_depend_on_the_posture_before(self):
        rng = np.random.default_rng(1)
        offsets = rng.normal(size=(24, 3)) * 0.2
        for j, (child, towards) in REST.items():
            offsets[child] = 0.3 * np.array(towards)
        joints = np.zeros((24, 3))
        for j, a in enumerate(PARENTS):
            joints[j] = offsets[j] + (joints[a] if a >= 0 else 0)
        raised = joints.copy()  # the left arm up from the shoulder
        turn = rotation_between(np.array([[1.0, 0, 0]]), np.array([0.3, 0.9, 0.1]))[0]
        for j in (18, 20, 22):
            raised[j] = joints[16] + turn @ (joints[j] - joints[16])
        bodies, weight = np.stack([joints, raised]), np.eye(24)
        points = bodies[:, :21]
        out, place, _ = t_pose(bodies, bodies, points, weight)
        np.testing.assert_allclose(place[0], place[1], atol=1e-9)
        np.testing.assert_allclose(out, place, atol=1e-9)


class Result(unittest.TestCase):
    """The file that ships."""

    @classmethod
    def setUpClass(cls):
        z = np.load(HERE / "body.npz")
        cls.z = {k: z[k] * z[f"{k}_unit"] if f"{k}_unit" in z else z[k] for k in z.files if not k.endswith("_unit")}

    def test_it_is_small(self):
        self.assertLess((HERE / "body.npz").stat().st_size, 500_000)

    def test_the_tree_is_smpl_s(self):
        parents = self.z["kintree_table"][0].astype(np.int64)
        self.assertEqual([p if p < 2**31 else -1 for p in parents], PARENTS)
        self.assertEqual(len(JOINTS), 24)

    def test_weights_and_regressors_sum_to_one(self):
        np.testing.assert_allclose(self.z["weights"].sum(1), 1, atol=1e-9)
        for k in ("J_regressor", "J_regressor_edgecap21"):
            np.testing.assert_allclose(self.z[k].sum(1), 1, atol=2e-3)

    def test_the_mean_body_stands_in_a_t_pose(self):
        v = self.z["v_template"]
        joints = self.z["J_regressor"] @ v
        self.assertAlmostEqual(np.ptp(v[:, 1]), 1.70, delta=0.03)
        self.assertAlmostEqual(v[:, 1].min(), 0, delta=0.005)
        self.assertLess(np.ptp(joints[[16, 18, 20], 1]), 0.03)
        self.assertGreater(joints[20, 0], joints[16, 0] + 0.4)  # left is +x

    def test_joints_mean_what_the_skeleton_means(self):
        bones = tomllib.loads((HERE.parent / "skeleton.toml").read_text())
        v = self.z["v_template"]
        at = dict(zip(JOINTS21, self.z["J_regressor_edgecap21"] @ v * bones["stature"] / np.ptp(v[:, 1])))
        theirs = {"pelvis": np.zeros(3)}
        for bone in bones["bone"]:
            theirs[bone["joint"]] = theirs[bone["parent"]] + bone["rest"]
            length = np.linalg.norm(bone["rest"])
            own = np.linalg.norm(at[bone["joint"]] - at[bone["parent"]])
            self.assertAlmostEqual(own, length, delta=0.025, msg=bone["joint"])
        for joint in ("spine", "neck", "head", "head_top", "l_hip", "r_hip", "l_shoulder", "r_shoulder"):
            self.assertAlmostEqual((at[joint] - at["pelvis"])[1], theirs[joint][1], delta=0.015, msg=joint)

    def test_left_is_right_mirrored(self):
        joints = self.z["J_regressor"] @ self.z["v_template"]
        for k, name in enumerate(JOINTS):
            if name.startswith("l_"):
                other = joints[JOINTS.index("r_" + name[2:])] * [-1, 1, 1]
                self.assertLess(np.linalg.norm(joints[k] - other), 0.012, name)

    def test_the_mesh_is_closed_but_for_the_eyes_and_mouth(self):
        f = self.z["f"].astype(int)
        edges = np.sort(f[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), 1)
        _, count = np.unique(edges, axis=0, return_counts=True)
        self.assertLessEqual(count.max(), 2)
        self.assertLess((count == 1).mean(), 0.02)


if __name__ == "__main__":
    unittest.main()
