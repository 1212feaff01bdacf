"""MoveNet MultiPose Lightning sees up to six people at once: a picture goes in, LIMBS of everybody come out."""

from pathlib import Path

import cv2
import numpy as np
import openvino

from whole.labels import FACE
from whole.openvino_network import Network

# What its card recommends for the longer side; TensorFlow.js's least score of a person; rows and columns of inputs, of
# which the smallest that holds the picture is taken.
LONGER, SCORE = 256, 0.25
SHAPES = [(160, 256), (256, 160), (192, 256), (256, 192), (256, 256)]
KEYPOINTS = 17


class MultiPose:
    """One network, compiled for every shape."""

    version = f"OpenVINO {openvino.__version__.split('-')[0]}"

    def __init__(self, model: Path):
        self.networks = {shape: Network(model, [1, *shape, 3]) for shape in SHAPES}

    def networks_s(self) -> float:
        """Processor time inside the network so far."""
        return sum(n.cpu_s for n in self.networks.values())

    def people(self, picture: np.ndarray) -> list[np.ndarray]:
        """`picture` is BGR bytes; it is made smaller and gets a margin at the right or below."""
        height, width = picture.shape[:2]
        scale = LONGER / max(width, height)
        size = (round(height * scale), round(width * scale))
        rows, columns = next(s for s in SHAPES if s[0] >= size[0] and s[1] >= size[1])
        canvas = np.zeros((1, rows, columns, 3), np.int32)
        small = cv2.resize(picture, (size[1], size[0]), interpolation=cv2.INTER_AREA)
        canvas[0, : size[0], : size[1]] = small[..., ::-1]
        out = self.networks[rows, columns].run(canvas)[0]
        sure = out[out[:, 3 * KEYPOINTS + 4] > SCORE]
        places = sure[:, : 3 * KEYPOINTS].reshape(-1, KEYPOINTS, 3)[:, FACE:, 1::-1]
        return list(places * np.array([columns, rows]) / scale)
