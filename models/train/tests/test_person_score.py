"""The least score by looks at photos without people. No data needed."""

from __future__ import annotations

import pathlib
import sys
import unittest

import numpy as np

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(KIT))

from person_score import FEATURES, collect, score, threshold


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


if __name__ == "__main__":
    unittest.main()
