"""NumPy arrays over messages, and life without NumPy."""

from __future__ import annotations

import sys
import unittest
from unittest import mock

import numpy as np
from writer import edgecap, frame


class Arrays(unittest.TestCase):
    def test_they_are_the_message_itself(self) -> None:
        made = frame(4, (3, 9))
        joints, body = made.array("joints3d"), made.people()[1]
        self.assertEqual((joints.shape, joints.dtype), ((2, 21, 3), np.float32))
        np.testing.assert_array_equal(joints[1], [list(j) for j in body.joints3d])
        joints[1, 4] = (1, 2, 3)
        self.assertEqual(body.joint("r_wrist"), (1.0, 2.0, 3.0))
        np.testing.assert_array_equal(body.array("joints3d")[4], (1, 2, 3))
        self.assertTrue(np.shares_memory(joints, body.array("joints3d")))

    def test_every_field_has_one(self) -> None:
        made = frame(4, (3, 9, 11))
        body = made.people()[0]
        for name, shape in {
            "position": (3,), "orientation": (4,), "velocity": (3,), "angles": (29,), "joints3d": (21, 3),
            "joints2d": (21, 2), "confidence": (21,), "bone_lengths": (21,), "bone_rotations": (16, 4),
            "joint_states": (21,), "state": (), "id": (), "score": (), "height": (),
        }.items():  # fmt: skip
            self.assertEqual(body.array(name).shape, shape, name)
            self.assertEqual(made.array(name).shape, (3, *shape), name)
        self.assertEqual(list(made.array("id")), [3, 9, 11])
        self.assertEqual(list(body.array("joint_states")[:3]), [0, 1, 2])

    def test_numbers_are_the_message_itself_too(self) -> None:
        body = frame(4).people()[0]
        for name, value in {"id": 8, "score": 0.25, "height": 1.5, "state": 2}.items():
            body.array(name)[...] = value
        self.assertEqual((body.id, body.score, body.height, body.state), (8, 0.25, 1.5, "predicted"))
        self.assertEqual(float(body.array("score")), 0.25)

    def test_a_view_keeps_its_message(self) -> None:
        joints = frame(6).array("joints3d")
        others = [frame(n) for n in range(50)]
        self.assertEqual((joints[0, 20, 2], len(others)), (6, 50))

    def test_observations_have_them_too(self) -> None:
        seen = edgecap.ObservationFrame(count=2)
        self.assertEqual(seen.array("joints2d").shape, (2, 14, 3))
        self.assertEqual(seen.people()[0].array("hue").shape, (30,))

    def test_fields_that_are_none_are_told(self) -> None:
        with self.assertRaisesRegex(edgecap.UnknownName, "did you mean 'joints3d'"):
            frame(0).array("joints")

    def test_without_numpy_it_says_what_to_do(self) -> None:
        with mock.patch.dict(sys.modules, {"numpy": None}):
            with self.assertRaisesRegex(ImportError, "pip install numpy"):
                frame(0).array("joints3d")
            self.assertEqual(frame(0).people()[0].joint("neck"), (3.0, 1.0, 0.0))


if __name__ == "__main__":
    unittest.main()
