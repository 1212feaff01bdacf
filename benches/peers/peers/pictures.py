"""A folder of photographs, or a seed, goes in; pictures of the network's input size come out, [n, height, width, 3] bytes."""

from pathlib import Path

import numpy as np
from PIL import Image, ImageFilter

SUFFIXES = {".jpg", ".jpeg", ".png"}


def load(folder: Path, count: int, height: int, width: int) -> np.ndarray:
    """`count` pictures spread evenly over the folder's sorted names, letterboxed on grey."""
    files = sorted(p for p in folder.rglob("*") if p.suffix.lower() in SUFFIXES)
    if not files:
        raise SystemExit(f"expected .jpg or .png files under {folder}, found none; choose another --pictures")
    count = min(count, len(files))
    chosen = [files[i * len(files) // count] for i in range(count)]
    return np.stack([_letterbox(Image.open(p), height, width) for p in chosen])


def made(seed: int, count: int, height: int, width: int) -> np.ndarray:
    """Smooth random colour fields with edges, for when no photographs are at hand."""
    rng = np.random.default_rng(seed)
    out = []
    for _ in range(count):
        small = Image.fromarray(rng.integers(0, 256, (8, 12, 3), np.uint8))
        picture = small.resize((width, height), Image.Resampling.BICUBIC)
        for _ in range(12):
            x, y = int(rng.integers(0, width)), int(rng.integers(0, height))
            w, h = (int(v) for v in rng.integers(8, 120, 2))
            picture.paste(tuple(int(v) for v in rng.integers(0, 256, 3)), (x, y, x + w, y + h))
        out.append(np.asarray(picture.filter(ImageFilter.GaussianBlur(1))))
    return np.stack(out)


def planes(pictures: np.ndarray) -> np.ndarray:
    """What the peers take: [n, 3, height, width] floats, x / 255 - 0.5."""
    return np.ascontiguousarray(pictures.transpose(0, 3, 1, 2).astype(np.float32) / 255 - 0.5)


def _letterbox(picture: Image.Image, height: int, width: int) -> np.ndarray:
    picture = picture.convert("RGB")
    scale = min(width / picture.width, height / picture.height)
    size = (max(1, round(picture.width * scale)), max(1, round(picture.height * scale)))
    canvas = Image.new("RGB", (width, height), (128, 128, 128))
    canvas.paste(picture.resize(size, Image.Resampling.BILINEAR), ((width - size[0]) // 2, (height - size[1]) // 2))
    return np.asarray(canvas)
