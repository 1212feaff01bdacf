"""Two engines' maps of the same pictures go in, how far they are apart comes out."""

import numpy as np

HEATMAPS = 14
HEAD2D = 40
CHANNELS = HEAD2D + 63
# A heatmap cell counts as a person's joint from this value on.
PEAK = 0.3
# A peak is looked for this many cells around where f32 has it; farther away it is another joint.
REACH = 2
STRIDE = 8


def read(path, rows: int, columns: int) -> np.ndarray:
    """Maps [n, rows, columns, 103] as workers write them."""
    return np.fromfile(path, "<f4").reshape(-1, rows, columns, CHANNELS)


def compare(reference: np.ndarray, maps: np.ndarray, trained: bool) -> dict:
    """Relative errors of both heads; with trained weights, how far the reference's peaks move, input pixels."""
    error = maps - reference
    moved, lost = [], 0
    for a, b in zip(reference[..., :HEATMAPS], maps[..., :HEATMAPS]) if trained else ():
        for joint in range(HEATMAPS):
            for y, x in _peaks(a[..., joint]):
                there = _refine(a[..., joint], y, x)
                found = _highest(b[..., joint], y, x)
                if b[found[0], found[1], joint] < PEAK / 2:
                    lost += 1
                else:
                    here = _refine(b[..., joint], *found)
                    moved.append(STRIDE * float(np.hypot(here[0] - there[0], here[1] - there[1])))
    relative = lambda channels: float(np.sqrt((error[..., channels] ** 2).mean() / (reference[..., channels] ** 2).mean()))
    result = {
        "relative_rms_2d": relative(slice(HEAD2D)),
        "relative_rms_3d": relative(slice(HEAD2D, CHANNELS)),
        "relative_max": float(np.abs(error).max() / np.abs(reference).max()),
        "peaks": len(moved) + lost,
    }
    if result["peaks"]:
        result["peaks_lost"] = lost
    if moved:
        result |= {"moved_mean_px": float(np.mean(moved)), "moved_p95_px": float(np.quantile(moved, 0.95))}
    return result


def strays(found: dict) -> bool:
    """Whether these are our f32 maps, and further off than 10⁻³ of the largest value anywhere, or no numbers."""
    return found["engine"] == "ours" and found["precision"] == "f32" and not found["relative_max"] <= 1e-3


def _peaks(m: np.ndarray) -> list[tuple[int, int]]:
    """Inner cells above `PEAK` that nothing within `REACH` exceeds."""
    inner = [(y, x) for y, x in np.argwhere(m > PEAK) if 0 < y < m.shape[0] - 1 and 0 < x < m.shape[1] - 1]
    return [(int(y), int(x)) for y, x in inner if _highest(m, y, x) == (y, x)]


def _highest(m: np.ndarray, y: int, x: int) -> tuple[int, int]:
    top, left = max(1, y - REACH), max(1, x - REACH)
    window = m[top : min(m.shape[0] - 1, y + REACH + 1), left : min(m.shape[1] - 1, x + REACH + 1)]
    dy, dx = np.unravel_index(window.argmax(), window.shape)
    return top + int(dy), left + int(dx)


def _refine(m: np.ndarray, y: int, x: int) -> tuple[float, float]:
    """Summit of the parabola through three cells, along each axis."""

    def offset(a: float, b: float, c: float) -> float:
        curve = a - 2 * b + c
        return float(np.clip((a - c) / (2 * curve), -0.5, 0.5)) if curve < 0 else 0.0

    return y + offset(m[y - 1, x], m[y, x], m[y + 1, x]), x + offset(m[y, x - 1], m[y, x], m[y, x + 1])
