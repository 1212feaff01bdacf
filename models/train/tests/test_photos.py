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


class Coco(unittest.TestCase):
    def photo(self) -> photos.Photo:
        """One person with labels, a crowd, and one without labels, 60 pixels apart."""
        names = ["nose", *photos.NAMES]
        joints = [[10 + j, 20 + 2 * j] for j in range(13)]
        labels = [x for u, v in joints for x in (u, v, 2)]
        boxes = [[60 * k, 10, 40, 60] for k in range(3)]
        rows = [dict(image_id=1, bbox=b, area=900.0, keypoints=k, iscrowd=c) for b, k, c in zip(boxes, [labels, [0] * 39, []], [0, 1, 0])]
        truth = dict(images=[dict(id=1, file_name="a.png")], categories=[dict(id=1, keypoints=names)], annotations=rows)
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            (folder / "annotations.json").write_text(json.dumps(truth))
            Image.new("RGB", (320, 100)).save(folder / "a.png")
            (photo,) = photos._coco(folder)
        return photo

    def test_who_is_reported_in_a_crowd_is_not_wrong(self) -> None:
        photo = self.photo()
        self.assertEqual((len(photo.people), len(photo.ignored)), (1, 2))
        own = np.ones((14, 3))
        own[photos.SHARED, :2] = photo.people[0].joints[:, :2]
        own[:2, :2] = own[2, :2]
        reports = [own + [60.0 * k, 0, 0] for k in (0, 1, 2, 4)]
        best, nobody = photos.match(reports, photo)
        self.assertEqual((best.tolist(), nobody), ([1.0], 1))
        self.assertEqual(photos.match([], photo)[1], 0)


if __name__ == "__main__":
    unittest.main()
