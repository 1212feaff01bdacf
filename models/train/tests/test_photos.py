"""Photos with public labels. No data needed."""

from __future__ import annotations

import json
import pathlib
import sys
import tempfile
import unittest

import numpy as np
from PIL import Image

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(KIT))

import photos


class Mpii(unittest.TestCase):
    def test_pixels_are_counted_from_0(self) -> None:
        """MATLAB's first pixel is 1."""
        row = {"image": "a.png", "joints": [[j + 1, 2 * j + 1] for j in range(16)], "joints_vis": [1] * 16, "scale": 1.0}
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            (folder / "annotations.json").write_text(json.dumps([row]))
            Image.new("RGB", (4, 3)).save(folder / "a.png")
            (photo,) = photos._mpii(folder)
        (person,) = photo.people
        expected = [[j, 2 * j] for j in photos.MPII]
        np.testing.assert_array_equal(person.joints[:, :2], expected)
        np.testing.assert_array_equal(person.box, [0, 0, 15, 30])


if __name__ == "__main__":
    unittest.main()
