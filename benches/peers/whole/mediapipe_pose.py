"""MediaPipe Pose, the full model, as its package runs it: a picture goes in, LIMBS of the people come out.

`One` is the package's default, one person (Solutions); `Many` the task that finds several. Photos are looked at one
by one, a film's frames are tracked. The task wants both networks in a bundle that says how pictures are scaled; the
package has the networks, so the bundle is made from them.
"""

import zipfile
from importlib.metadata import version
from pathlib import Path

import cv2
import mediapipe
import numpy as np
from mediapipe.tasks.python import BaseOptions, vision
from mediapipe.tasks.python.metadata.metadata_writers.metadata_writer import MetadataWriter

# Where LIMBS stand among MediaPipe's 33 points.
FROM_POINTS = [11, 12, 13, 14, 15, 16, 23, 24, 25, 26, 27, 28]
MOST = 6
# Networks of the bundle: name there, file in the package, and mean and deviation of its pictures.
PARTS = [
    ("pose_detector.tflite", "pose_detection/pose_detection.tflite", 127.5, 127.5),
    ("pose_landmarks_detector.tflite", "pose_landmark/pose_landmark_full.tflite", 0.0, 255.0),
]


class One:
    """One person a picture."""

    version = f"MediaPipe {version('mediapipe')}"

    def __init__(self, film: bool):
        self.pose = mediapipe.solutions.pose.Pose(static_image_mode=not film)

    def people(self, picture: np.ndarray) -> list[np.ndarray]:
        """`picture` is BGR bytes."""
        found = self.pose.process(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)).pose_landmarks
        return [_limbs(found.landmark, picture)] if found else []


class Many:
    """Up to MOST people a picture; `bundle` is made if absent."""

    version = f"MediaPipe {version('mediapipe')}"

    def __init__(self, film: bool, bundle: Path):
        if not bundle.exists():
            make_bundle(bundle)
        mode = vision.RunningMode.VIDEO if film else vision.RunningMode.IMAGE
        base = BaseOptions(model_asset_path=str(bundle))
        options = vision.PoseLandmarkerOptions(base_options=base, running_mode=mode, num_poses=MOST)
        self.pose = vision.PoseLandmarker.create_from_options(options)
        self.film, self.time_ms = film, 0

    def people(self, picture: np.ndarray) -> list[np.ndarray]:
        """`picture` is BGR bytes."""
        rgb = cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)
        image = mediapipe.Image(image_format=mediapipe.ImageFormat.SRGB, data=rgb)
        self.time_ms += 33
        found = self.pose.detect_for_video(image, self.time_ms) if self.film else self.pose.detect(image)
        return [_limbs(points, picture) for points in found.pose_landmarks]


def make_bundle(to: Path) -> None:
    """The task's file out of the package's networks."""
    modules = Path(mediapipe.__file__).parent / "modules"
    with zipfile.ZipFile(to, "w", zipfile.ZIP_STORED) as bundle:
        for name, file, mean, deviation in PARTS:
            writer = MetadataWriter.create(bytearray((modules / file).read_bytes()))
            writer.add_image_input([mean], [deviation])
            bundle.writestr(name, bytes(writer.populate()[0]))


def _limbs(points, picture: np.ndarray) -> np.ndarray:
    height, width = picture.shape[:2]
    return np.array([[points[i].x * width, points[i].y * height] for i in FROM_POINTS])
