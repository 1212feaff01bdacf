"""threedpw_to_npz.py on made sequences in the form of the set's files."""

from __future__ import annotations

import io
import pathlib
import pickle
import subprocess
import sys
import tempfile
import unittest

import numpy as np

SCRIPT = pathlib.Path(__file__).resolve().parents[1] / "threedpw_to_npz.py"
# SMPL's joints of somebody upright, metres, y up, feet on the floor.
BODY = np.array(
    [[0, 0.95, 0], [0.07, 0.87, 0], [-0.07, 0.87, 0], [0, 1.06, 0], [0.1, 0.5, 0], [-0.1, 0.5, 0], [0, 1.2, 0], [0.1, 0.1, 0]]
    + [[-0.1, 0.1, 0], [0, 1.25, 0], [0.1, 0.05, 0.1], [-0.1, 0.05, 0.1], [0, 1.45, 0], [0.08, 1.4, 0], [-0.08, 1.4, 0]]
    + [[0, 1.53, 0], [0.18, 1.4, 0], [-0.18, 1.4, 0], [0.43, 1.4, 0], [-0.43, 1.4, 0], [0.68, 1.4, 0], [-0.68, 1.4, 0]]
    + [[0.76, 1.4, 0], [-0.76, 1.4, 0]]
)
CAMERA = np.array([[1000.0, 0, 540], [0, 1000, 960], [0, 0, 1]])


def sequence(frames: int = 3) -> dict:
    """Two people 4 m and 6 m before an upright camera at the height of 1 m; the second one stands beyond the picture's edge in frame 1."""
    pose = np.diag([1.0, -1, 1, 1])
    pose[:3, 3] = [0, 1, 4]
    near = np.repeat(BODY[None], frames, 0)
    far = near + [0.5, 0, 2]
    far[1] += [20, 0, 0]
    return dict(
        sequence="downtown_made_00",
        jointPositions=[near.reshape(frames, 72), far.reshape(frames, 72)],
        img_frame_ids=np.arange(frames) * 2,
        cam_poses=np.repeat(pose[None], frames, 0),
        cam_intrinsics=CAMERA,
        campose_valid=[np.array([1, 1, 0][:frames]), np.ones(frames, int)],
        genders=["m", "f"],
    )


class ThreeDpw(unittest.TestCase):
    def setUp(self) -> None:
        place = tempfile.TemporaryDirectory()
        self.addCleanup(place.cleanup)
        self.folder = pathlib.Path(place.name)

    def run_on(self, content: object, name: str = "s.pkl") -> subprocess.CompletedProcess[str]:
        # Protocol 0 is what Python 2 wrote.
        data = content if isinstance(content, bytes) else pickle.dumps(content, 0)
        (self.folder / name).write_bytes(data)
        command = [sys.executable, str(SCRIPT), str(self.folder / "t.npz"), str(self.folder / name)]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    def test_joints_cameras_and_who_counts(self) -> None:
        done = self.run_on(sequence())
        self.assertEqual(done.returncode, 0, done.stderr)
        with np.load(self.folder / "t.npz", allow_pickle=False) as t:
            self.assertEqual([str(n) for n in t["imgname"]], [f"downtown_made_00/image_{i:05d}.jpg" for i in (0, 1, 2)])
            # Nobody counts where the camera is wrong, nor whoever has left the picture.
            np.testing.assert_array_equal(t["valid"], [[1, 1], [1, 0], [0, 1]])
            # Others may walk by in all of them.
            np.testing.assert_array_equal(t["partial"], [1, 1, 1])
            np.testing.assert_allclose(t["positions_3d"][0, 0], BODY, atol=1e-6)
            # The near one's left wrist, in camera axes (0.68, -0.4, 4).
            np.testing.assert_allclose(t["positions_2d"][0, 0, 20], [540 + 170, 960 - 100, 1], atol=1e-3)
            np.testing.assert_array_equal(t["positions_2d"][1, 1, :, 2], 0)
            self.assertEqual((str(t["joint_order"]), str(t["units"])), ("smpl", "m"))
            self.assertEqual((t["camera_pose"].shape, t["camera_matrix"].shape), ((3, 3, 4), (3, 3, 3)))

    def test_a_pickle_that_is_a_program_is_not_run(self) -> None:
        ran = self.folder / "ran"

        class Evil:
            def __reduce__(self) -> tuple:
                return (pathlib.Path.touch, (ran,))

        done = self.run_on(sequence() | {"texture_maps": Evil()})
        self.assertEqual(done.returncode, 65)
        self.assertIn("is not run", done.stderr)
        self.assertFalse(ran.exists())

    def test_other_and_damaged_files_are_named_in_one_line(self) -> None:
        whole = io.BytesIO()
        pickle.dump(sequence(), whole, 2)
        short = sequence()
        short["cam_poses"] = short["cam_poses"][:2]
        for content, word in (({"betas": 1}, "jointPositions"), (whole.getvalue()[:200], "in one piece"), (short, "cam_poses"), ([1], "dictionary")):
            done = self.run_on(content)
            self.assertEqual(done.returncode, 65, done.stderr)
            self.assertIn(word, done.stderr)
            self.assertEqual(len(done.stderr.splitlines()), 1, done.stderr)
            self.assertFalse((self.folder / "t.npz").exists())


if __name__ == "__main__":
    unittest.main()
