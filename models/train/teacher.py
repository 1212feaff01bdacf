"""BlazePose's answers on the packed pictures of people: python teacher.py PACK [--model heavy.tflite] [--limit N].

Adds `teacher.npz` to the pack, one row a training picture (LSP-Extended, then LSP):

    ok      bool    the answer agrees with the picture's own labels: it is the same person, and no side is mistaken for the other
    lift    bool    it agrees closely enough to lend its depth: the 3D labels may be used
    joints  f32     [n, 14, 3] x, y in the packed picture's pixels, visibility 0..1 (head top and neck are not BlazePose's: 0)
    bones   f16     [n, 21, 3] joints relative to the pelvis, metres at 1.70 m stature, x right, y down, z forward, view-aligned
    mask    u8      [n, S/2, S/2] how much of the person covers a cell of 2 x 2 pixels, 0..255

Needs mediapipe (Apache-2.0, model included); nothing else of the kit but depth.py does.  Pictures LSP labels well are worth more than any
teacher, so there its 2D only fills joints that are left out; LSP-Extended's labels are mended by it (real.mend).
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import pathlib
import sys
from multiprocessing import Pool as Processes

import numpy as np

from real import TAUGHT, TEACHER, decode, load_set
from skeleton import CANONICAL_STATURE_M, JOINTS21, NJ, ROOT

# Our evidence joints among BlazePose's 33 landmarks (head top and neck have none).
LANDMARK = {2: 12, 3: 14, 4: 16, 5: 11, 6: 13, 7: 15, 8: 24, 9: 26, 10: 28, 11: 23, 12: 25, 13: 27}
MISSING = np.zeros((33, 4), np.float32)


def skeleton21(w: np.ndarray) -> np.ndarray:
    """BlazePose's world landmarks [33, 3] -> our 21 joints about the pelvis, metres at canonical stature.

    Joints that BlazePose lacks are placed by the proportions of the training body between those it has.
    """
    out = np.zeros((len(JOINTS21), 3), np.float32)
    for j, k in LANDMARK.items():
        out[j] = w[k]
    pelvis, sho, ears = w[[23, 24]].mean(0), w[[11, 12]].mean(0), w[[7, 8]].mean(0)
    up = sho - pelvis
    out[ROOT] = pelvis
    out[15] = pelvis + 0.45 * up  # spine
    out[1] = sho + 0.08 * up  # the neck lies above the line between the shoulders
    out[16] = out[1] + 0.75 * (ears - out[1])  # head: where the skull begins
    out[0] = ears + 0.9 * (ears - out[1])  # top: as far above the ears as they are above the neck, nearly
    # BlazePose marks knuckles and the balls of the feet, our tips lie beyond
    for tip, end, marks, factor in ((17, 4, [18, 20, 16], 1.7), (18, 7, [17, 19, 15], 1.7), (19, 10, [32], 1.5), (20, 13, [31], 1.5)):
        out[tip] = out[end] + factor * (w[marks].mean(0) - out[end])
    return out - pelvis


TORSO_AND_LEGS = 0.75  # shoulder line to hips and hips to ankles, over stature, of the training bodies


def stature(j: np.ndarray) -> float:
    """Stature implied by the bones of [21, 3] that BlazePose measures best: torso, thighs and shanks."""
    legs = sum(float(np.linalg.norm(j[a] - j[b])) for a, b in ((8, 9), (9, 10), (11, 12), (12, 13))) / 2
    torso = float(np.linalg.norm(j[[2, 5]].mean(0) - j[[8, 11]].mean(0)))
    return (legs + torso) / TORSO_AND_LEGS


def canonical(w: np.ndarray) -> tuple[np.ndarray, float]:
    """BlazePose's world landmarks [33, 3] -> our 21 joints about the pelvis at canonical stature, and the stature in metres that they had."""
    j = skeleton21(w)
    tall = stature(j)
    return j * (CANONICAL_STATURE_M / max(tall, 0.5)), tall


def evidence(flat: np.ndarray) -> np.ndarray:
    """BlazePose's landmarks [33, 4] (x, y, z, visibility) -> x, y, visibility of our evidence joints [14, 3]; zeros where it has none."""
    out = np.zeros((NJ, 3), np.float32)
    for j, k in LANDMARK.items():
        out[j] = flat[k, [0, 1, 3]]
    return out


def require_mediapipe() -> None:
    """Ends the program where there is no mediapipe with the old interface: a pool would start its processes again for ever."""
    found = importlib.util.find_spec("mediapipe")
    if found is None or found.origin is None or not (pathlib.Path(found.origin).parent / "python/solutions/pose.py").exists():
        raise SystemExit("expected mediapipe with mediapipe.solutions.pose, found none: pip install mediapipe==0.10.21")


def with_heavy_model(model: pathlib.Path) -> None:
    """Put the heavy model where mediapipe looks for it; the wheel has not got it."""
    import mediapipe as mp

    home = pathlib.Path(mp.__file__).parent / "modules/pose_landmark/pose_landmark_heavy.tflite"
    if not home.exists():
        home.write_bytes(model.read_bytes())


_pose = None


def start(model: pathlib.Path | None, outline: bool = True) -> None:
    """Make a process ready for `ask`."""
    global _pose
    os.environ["TF_CPP_MIN_LOG_LEVEL"] = os.environ["GLOG_minloglevel"] = "3"
    import mediapipe as mp

    if model:
        with_heavy_model(model)
    _pose = mp.solutions.pose.Pose(
        static_image_mode=True,
        model_complexity=2 if model else 1,
        enable_segmentation=outline,
        smooth_segmentation=False,
        min_detection_confidence=0.3,
    )


def ask(image: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """RGB uint8 [h, w, 3] -> BlazePose's landmarks [33, 4] (x, y in the picture's pixels, z, visibility), its world landmarks [33, 3] (metres
    about the hips, x right, y down, z forward), both zero where it sees nobody, and how much of the person a pixel shows [h, w], 0..1."""
    h, w = image.shape[:2]
    o = _pose.process(image)
    if not o.pose_landmarks or not o.pose_world_landmarks:
        return MISSING.copy(), MISSING[:, :3].copy(), None
    flat = np.array([[p.x * w - 0.5, p.y * h - 0.5, p.z, p.visibility] for p in o.pose_landmarks.landmark], np.float32)
    return flat, np.array([[p.x, p.y, p.z] for p in o.pose_world_landmarks.landmark], np.float32), o.segmentation_mask


def _ask(job: tuple[bytes, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    buf, side = job
    im = decode(buf)
    h, w = im.shape[:2]
    # a margin lets the detector see people who fill the picture
    m = 24
    flat, world, outline = ask(np.pad(im, ((m, m), (m, m), (0, 0)), mode="edge"))
    mask = np.zeros((side // 2, side // 2), np.uint8)
    if flat.any():
        flat[:, :2] -= m
    if outline is not None:
        s = np.pad(outline[m:-m, m:-m], ((0, h % 2), (0, w % 2)), mode="edge")
        s = s.reshape(s.shape[0] // 2, 2, s.shape[1] // 2, 2).mean((1, 3))
        mask[: s.shape[0], : s.shape[1]] = (s * 255).round().clip(0, 255)
    return flat, world, mask


def agreement(mine: np.ndarray, labels: np.ndarray) -> tuple[float, float]:
    """Share of the labelled joints within 0.25 of the person's size, and their mean distance over that size."""
    k = np.array([j for j in LANDMARK if labels[j, 2] > 0], int)
    if len(k) < 6:
        return 0.0, 9.0
    p = labels[labels[:, 2] > 0, :2]
    size = 0.5 * float(np.ptp(p, axis=0).max()) + 8
    d = np.linalg.norm(mine[k, :2] - labels[k, :2], axis=1) / size
    return float((d < 0.25).mean()), float(d.mean())


def lends(share: float, mean: float, tall: float) -> bool:
    """Whether depth may be learnt from an answer that agrees so closely with the labels (`agreement`) and makes the person so tall, in metres."""
    return share >= 0.9 and mean < 0.12 and 1.2 < tall < 2.2


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("pack", type=pathlib.Path)
    ap.add_argument("--model", type=pathlib.Path, help="pose_landmark_heavy.tflite (npm package @mediapipe/pose); without it the wheel's own")
    ap.add_argument("--processes", type=int, default=1)
    ap.add_argument("--limit", type=int, default=0, help="pictures of each set")
    a = ap.parse_args(argv)
    require_mediapipe()
    sets = [load_set(a.pack, n, a.limit) for n in TAUGHT]
    files = [f for s in sets for f in s.files]
    labels = np.concatenate([s.joints for s in sets])
    side = int(np.concatenate([s.size for s in sets]).max())
    side += side % 2
    n = len(files)
    out = dict(
        ok=np.zeros(n, bool),
        lift=np.zeros(n, bool),
        joints=np.zeros((n, NJ, 3), np.float32),
        bones=np.zeros((n, len(JOINTS21), 3), np.float16),
        mask=np.zeros((n, side // 2, side // 2), np.uint8),
    )
    ratio = []
    with Processes(a.processes, start, (a.model,)) as pool:
        for i, (flat, world, mask) in enumerate(pool.imap(_ask, ((f, side) for f in files), chunksize=16)):
            if not flat.any():
                continue
            out["joints"][i] = evidence(flat)
            share, mean = agreement(out["joints"][i], labels[i])
            out["bones"][i], tall = canonical(world)
            ratio.append(tall)
            out["ok"][i], out["lift"][i] = share >= 0.75, lends(share, mean, tall)
            out["mask"][i] = mask
            if i % 500 == 499:
                print(f"{i + 1} of {n}: same person {out['ok'][: i + 1].mean():.2f}, lend depth {out['lift'][: i + 1].mean():.2f}", flush=True)
    np.savez_compressed(a.pack / TEACHER, **out)
    print(f"{n} pictures; median stature BlazePose gives {np.median(ratio):.2f} m")


if __name__ == "__main__":
    main(sys.argv[1:])
