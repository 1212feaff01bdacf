"""YOLOX-nano finds people, PP-TinyPose their joints, one crop each: a picture goes in, LIMBS of everybody come out."""

from pathlib import Path

import cv2
import numpy as np
import openvino

from whole.labels import FACE
from whole.openvino_network import Network

# YOLOX's demo: least score, overlap from which the weaker of two boxes goes, grey of the margin.
SCORE, OVERLAP, GREY = 0.3, 0.45, 114
# PP-TinyPose: input, how much larger than the box its crop is, and ImageNet's normalisation.
WIDTH, HEIGHT, LARGER = 192, 256, 1.25
MEAN = np.array([123.675, 116.28, 103.53], np.float32)
DEVIATION = np.array([58.395, 57.12, 57.375], np.float32)


class Chain:
    """Both networks; `size` is the detector's input."""

    version = f"OpenVINO {openvino.__version__.split('-')[0]}"

    def __init__(self, models: Path, size: int):
        self.size = size
        self.detector = Network(models / "yolox_nano.onnx", [1, 3, size, size])
        self.pose = Network(models / "tinypose_256x192.onnx")
        strides = (8, 16, 32)
        cells = [np.indices((size // s, size // s)).reshape(2, -1)[::-1].T for s in strides]
        self.grid = np.concatenate(cells).astype(np.float32)
        self.stride = np.repeat(np.array(strides, np.float32), [len(c) for c in cells])[:, None]

    def networks_s(self) -> float:
        """Processor time inside the networks so far."""
        return self.detector.cpu_s + self.pose.cpu_s

    def people(self, picture: np.ndarray) -> list[np.ndarray]:
        """`picture` is BGR bytes."""
        return [self._limbs(picture, box) for box in self._boxes(picture)]

    def _boxes(self, picture: np.ndarray) -> np.ndarray:
        """x, y, width, height in pixels."""
        height, width = picture.shape[:2]
        scale = self.size / max(width, height)
        small = cv2.resize(picture, (round(width * scale), round(height * scale)))
        canvas = np.full((self.size, self.size, 3), GREY, np.uint8)
        canvas[: small.shape[0], : small.shape[1]] = small
        out = self.detector.run(canvas.astype(np.float32).transpose(2, 0, 1)[None])[0]
        score = out[:, 4] * out[:, 5]
        sure = score > SCORE
        middle = (out[sure, :2] + self.grid[sure]) * self.stride[sure]
        extent = np.exp(out[sure, 2:4]) * self.stride[sure]
        boxes = np.concatenate([middle - extent / 2, extent], 1) / scale
        kept = cv2.dnn.NMSBoxes(boxes.tolist(), score[sure].tolist(), SCORE, OVERLAP)
        return boxes[np.array(kept, int).reshape(-1)]

    def _limbs(self, picture: np.ndarray, box: np.ndarray) -> np.ndarray:
        middle = box[:2] + box[2:] / 2
        scale = LARGER * max(box[2] / WIDTH, box[3] / HEIGHT)
        to_picture = np.array([[scale, 0, middle[0] - scale * WIDTH / 2], [0, scale, middle[1] - scale * HEIGHT / 2]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        crop = cv2.warpAffine(picture, to_picture, (WIDTH, HEIGHT), flags=flags)
        planes = ((crop[..., ::-1] - MEAN) / DEVIATION).transpose(2, 0, 1)[None]
        maps = self.pose.run(np.ascontiguousarray(planes))[0][FACE:]
        rows, columns = maps.shape[1:]
        shares = peaks(maps) / [columns - 1, rows - 1] - 0.5
        return middle + shares * np.array([WIDTH, HEIGHT]) * scale


def peaks(maps: np.ndarray) -> np.ndarray:
    """Column and row of every map's greatest value, refined by a parabola through the logarithms beside it."""
    count, rows, columns = maps.shape
    y, x = np.divmod(maps.reshape(count, -1).argmax(1), columns)
    logs = np.log(np.maximum(np.pad(maps, ((0, 0), (1, 1), (1, 1)), mode="edge"), 1e-10))
    each = np.arange(count)
    found = np.stack([x, y], 1).astype(float)
    for axis, (down, across) in enumerate(((0, 1), (1, 0))):
        before, at, after = (logs[each, y + 1 + k * down, x + 1 + k * across] for k in (-1, 0, 1))
        bend = before - 2 * at + after
        inner = (found[:, axis] > 0) & (found[:, axis] < (columns, rows)[axis] - 1) & (bend < 0)
        step = np.where(inner, (before - after) / 2 / np.where(inner, bend, 1), 0)
        found[:, axis] += np.clip(step, -0.5, 0.5)
    return found
