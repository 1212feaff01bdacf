"""People reported and people labelled go in; how many were found, how well, and how many reports are right come out.

Object keypoint similarity (OKS) over the twelve joints that all systems and label sets share; a place counts whatever
its confidence. Pairs are taken greedily, the best first. A report that is not right, but whose middle (the median
joint) lies in the box of somebody labelled, is excused: a bad pose lowers what is found, not the share of right
reports. In a picture in which not everybody is labelled people count, reports do not.
"""

from dataclasses import dataclass, field

import numpy as np

from whole.labels import Person, Picture

# COCO's constants of LIMBS: shoulders, elbows, wrists, hips, knees, ankles.
SIGMAS = np.repeat([0.079, 0.072, 0.062, 0.107, 0.087, 0.089], 2)
# OKS of a find, and the least that makes a pair.
FOUND, PAIR = 0.5, 0.05


@dataclass
class Score:
    """Sums over pictures; `reports` and what is said of them over those alone in which everybody is labelled."""

    oks: list[float] = field(default_factory=list)
    reports: int = 0
    right: int = 0
    excused: int = 0

    def found(self) -> float:
        """Share of the judged people at OKS of 0.5 or more."""
        return float(np.mean(np.array(self.oks) >= FOUND))

    def mean_oks(self) -> float:
        """Of the judged people, who count 0 where nobody was reported."""
        return float(np.mean(self.oks))

    def precision(self) -> float:
        """Share of right reports among those that can be judged."""
        return self.right / max(self.reports - self.excused, 1)


def similarity(person: Person, report: np.ndarray) -> float:
    """OKS of a report, [12, 2] pixels with NaN where it says nothing, with a labelled person."""
    if not person.labelled.any():
        return 0.0
    squares = ((report - person.joints) ** 2).sum(1)
    each = np.exp(-squares / (2 * (2 * SIGMAS) ** 2 * person.area))
    return float(np.nan_to_num(each)[person.labelled].mean())


def add(score: Score, picture: Picture, reports: list[np.ndarray]) -> None:
    """Counts one picture's reports."""
    people = [p for p in picture.people if p.labelled.any()]
    table = np.array([[similarity(p, r) for r in reports] for p in people]).reshape(len(people), len(reports))
    best, taken = np.zeros(len(people)), np.zeros(len(reports))
    for i, j in sorted(np.ndindex(*table.shape), key=lambda pair: -table[pair]):
        if table[i, j] > PAIR and best[i] == 0 and taken[j] == 0:
            best[i] = taken[j] = table[i, j]
    right = taken >= FOUND
    score.oks += [float(b) for p, b in zip(people, best, strict=True) if p.judged]
    if not picture.everybody:
        return
    score.reports += len(reports)
    score.right += int(right.sum())
    for report, is_right in zip(reports, right, strict=True):
        middle = np.nanmedian(report, 0)
        inside = (bool((p.box[:2] <= middle).all() and (middle <= p.box[2:]).all()) for p in picture.people)
        score.excused += not is_right and any(inside)
