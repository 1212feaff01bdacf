"""The same pictures in less light, to measure with: python dim.py FOLDER OUT --light 0.05.

As a small webcam takes them: fewer photons, read noise, and gain that brings brightness back as far as it goes. The truth stays
that of the pictures (`truth.json` comes along), so `edgecap eval` says what the dark costs.
"""

from __future__ import annotations

import argparse
import pathlib
import shutil
import sys

import numpy as np
from PIL import Image

FULL_WELL = 5000.0  # electrons of a white pixel at full light: a small sensor with pixels of 1.5 to 2 µm
READ_NOISE = 4.0  # electrons


def linear(srgb: np.ndarray) -> np.ndarray:
    """0..1 as stored -> 0..1 of light (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def stored(light: np.ndarray) -> np.ndarray:
    """The inverse of `linear`."""
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * np.maximum(light, 0) ** (1 / 2.4) - 0.055)


def dim(picture: np.ndarray, light: float, gain: float, rng: np.random.Generator) -> np.ndarray:
    """uint8 [h, w, 3] -> the same with `light` of the light, amplified by 1/light but at most `gain`."""
    electrons = rng.poisson(linear(picture / 255.0) * light * FULL_WELL) + rng.normal(0, READ_NOISE, picture.shape)
    return (stored((electrons / FULL_WELL * min(1 / light, gain)).clip(0, 1)) * 255).round().astype(np.uint8)


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("folder", type=pathlib.Path)
    ap.add_argument("out", type=pathlib.Path)
    ap.add_argument("--light", type=float, default=0.05, help="share of the light that is left")
    ap.add_argument("--gain", type=float, default=8.0, help="the most that the camera amplifies")
    ap.add_argument("--seed", type=int, default=1)
    a = ap.parse_args(argv)
    if not 0 < a.light <= 1:
        ap.error(f"expected a share of the light between 0 and 1, found {a.light}")
    if a.gain <= 0:
        ap.error(f"expected a gain above 0, found {a.gain}")
    files = sorted(f for f in a.folder.iterdir() if f.suffix.lower() in (".jpg", ".jpeg", ".png"))
    if not files:
        raise SystemExit(f"expected pictures in {a.folder}, found none")
    a.out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(a.seed)
    for f in files:
        Image.fromarray(dim(np.asarray(Image.open(f).convert("RGB")), a.light, a.gain, rng)).save(a.out / f.name, quality=90)
    if (truth := a.folder / "truth.json").exists():
        shutil.copy(truth, a.out)
    print(f"{len(files)} pictures at {a.light:g} of the light, amplified {min(1 / a.light, a.gain):g} times")


if __name__ == "__main__":
    main(sys.argv[1:])
