"""COCO's 17 joints, as detectors and teachers name them, as the kit's 14: places and what is known of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skeleton import NJ

ABSENT, LABELLED, UNKNOWN = 0, 1, 2  # not in the picture; known; neither demanded nor forbidden
NOSE, EYES, EARS, SHOULDERS, HIPS = 0, [1, 2], [3, 4], [5, 6], [11, 12]
HEAD_TOP, NECK = 0, 1
LIMB_JOINTS = {2: 6, 3: 8, 4: 10, 5: 5, 6: 7, 7: 9, 9: 14, 10: 16, 12: 13, 13: 15, 8: 12, 11: 11}  # ours -> COCO's



@dataclass(frozen=True)
class Rules:
    """Shares of which a joint is made, adding up to 1, and how far hips and knees lie from COCO's."""

    neck: dict[str, float]
    head_top_of_face: dict[str, float]
    head_top_of_ears: dict[str, float]
    hip_up: float = 0.0  # of the way to the middle of the shoulders
    knee_up: float = 0.0  # of the way to the hip


# Learnt on 334 photos of LSP-train (283 for neck and head), where LSP's labels stand beside PP-TinyPose's joints: least absolute error, in
# torso lengths. Shoulders, elbows, wrists and ankles lie where COCO has them (medians 0.04 to 0.05 apart, bias below 0.02). Neck 0.045
# apart (99 % within 0.2), head top 0.060 by the face (97 %) and 0.077 by the ears (93 %), hips 0.066 (0.08 unmoved).
LSP = Rules(
    neck={"shoulders": 0.537, "ears": 0.463},
    head_top_of_face={"ears": 0.653, "eyes": 3.140, "nose": -2.675, "shoulders": -0.118},
    head_top_of_ears={"ears": 1.580, "shoulders": -0.580},
    hip_up=0.046,
    knee_up=0.06,
)
# By coco17_open.py, of the CC0 body alone: neck 0.043 apart, head top 0.061 by the face and 0.068 by the ears. Hips and knees stay, since
# nothing open says where COCO's are.
OPEN = Rules(
    neck={"shoulders": 0.557, "ears": 0.443},
    head_top_of_face={"ears": 1.203, "eyes": 0.929, "nose": -0.685, "shoulders": -0.447},
    head_top_of_ears={"ears": 1.562, "shoulders": -0.562},
)
HEADS_APART = 0.5  # of neck to head top: where the two rules for the head top differ by more, neither is believed


def to14(xy: np.ndarray, state: np.ndarray, rules: Rules = LSP) -> tuple[np.ndarray, np.ndarray]:
    """Joints [n, 17, 2] in pixels and what is known of each [n, 17] (`ABSENT`, `LABELLED`, `UNKNOWN`) -> [n, 14, 2], [n, 14].

    What is made of several joints is labelled where all of them are and absent where all of them are; hidden ears are often named well
    enough, so one of the two will do.
    """
    n = len(xy)
    out, known = np.zeros((n, NJ, 2), np.float32), np.full((n, NJ), UNKNOWN, np.uint8)
    part = dict(nose=xy[:, NOSE], eyes=xy[:, EYES].mean(1), ears=xy[:, EARS].mean(1), shoulders=xy[:, SHOULDERS].mean(1))

    def blend(shares: dict[str, float]) -> np.ndarray:
        return sum(w * part[k] for k, w in shares.items())

    for ours, theirs in LIMB_JOINTS.items():
        out[:, ours], known[:, ours] = xy[:, theirs], state[:, theirs]
    shoulders = (state[:, SHOULDERS] == LABELLED).all(1)
    for hip, knee in ((8, 9), (11, 12)):
        sure = shoulders & (known[:, hip] == LABELLED)
        moved = out[:, hip] + rules.hip_up * (part["shoulders"] - out[:, hip])
        out[:, hip] = np.where(sure[:, None], moved, out[:, hip])
        both = (known[:, hip] == LABELLED) & (known[:, knee] == LABELLED)
        out[:, knee] = np.where(both[:, None], out[:, knee] + rules.knee_up * (out[:, hip] - out[:, knee]), out[:, knee])
    ears = (state[:, EARS] == LABELLED).any(1) & (state[:, EARS] != ABSENT).all(1)
    face = ears & (state[:, [NOSE, *EYES]] == LABELLED).all(1)
    out[:, NECK], out[:, HEAD_TOP] = blend(rules.neck), blend(rules.head_top_of_ears)
    by_face = blend(rules.head_top_of_face)
    length = np.linalg.norm(out[:, HEAD_TOP] - out[:, NECK], axis=1)
    agree = np.linalg.norm(by_face - out[:, HEAD_TOP], axis=1) < HEADS_APART * length
    out[:, HEAD_TOP] = np.where(face[:, None], by_face, out[:, HEAD_TOP])
    known[:, NECK] = np.where(shoulders & ears, LABELLED, UNKNOWN)
    known[:, HEAD_TOP] = np.where(shoulders & face & agree, LABELLED, UNKNOWN)
    no_head = (state[:, [NOSE, *EYES, *EARS]] == ABSENT).all(1)
    known[:, HEAD_TOP] = np.where(no_head, ABSENT, known[:, HEAD_TOP])
    known[:, NECK] = np.where(no_head & (state[:, SHOULDERS] == ABSENT).all(1), ABSENT, known[:, NECK])
    return out, known
