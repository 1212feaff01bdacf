"""What each component of the body model does: python pictures.py BODY.npz OUT.png.  Needs numpy and pillow.

A row of bodies for every component, at -2 and +2 standard deviations, from the front and from the side, beside the mean.
"""

from __future__ import annotations

import sys

import numpy as np
from PIL import Image, ImageDraw

WIDTH, HEIGHT, METRES = 226, 250, 2.05  # of a cell, and what its height shows
LIGHT = np.array([0.3, 0.5, 0.81])
COLUMNS = 3  # components beside each other


def load(path: str) -> dict[str, np.ndarray]:
    z = np.load(path)
    return {k: z[k] * z[f"{k}_unit"] if f"{k}_unit" in z else z[k] for k in z.files if not k.endswith("_unit")}


def draw(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Grey picture [HEIGHT, WIDTH] of a body seen along -z, without perspective."""
    scale = HEIGHT / METRES
    p = np.stack([WIDTH / 2 + vertices[:, 0] * scale, HEIGHT - 6 - vertices[:, 1] * scale, vertices[:, 2]], 1)
    corners = p[faces]
    normal = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-12
    shade = 60 + 180 * np.clip(normal @ LIGHT, 0, 1)
    out = np.full((HEIGHT, WIDTH), 255.0)
    seen = normal[:, 2] > 0
    image = Image.fromarray(out.astype(np.uint8))
    pen = ImageDraw.Draw(image)
    for k in np.nonzero(seen)[0][np.argsort(corners[seen, :, 2].mean(1))]:
        pen.polygon([tuple(c) for c in corners[k, :, :2]], fill=int(shade[k]))
    return np.asarray(image)


def main(source: str, out: str) -> None:
    body = load(source)
    faces = body["f"].astype(int)
    side = np.array([[0, 0, -1.0], [0, 1, 0], [1, 0, 0]])

    def pair(beta: np.ndarray) -> list[np.ndarray]:
        v = body["v_template"] + body["shapedirs"] @ beta
        return [draw(v, faces), draw(v @ side.T, faces)[:, WIDTH // 4 : -WIDTH // 4]]

    count = body["shapedirs"].shape[2]
    blocks = []
    for k in range(count):
        cells = [c for s in (-2, 2) for c in pair(s * np.eye(count)[k])]
        block = Image.fromarray(np.hstack(cells))
        ImageDraw.Draw(block).text((4, 2), f"component {k + 1}: -2 and +2", fill=0)
        blocks.append(np.asarray(block))
    blank = np.full_like(blocks[0], 255)
    mean = np.hstack(pair(np.zeros(count)))
    blank[:, : mean.shape[1]] = mean
    labelled = Image.fromarray(blank)
    ImageDraw.Draw(labelled).text((4, 2), "mean", fill=0)
    blocks = [np.asarray(labelled), *blocks]
    while len(blocks) % COLUMNS:
        blocks.append(np.full_like(blank, 255))
    rows = [np.hstack(blocks[k : k + COLUMNS]) for k in range(0, len(blocks), COLUMNS)]
    Image.fromarray(np.vstack(rows)).save(out, optimize=True)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        raise SystemExit(__doc__)
    main(*sys.argv[1:])
