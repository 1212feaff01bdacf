"""Whole programs' accuracy: similarity, matching, and the three formats of labels, on people made up here."""

import gzip
import json
import pathlib
import sys
import tempfile
import unittest

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from whole import labels, reports, score  # noqa: E402

BODY = np.array([[x, y] for y in (20, 40, 60, 80, 110, 140) for x in (60, 40)], float)


def person(at: tuple[float, float] = (0, 0), judged: bool = True) -> labels.Person:
    """BODY, moved, all joints labelled."""
    joints = BODY + at
    box = np.concatenate([joints.min(0) - 5, joints.max(0) + 5])
    return labels.Person(joints, np.full(12, True), 4000.0, box, judged)


def counted(people: list[labels.Person], told: list[np.ndarray]) -> score.Score:
    """The score of one picture."""
    total = score.Score()
    score.add(total, labels.Picture("p.jpg", people), told)
    return total


class Similarity(unittest.TestCase):
    """OKS."""

    def test_is_coco_s_formula_over_labelled_joints(self):
        p = person()
        p.labelled[1:] = False
        told = BODY + [3, 4]
        self.assertAlmostEqual(score.similarity(p, told), np.exp(-25 / (2 * (2 * 0.079) ** 2 * 4000)))

    def test_a_joint_that_was_not_told_scores_nothing(self):
        told = BODY.copy()
        told[:3] = np.nan
        self.assertAlmostEqual(score.similarity(person(), told), 9 / 12)

    def test_nobody_labelled_is_like_nobody(self):
        p = person()
        p.labelled[:] = False
        self.assertEqual(score.similarity(p, BODY), 0)


class Matching(unittest.TestCase):
    """People and reports of one picture."""

    def test_a_report_counts_for_one_person_and_a_person_for_one_report(self):
        total = counted([person(), person((300, 0))], [BODY, BODY + [1, 0]])
        self.assertEqual((total.oks, total.right, total.excused), ([1, 0], 1, 1))

    def test_the_best_pairs_come_first(self):
        total = counted([person(), person((6, 0))], [BODY + [6, 0], BODY])
        self.assertEqual((total.oks, total.found()), ([1, 1], 1))

    def test_a_report_on_nobody_is_wrong(self):
        total = counted([person()], [BODY, BODY + [500, 0]])
        self.assertEqual((total.reports, total.right, total.excused, total.precision()), (2, 1, 0, 0.5))

    def test_people_who_are_not_judged_are_neither_found_nor_missed(self):
        total = counted([person(judged=False), person((300, 0))], [BODY])
        self.assertEqual((total.oks, total.precision()), ([0], 1))

    def test_nobody_and_nothing(self):
        total = counted([], [])
        self.assertEqual((total.oks, total.reports, total.precision()), ([], 0, 0))


class Formats(unittest.TestCase):
    """Label files and what systems wrote, read from a folder."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def write(self, name: str, text: str) -> pathlib.Path:
        file = self.folder / name
        file.write_bytes(gzip.compress(text.encode()) if name.endswith(".gz") else text.encode())
        return file

    def test_coco(self):
        names = ["nose", *labels.LIMBS]
        points = [1.0, 2.0, 2.0, *(v for x, y in BODY for v in (x, y, 2.0))]
        person = {"image_id": 7, "category_id": 1, "keypoints": points, "bbox": [30, 10, 40, 140], "area": 1234.0}
        crowd = {**person, "iscrowd": 1}
        images = [{"id": 7, "file_name": "folder/a.jpg"}]
        categories = [{"id": 1, "keypoints": names}]
        file = {"images": images, "annotations": [person, crowd], "categories": categories}
        read = labels.read(self.write("coco.json", json.dumps(file)))
        (picture,) = read
        self.assertEqual((picture.name, picture.everybody), ("a.jpg", True))
        self.assertEqual([p.judged for p in picture.people], [True, False])
        np.testing.assert_array_equal(picture.people[0].joints, BODY)
        self.assertEqual(picture.people[0].area, 1234)

    def test_leeds_sports(self):
        joints = np.zeros((14, 3))
        joints[:2] = [[50, 0, 1], [50, 10, 1]]
        joints[labels.FROM_EVIDENCE] = np.column_stack([BODY, np.ones(12)])
        entry = {"file": "lsp/b.jpg", "split": "test", "joints": joints.tolist()}
        read = labels.read(self.write("sports.json", json.dumps([entry, {**entry, "split": "train"}])))
        (picture,) = read
        self.assertEqual((picture.name, picture.everybody), ("b.jpg", False))
        np.testing.assert_array_equal(picture.people[0].joints, BODY)
        self.assertAlmostEqual(picture.people[0].area, 20 * 140 * labels.AREA_OF_BOX)

    def test_teachers_and_coco_s_own_labels_in_json_lines(self):
        kp = [[0.0, 0.0, 0.9]] * labels.FACE + [[x / 200, y / 200, 0.9] for x, y in BODY]
        true = [[0.0, 0.0, 0]] * labels.FACE + [[x / 200, y / 200, 2] for x, y in BODY]
        known = {"box": [0.1, 0.1, 0.4, 0.8], "kp": kp, "spread": [0.01] * 17, "agree": 0.9, "true": true}
        unsure = {**known, "agree": 0.5}
        del unsure["true"]
        line = {"file": "c.jpg", "split": "test", "size": [200, 200], "people": [known, unsure]}
        file = self.write("c.jsonl.gz", json.dumps(line) + "\n")
        for wanted in (False, True):
            (picture,) = labels.read(file, true=wanted)
            self.assertEqual([p.judged for p in picture.people], [True, False])
            np.testing.assert_allclose(picture.people[0].joints, BODY)
            self.assertTrue(picture.everybody)

    def test_a_report_beside_all_boxes_is_wrong_only_where_everybody_is_labelled(self):
        kp = [[0.0, 0.0, 0.9]] * labels.FACE + [[x / 200, y / 200, 0.9] for x, y in BODY]
        known = {"box": [0.1, 0.1, 0.4, 0.8], "kp": kp, "spread": [0.01] * 17, "agree": 0.9}
        line = {"file": "c.jpg", "split": "test", "size": [200, 200], "people": [known]}
        for more, precision in ((0, 0.5), (3, None)):
            file = self.write("c.jsonl.gz", json.dumps(line | {"more": more}) + "\n")
            total = score.Score()
            for picture in labels.read(file):
                score.add(total, picture, [BODY, BODY + [500, 0]])
            self.assertEqual(total.oks, [1], "people are found in either")
            if precision is None:
                self.assertEqual((total.reports, total.right, total.excused), (0, 0, 0))
            else:
                self.assertEqual(total.precision(), precision)

    def test_reports_of_ours_and_of_a_peer(self):
        joints = np.zeros((14, 3))
        joints[labels.FROM_EVIDENCE] = np.column_stack([BODY, np.zeros(12)])
        joints[labels.FROM_EVIDENCE[0]] = 0
        ours = {"source": "x/a.jpg", "people": [{"joints2d": joints.tolist()}]}
        peer = {"source": "b.jpg", "limbs": [BODY.tolist()]}
        lines = [json.dumps(ours), json.dumps(peer)]
        found = reports.read(self.write("people.jsonl", "\n".join(lines)))
        self.assertTrue(np.isnan(found["a.jpg"][0][0]).all())
        np.testing.assert_array_equal(found["a.jpg"][0][1:], BODY[1:])
        np.testing.assert_array_equal(found["b.jpg"][0], BODY)
        self.assertEqual(reports.people(lines), 2)


if __name__ == "__main__":
    unittest.main()
