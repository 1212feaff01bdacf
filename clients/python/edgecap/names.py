"""Joints, angles and bones by name, in the order in which messages hold them; `docs/body.md` explains each."""

from __future__ import annotations

import difflib
from typing import Final

from .errors import UnknownName

EVIDENCE_JOINTS: Final = 14
"""Joints that Stage I sees: the first of the body joints."""
BODY_JOINTS: Final = 21
DOF: Final = 29

JOINT_NAMES: Final[tuple[str, ...]] = tuple(
    (
        "head_top neck r_shoulder r_elbow r_wrist l_shoulder l_elbow l_wrist r_hip r_knee r_ankle l_hip l_knee l_ankle "
        "pelvis spine head r_hand l_hand r_foot_tip l_foot_tip"
    ).split()
)
PARENTS: Final[tuple[int, ...]] = (16, 15, 1, 2, 3, 1, 5, 6, 14, 8, 9, 14, 11, 12, 14, 14, 1, 4, 7, 10, 13)
"""Parent of every body joint; the pelvis is its own parent."""

ANGLE_NAMES: Final[tuple[str, ...]] = tuple(
    (
        "pelvis_tx pelvis_ty pelvis_tz pelvis_rx pelvis_ry pelvis_rz "
        "spine_flexion spine_lateral spine_twist neck_flexion neck_yaw "
        "r_shoulder_flexion r_shoulder_abduction r_shoulder_rotation r_elbow_flexion "
        "l_shoulder_flexion l_shoulder_abduction l_shoulder_rotation l_elbow_flexion "
        "r_hip_flexion r_hip_abduction r_hip_rotation r_knee_flexion r_ankle_flexion "
        "l_hip_flexion l_hip_abduction l_hip_rotation l_knee_flexion l_ankle_flexion"
    ).split()
)
"""The pelvis' place (metres) and rotation vector (radians), then 23 joint angles (radians)."""

HUMANOID_BONES: Final[tuple[str, ...]] = tuple(
    (
        "hips spine neck head rightUpperArm rightLowerArm rightHand leftUpperArm leftLowerArm leftHand "
        "rightUpperLeg rightLowerLeg rightFoot leftUpperLeg leftLowerLeg leftFoot"
    ).split()
)
"""VRM's and Unity's names."""
HUMANOID_PARENTS: Final[tuple[int, ...]] = (0, 0, 1, 2, 1, 4, 5, 1, 7, 8, 0, 10, 11, 0, 13, 14)
"""The bone that carries each bone; the hips carry themselves."""

COCO_KEYPOINTS: Final[tuple[str, ...]] = tuple(
    (
        "nose left_eye right_eye left_ear right_ear left_shoulder right_shoulder left_elbow right_elbow left_wrist "
        "right_wrist left_hip right_hip left_knee right_knee left_ankle right_ankle"
    ).split()
)
"""COCO's names, in its order; left and right are the person's own, as everywhere here."""
COCO_JOINTS: Final[tuple[int | None, ...]] = (None, None, None, None, None, 5, 2, 6, 3, 7, 4, 11, 8, 12, 9, 13, 10)
"""The body joint for each of COCO's keypoints; None in the face, of which no body joint is a part."""

KINECT_NAMES: Final[tuple[str, ...]] = tuple(
    (
        "PELVIS SPINE_NAVEL SPINE_CHEST NECK CLAVICLE_LEFT SHOULDER_LEFT ELBOW_LEFT WRIST_LEFT HAND_LEFT "
        "HANDTIP_LEFT THUMB_LEFT CLAVICLE_RIGHT SHOULDER_RIGHT ELBOW_RIGHT WRIST_RIGHT HAND_RIGHT HANDTIP_RIGHT "
        "THUMB_RIGHT HIP_LEFT KNEE_LEFT ANKLE_LEFT FOOT_LEFT HIP_RIGHT KNEE_RIGHT ANKLE_RIGHT FOOT_RIGHT HEAD NOSE "
        "EYE_LEFT EAR_LEFT EYE_RIGHT EAR_RIGHT"
    ).split()
)
"""Azure Kinect's names without `K4ABT_JOINT_`, in its order; left and right are the person's own."""
KINECT_JOINTS: Final[tuple[int | None, ...]] = (
    14, 15, None, 1, None, 5, 6, 7, 18, None, None, None, 2, 3, 4, 17,
    None, None, 11, 12, 13, 20, 8, 9, 10, 19, 16, None, None, None, None, None,
)
"""The body joint for each of Azure Kinect's; None where there is none."""


def unknown(what: str, name: str, known: tuple[str, ...]) -> UnknownName:
    """The error for a name that is none of `known`."""
    near = difflib.get_close_matches(name, known, n=1)
    meant = f"did you mean {near[0]!r}?" if near else f"expected one of {', '.join(known)}"
    return UnknownName(f"{what} {name!r}: there is none of that name; {meant}")


def index(what: str, name: str, known: tuple[str, ...]) -> int:
    """Where a name stands among `known`.

    Raises `UnknownName`.
    """
    try:
        return known.index(name)
    except ValueError:
        raise unknown(what, name, known) from None
