"""The score of people: what it learns, and the least one by looks at photos without people. No data needed."""

from __future__ import annotations

import json
import pathlib
import shutil
import sys
import tempfile
import tomllib
import unittest

import numpy as np

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path[:0] = [str(KIT), str(KIT / "tests")]

import person_score
from coco17 import ABSENT, LABELLED, UNKNOWN
from composites import HIDDEN, OUTSIDE, VISIBLE, person, visibility
from crowd import crowd
from person_score import FEATURES, collect, score, threshold
from photo_truth import codes
from skeleton import LIMBS, NB, NJ


def row(source: str, *heights: float) -> dict:
    """A look at a photo without people in which candidates of these scores are seen."""
    return {"set": "nobody", "source": source, "crowd": [], "candidates": [dict(features=[h], oks=[]) for h in heights]}


class LeastScore(unittest.TestCase):
    def test_every_look_at_a_photo_counts_for_itself(self) -> None:
        rows = [row("a.jpg", 0.1, 0.3), row("a.jpg", 0.8), row("b.jpg"), row("b.jpg", 0.2)]
        c = collect(rows)
        self.assertEqual((c.looks, c.people, c.look.tolist()), ({"nobody": 4}, {"nobody": 0}, [0, 0, 1, 3]))
        s = c.features[:, 0]
        for quiet, loud in ((1.0, 0), (0.75, 1), (0.5, 2), (0.25, 3), (0.0, 3)):
            least = threshold(c, s, quiet)
            self.assertEqual(len(np.unique(c.look[s >= least])), loud, quiet)

    def test_photos_in_which_nobody_is_seen_at_all_are_quiet(self) -> None:
        c = collect([row("a.jpg"), row("b.jpg")])
        s = score(c, np.zeros(FEATURES), 0.0)
        self.assertEqual((len(s), threshold(c, s, 0.97)), (0, 0.0))


class Scores(unittest.TestCase):
    FEATURES = 2 * NJ + len(LIMBS) + 3

    def lines(self, folder: pathlib.Path, people: int, pictures: int, clear: float, similar: float) -> pathlib.Path:
        """Pictures of one candidate each: right where the first joint is clear."""
        path = folder / f"{people}-{clear}.jsonl"
        features = [clear] + [0.5] * (self.FEATURES - 1)
        candidate = dict(features=features, oks=[similar] * people)
        row = dict(settings=[0.4, 0.2, 0.1, 0.05], set=path.name, source="a.jpg", crowd=[False] * people, candidates=[candidate])
        path.write_text(f"{json.dumps(row)}\n" * pictures)
        return path

    def test_whom_a_candidate_is_taken_for(self) -> None:
        similar = np.array([[0.9, 0.2], [0.8, 0.0], [0.1, 0.3]])
        own, counts = person_score.assign(similar, np.array([False, False]))
        self.assertEqual((own.tolist(), counts.tolist()), ([0.9, 0.0, 0.3], [True] * 3))  # the second is a double
        own, counts = person_score.assign(similar, np.array([False, True]))
        self.assertEqual(counts.tolist(), [False, True, False])  # too near somebody who does not count
        own, counts = person_score.assign(np.zeros((2, 0)), np.zeros(0, bool))
        self.assertEqual((own.tolist(), counts.tolist()), ([0.0, 0.0], [True, True]))

    def test_what_is_learnt_tells_people_from_nobody(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            folder = pathlib.Path(d)
            some = self.lines(folder, 1, 30, 0.9, 0.8).read_text() + self.lines(folder, 0, 30, 0.1, 0.0).read_text()
            (folder / "all.jsonl").write_text(some)
            toml = folder / "association.toml"
            shutil.copy(KIT.parent / "association.toml", toml)
            before = tomllib.loads(toml.read_text())
            person_score.main([str(folder / "all.jsonl"), "--held", str(folder / "all.jsonl"), "--toml", str(toml)])
            after = tomllib.loads(toml.read_text())
            fitted = {*person_score.KEYS, "min_score", "score"}
            self.assertEqual(*({k: v for k, v in x.items() if k not in fitted} for x in (before, after)))
            self.assertEqual([after[k] for k in person_score.KEYS], [0.4, 0.2, 0.1, 0.05])
            c = person_score.load(folder / "all.jsonl")[0.4, 0.2, 0.1, 0.05]
            weights, bias = person_score.fit(c)
            s = person_score.score(c, weights, bias)
            self.assertLess(abs(s[:30].mean() - 0.8), 0.05)  # the score is the similarity to be expected
            self.assertLess(s[30:].max(), 0.05)
            self.assertAlmostEqual(after["score"]["joint"][0], float(weights[0]), places=3)
            self.assertTrue(s[30:].max() < after["min_score"] < s[:30].min())

    def test_reports_end_where_they_do_more_harm_than_good(self) -> None:
        similar = np.array([0.9, 0.2, 0.5, 0.1, 0.2])  # worth 0.6, -0.1, 0.2, -0.2, -0.1
        nothing = np.zeros(5)
        c = person_score.Candidates(nothing, similar, nothing, nothing, {}, {})
        scores = np.array([0.8, 0.6, 0.5, 0.4, 0.1])
        self.assertAlmostEqual(person_score.best_threshold(c, scores), 0.45)
        c.similarity = np.full(5, 0.9)
        self.assertAlmostEqual(person_score.best_threshold(c, scores), 0.05)

    def test_without_photos_of_nobody_there_is_no_threshold(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            c = person_score.load(self.lines(pathlib.Path(d), 1, 3, 0.9, 0.0))[0.4, 0.2, 0.1, 0.05]
        with self.assertRaisesRegex(SystemExit, "expected photos without people"):
            person_score.threshold(c, np.ones(3), 0.95)

    def test_a_file_of_other_keys_is_refused(self) -> None:
        with self.assertRaisesRegex(SystemExit, "expected one line 'bias = …'"):
            person_score.written("min_score = 1\n", dict(bias=2.0))

    def test_composites_say_who_can_be_seen(self) -> None:
        joints = crowd((80, 60), (500, 300))[0].numpy()
        labelled, hidden = np.ones((2, NJ), bool), np.zeros((2, NJ), bool)
        labelled[0, [3, 5]] = False
        hidden[0, 3] = True
        seen = visibility(joints, labelled, hidden)
        self.assertEqual((seen[0, 3], seen[0, 4], seen[1, 13]), (HIDDEN, VISIBLE, OUTSIDE))
        self.assertEqual(seen[0, 5], OUTSIDE, "without a label nothing says where it is")
        p = person(7, joints[0], seen[0])
        self.assertEqual((len(p["joints2d"]), len(p["visibility"]), p["visibility"][NJ:]), (NB, NB, [HIDDEN] * (NB - NJ)))

    def test_photos_place_no_joint_where_no_label_does(self) -> None:
        joints = crowd((80, 60), (200, 60), (320, 60))[0].numpy()
        box = np.concatenate([joints.min(1), joints.max(1)], 1)
        state = np.full((3, NJ), LABELLED, np.uint8)
        state[0, [3, 4]], state[0, 5] = UNKNOWN, ABSENT
        joints[0, 4] = 0  # as COCO writes what has no label
        state[1:], joints[1, 6], joints[2] = UNKNOWN, 0, 0
        placed, known = codes(state, joints, box)
        self.assertEqual(known[0].tolist(), [*[VISIBLE] * 3, HIDDEN, *[OUTSIDE] * 2, *[VISIBLE] * 8])
        self.assertTrue((placed[0] == joints[0]).all())
        # Somebody of whom nothing is sure is somebody all the same, as large as the box, wherever the labels lie.
        self.assertTrue((known[1:] == HIDDEN).all())
        self.assertTrue((np.delete(placed[1], 6, 0) == np.delete(joints[1], 6, 0)).all())
        for j, (x0, y0, x1, y1) in zip(placed[1:], box[1:]):
            self.assertTrue(((j >= (x0, y0)) & (j <= (x1, y1))).all())
            self.assertGreater(np.ptp(j[:, 1]), 0.9 * (y1 - y0))


if __name__ == "__main__":
    unittest.main()
