#!/usr/bin/env python3
"""A film through BlazePose as lines of `edgecap infer --jsonl`: python blazepose.py FILM OUT.jsonl [--model pose_landmark_heavy.tflite].

Somebody else's eyes, to hold the fit and a calibration against without ours: one person, 2D of the 14 evidence joints and 3D of the 21 body joints as
models/train/teacher.py derives them.  Needs `pip install mediapipe opencv-python-headless`.
"""

import argparse
import json
import os
import pathlib
import sys

os.environ["GLOG_minloglevel"] = "3"
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "models/train"))

import cv2  # noqa: E402
import mediapipe  # noqa: E402
import numpy as np  # noqa: E402
from skeleton import CANONICAL_STATURE_M, NJ  # noqa: E402
from teacher import LANDMARK, skeleton21, stature, with_heavy_model  # noqa: E402

LEAST_VISIBLE = 0.3
SHOULDERS, HIPS, EARS = [11, 12], [23, 24], [7, 8]


def evidence(flat: np.ndarray) -> np.ndarray:
    """BlazePose's landmarks [33, 3] (pixels, visibility) -> evidence joints [14, 3]; neck and head top lie where teacher.py puts them."""
    out = np.zeros((NJ, 3))
    for joint, landmark in LANDMARK.items():
        if flat[landmark, 2] > LEAST_VISIBLE:
            out[joint] = flat[landmark]
    shoulders, hips, ears = (flat[k, :2].mean(0) for k in (SHOULDERS, HIPS, EARS))
    neck = shoulders + 0.08 * (shoulders - hips)
    out[1] = *neck, flat[SHOULDERS, 2].mean()
    out[0] = *(ears + 0.9 * (ears - neck)), flat[EARS, 2].mean()
    out[:, 2] = out[:, 2].clip(0, 1)
    return out


def main() -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("film", type=pathlib.Path)
    ap.add_argument("out", type=pathlib.Path)
    ap.add_argument("--model", type=pathlib.Path, help="npm package @mediapipe/pose; without it the wheel's own, smaller one")
    a = ap.parse_args()
    if a.model:
        with_heavy_model(a.model)
    pose = mediapipe.solutions.pose.Pose(static_image_mode=True, model_complexity=2 if a.model else 1, min_detection_confidence=0.3)
    film = cv2.VideoCapture(str(a.film))
    fps = film.get(cv2.CAP_PROP_FPS)
    if not fps:
        raise SystemExit(f"expected a film that OpenCV can read, found {a.film}")
    number = found = 0
    with open(a.out, "w") as out:
        while True:
            more, image = film.read()
            if not more:
                break
            h, w = image.shape[:2]
            answer = pose.process(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
            people = []
            if answer.pose_landmarks:
                flat = np.array([[p.x * w - 0.5, p.y * h - 0.5, p.visibility] for p in answer.pose_landmarks.landmark])
                space = skeleton21(np.array([[p.x, p.y, p.z] for p in answer.pose_world_landmarks.landmark], np.float32))
                space *= CANONICAL_STATURE_M / max(stature(space), 0.5)
                joints = evidence(flat)
                score = float(joints[:, 2].mean())
                people.append(dict(score=score, joints2d=joints.round(2).tolist(), joints3d=space.round(4).tolist()))
                found += 1
            # 60 degrees across; who fits the lines may give another camera
            focal = w / 2 / np.tan(np.pi / 6)
            lens = dict(fx=focal, fy=focal, cx=(w - 1) / 2, cy=(h - 1) / 2)
            line = dict(frame=number, time_ns=round(number * 1e9 / fps), source=str(a.film), width=w, height=h, intrinsics=lens, people=people)
            out.write(json.dumps(line) + "\n")
            number += 1
    print(f"{number} pictures, somebody in {found}")


if __name__ == "__main__":
    main()
