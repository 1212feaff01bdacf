"""What messages say by name."""

from __future__ import annotations

import re
import tomllib
import unittest

from runtime import CLIENT
from writer import edgecap, frame

REPOSITORY = CLIENT.parents[1]


class Messages(unittest.TestCase):
    def test_fields_by_name(self) -> None:
        body = frame(2, (3, 9)).people()[1]
        self.assertEqual(body.joint("r_elbow"), (9.0, 3.0, 2.0))
        self.assertEqual(body.joint2d("r_elbow"), (3.0, 9.0))
        self.assertEqual(body.joint_state("r_elbow"), "predicted")
        self.assertEqual(body.joint_states[:3], ("predicted", "occluded", "observed"))
        self.assertEqual(body.joint_confidence("l_foot_tip"), 20 / 32)
        self.assertEqual(body.bone_length("r_shoulder"), 2 / 64)
        self.assertEqual(body.bone_rotation("rightLowerArm"), (5.0, 0.0, 0.0, 1.0))
        self.assertEqual(body.angle("r_elbow_flexion"), 14 / 16)
        self.assertEqual(body.named_angles()["l_ankle_flexion"], 28 / 16)
        self.assertEqual(len(body.named_angles()), edgecap.DOF)

    def test_a_name_that_is_none_is_told_with_the_nearest(self) -> None:
        body = frame(0).people()[0]
        for what, call in [
            ("joint 'r_wirst': there is none of that name; did you mean 'r_wrist'?", lambda: body.joint("r_wirst")),
            ("did you mean 'r_knee_flexion'?", lambda: body.angle("r_knee_flex")),
            ("did you mean 'leftHand'?", lambda: body.bone_rotation("LeftHand")),
            ("expected one of head_top, neck", lambda: body.joint_state("?")),
            ("expected 1 to 64 of", lambda: edgecap.bodies("a/b")),
        ]:
            with self.assertRaises(edgecap.UnknownName) as failed:
                call()
            self.assertIn(what, str(failed.exception))

    def test_unknown_codes_are_the_first_and_counts_are_held_to_what_there_is(self) -> None:
        made = frame(0)
        made._bodies[0]._state, made._bodies[0]._joint_states[0], made.world._state = 9, 200, 77
        made.count = 1000
        body = made.people()[0]
        self.assertEqual((body.state, body.joint_state("head_top"), made.world.state), ("tentative", "predicted", "none"))
        self.assertEqual(len(made.people()), edgecap.MAX_PEOPLE)

    def test_what_is_printed_tells_what_it_is(self) -> None:
        made = frame(12, (3, 9))
        made.world._state, made.world.translation[1], made.world.rotation[3] = 1, 1.5, 1
        self.assertEqual(repr(made.people()[0]), "Body(id=3, tracked, score=0.88, pelvis at (0.50, -0.25, 3.00) m, height 1.75 m)")
        self.assertEqual(
            repr(made), "BodyFrame(sequence=12, #3, #9, 1280x720, World(estimated, camera 1.50 m above the floor))"
        )
        self.assertEqual(repr(made.in_world(made.people()[0])), "WorldBody(pelvis at (0.50, 1.25, 3.00) m)")
        made.world.translation[1] = 0
        self.assertEqual(repr(made.world), "World(estimated)", "a room of several cameras has no one camera")
        self.assertEqual(repr(frame(1, ())), "BodyFrame(sequence=1, nobody, 1280x720, World(no floor is known))")

    def test_names_are_those_of_the_skeleton(self) -> None:
        skeleton = tomllib.loads((REPOSITORY / "models/skeleton.toml").read_text())
        self.assertEqual(edgecap.ANGLE_NAMES[6:], tuple(d["name"] for d in skeleton["dof"]))
        parents = {b["joint"]: b["parent"] for b in skeleton["bone"]} | {"pelvis": "pelvis"}
        names = edgecap.JOINT_NAMES
        self.assertEqual({n: names[p] for n, p in zip(names, edgecap.PARENTS)}, parents)
        carried = dict(zip(edgecap.HUMANOID_BONES, (edgecap.HUMANOID_BONES[p] for p in edgecap.HUMANOID_PARENTS)))
        self.assertEqual((carried["rightUpperArm"], carried["leftFoot"]), ("spine", "leftLowerLeg"))

    def test_the_version_is_that_of_the_program(self) -> None:
        cargo = (REPOSITORY / "Cargo.toml").read_text()
        self.assertEqual(edgecap.__version__, re.search(r'^version = "(.+)"', cargo, re.M)[1])


if __name__ == "__main__":
    unittest.main()
