"""COCO's 17 joints, as detectors and teachers name them, as the kit's 14: places and what is known of each."""

from __future__ import annotations

import numpy as np

from skeleton import NJ

ABSENT, LABELLED, UNKNOWN = 0, 1, 2  # not in the picture; known; neither demanded nor forbidden
NOSE, EYES, EARS, SHOULDERS, HIPS = 0, [1, 2], [3, 4], [5, 6], [11, 12]
HEAD_TOP, NECK = 0, 1
LIMB_JOINTS = {2: 6, 3: 8, 4: 10, 5: 5, 6: 7, 7: 9, 9: 14, 10: 16, 12: 13, 13: 15, 8: 12, 11: 11}  # ours -> COCO's

# Learnt on 334 photos of LSP-train (283 for neck and head), where LSP's labels stand beside PP-TinyPose's joints: least absolute error, in
# torso lengths. Shoulders, elbows, wrists and ankles lie where COCO has them (medians 0.04 to 0.05 apart, bias below 0.02).
NECK_OF = {"shoulders": 0.537, "ears": 0.463}  # 0.045 apart, 99 % within 0.2
HEAD_TOP_OF_FACE = {"ears": 0.653, "eyes": 3.140, "nose": -2.675, "shoulders": -0.118}  # 0.060 apart, 97 % within 0.2
HEAD_TOP_OF_EARS = {"ears": 1.580, "shoulders": -0.580}  # 0.077 apart, 93 % within 0.2
HIP_UP = 0.046  # of the way to the middle of the shoulders: 0.08 apart unmoved, 0.066 so
KNEE_UP = 0.06  # of the way to the hip
HEADS_APART = 0.5  # of neck to head top: where the two rules for the head top differ by more, neither is believed


def to14(xy: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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
        moved = out[:, hip] + HIP_UP * (part["shoulders"] - out[:, hip])
        out[:, hip] = np.where(sure[:, None], moved, out[:, hip])
        both = (known[:, hip] == LABELLED) & (known[:, knee] == LABELLED)
        out[:, knee] = np.where(both[:, None], out[:, knee] + KNEE_UP * (out[:, hip] - out[:, knee]), out[:, knee])
    ears = (state[:, EARS] == LABELLED).any(1) & (state[:, EARS] != ABSENT).all(1)
    face = ears & (state[:, [NOSE, *EYES]] == LABELLED).all(1)
    out[:, NECK], out[:, HEAD_TOP] = blend(NECK_OF), blend(HEAD_TOP_OF_EARS)
    by_face = blend(HEAD_TOP_OF_FACE)
    length = np.linalg.norm(out[:, HEAD_TOP] - out[:, NECK], axis=1)
    agree = np.linalg.norm(by_face - out[:, HEAD_TOP], axis=1) < HEADS_APART * length
    out[:, HEAD_TOP] = np.where(face[:, None], by_face, out[:, HEAD_TOP])
    known[:, NECK] = np.where(shoulders & ears, LABELLED, UNKNOWN)
    known[:, HEAD_TOP] = np.where(shoulders & face & agree, LABELLED, UNKNOWN)
    no_head = (state[:, [NOSE, *EYES, *EARS]] == ABSENT).all(1)
    known[:, HEAD_TOP] = np.where(no_head, ABSENT, known[:, HEAD_TOP])
    known[:, NECK] = np.where(no_head & (state[:, SHOULDERS] == ABSENT).all(1), ABSENT, known[:, NECK])
    return out, known
