"""Which labelled photos of the train split show what one of the test split shows: the same exercise, the same photo of
COCO's, or somebody in the same pose, as copies do that a set holds mirrored, turned or cut. What is measured on the
test split says nothing of new photos where the network has learnt their like.
"""

from __future__ import annotations

import numpy as np

# Sources whose folders hold photos of one person in one room, a folder an exercise.
BY_FOLDER = {"free_exercise"}
LIMBS = slice(5, 17)  # of COCO's joints; faces hardly differ from person to person
MIRRORED = [1, 0, 3, 2, 5, 4, 7, 6, 9, 8, 11, 10]  # of those
# Whose pose is compared: the two teachers agree (OKS of the limbs), and TinyPose is confident of so many limb joints.
AGREED, CONFIDENT, ENOUGH = 0.7, 0.3, 10
# Root of the mean square distance between the joints of two people who lie on each other, over that of a joint from the
# middle of its person: copies lie below, few others do.
SAME = 0.045
CHUNK = 256  # people of the test split compared at once


def poses(row: dict) -> np.ndarray:
    """Limb joints [n, 12, 2] in pixels of those in a labelled photo who are seen well enough to be known again."""
    sure = [np.array(p["kp"])[LIMBS] for p in row["people"] if "kp" in p and p.get("agree", 0) >= AGREED]
    known = [k[:, :2] * row["size"] for k in sure if (k[:, 2] >= CONFIDENT).sum() >= ENOUGH]
    return np.array(known).reshape(-1, 12, 2)


def alike(poses: np.ndarray) -> np.ndarray:
    """Poses [n, 12, 2] as unit vectors [n, 24], whatever their place and size in the picture."""
    flat = (poses - poses.mean(1, keepdims=True)).reshape(-1, 24)
    return (flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9)).astype(np.float32)


def turned(poses: np.ndarray) -> list[np.ndarray]:
    """Poses [n, 12, 2] as they are and mirrored, each in all four quarter turns."""
    both = (poses, poses[:, MIRRORED] * [-1, 1])
    quarters = [np.array([[c, -s], [s, c]]) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    return [p @ q.T for p in both for q in quarters]


def groups(source: str, row: dict) -> set[tuple[object, ...]]:
    """What a photo shares with others whatever pose is seen: its folder, or COCO's number."""
    shared: set[tuple[object, ...]] = set()
    if source in BY_FOLDER:
        shared.add((source, row["src"].rpartition("/")[0]))
    if row.get("coco") is not None:
        shared.add(("coco", row["coco"]))
    return shared


def like_test(photos: list[tuple[str, dict]]) -> np.ndarray:
    """Of photos, (source, row of its labels), which are of the train split and like one of the test split: bool [n]."""
    tested = np.array([row["split"] == "test" for _, row in photos], bool)
    seen = {key for photo, test in zip(photos, tested) if test for key in groups(*photo)}
    out = np.array([not groups(*photo).isdisjoint(seen) for photo in photos], bool)
    each = [poses(row) for _, row in photos]
    of = np.repeat(np.arange(len(photos)), [len(p) for p in each])
    everybody = np.concatenate([np.zeros((0, 12, 2)), *each])
    learnt, asked = alike(everybody[~tested[of]]), everybody[tested[of]]
    most = np.full(len(learnt), -1.0, np.float32)
    for at in range(0, len(asked), CHUNK):
        for pose in turned(asked[at : at + CHUNK]):
            most = np.maximum(most, (learnt @ alike(pose).T).max(1))
    # the squared distance of unit vectors is 2 - 2 cos, and theirs from the middle 1
    out[of[~tested[of]][2 - 2 * most <= SAME**2]] = True
    return out & ~tested
