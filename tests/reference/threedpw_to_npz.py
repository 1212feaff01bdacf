"""Turns the annotations of 3DPW (3D Poses in the Wild) into an archive that `edgecap eval --truth` reads.

    pip install numpy
    python threedpw_to_npz.py OUT.npz sequenceFiles/test/*.pkl
    for s in imageFiles/*/; do edgecap infer --quality balanced --input "$s" --jsonl "predicted/$(basename "$s").jsonl"; done
    cat predicted/*.jsonl > people.jsonl
    edgecap eval --predictions people.jsonl --truth OUT.npz

Rows are the pictures, `SEQUENCE/image_00000.jpg`; the joints are SMPL's 24 in world axes, metres, with each picture's camera. An actor
counts where the set says that the camera is right (`campose_valid`) and at least five of the 14 joints that both skeletons have lie in the
picture; joints beyond its edge are unknown in 2D. Who passes by has no label in any picture (`partial`). Its files are Python 2 pickles, which are programs: only arrays are made of them here,
and anything else that they ask for is refused.
"""

from __future__ import annotations

import argparse
import pathlib
import pickle
import sys

import numpy as np

JOINTS = 24
# SMPL's pelvis, hips, knees, ankles, neck, shoulders, elbows and wrists.
SHARED = [0, 1, 2, 4, 5, 7, 8, 12, 16, 17, 18, 19, 20, 21]
LEAST_SEEN = 5
HARMLESS = {
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    ("numpy.core.multiarray", "_reconstruct"),
    ("numpy.core.multiarray", "scalar"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "scalar"),
    ("_codecs", "encode"),
}


def fail(path: pathlib.Path, expected: str, found: str) -> None:
    print(f"threedpw_to_npz: {path}: expected {expected}, found {found}", file=sys.stderr)
    sys.exit(65)


class Arrays(pickle.Unpickler):
    """Makes arrays, numbers, strings and collections, and nothing else."""

    def find_class(self, module: str, name: str) -> object:
        if (module, name) not in HARMLESS:
            raise pickle.UnpicklingError(f"{module}.{name}, which is no array and is not run")
        return super().find_class(module, name)


def load(path: pathlib.Path) -> dict[str, object]:
    try:
        with path.open("rb") as file:
            found = Arrays(file, encoding="latin1").load()
    except OSError as e:
        print(f"threedpw_to_npz: cannot read {path}: {e}", file=sys.stderr)
        sys.exit(66)
    except Exception as e:  # a damaged pickle raises many kinds
        fail(path, "a pickle of arrays in one piece", f"{e}; download it again")
    if not isinstance(found, dict):
        fail(path, "a dictionary", type(found).__name__)
    needed = ("sequence", "jointPositions", "img_frame_ids", "cam_poses", "cam_intrinsics", "campose_valid")
    missing = [k for k in needed if k not in found]
    if missing:
        fail(path, f"a sequence of 3DPW with {', '.join(needed)}", f"none of {', '.join(missing)}")
    return found


def shaped(path: pathlib.Path, name: str, value: object, *shape: int | None) -> np.ndarray:
    """`value` as finite floats of this shape; None is any length."""
    try:
        array = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        fail(path, f"{name} of numbers", type(value).__name__)
    if array.ndim != len(shape) or any(want not in (None, has) for want, has in zip(shape, array.shape)):
        fail(path, f"{name} of shape {shape}", f"{array.shape}")
    if not np.isfinite(array).all():
        fail(path, f"{name} of finite numbers", "others")
    return array


def projected(joints: np.ndarray, pose: np.ndarray, camera: np.ndarray) -> np.ndarray:
    """World joints [N, J, 3], world to camera [N, 4, 4], intrinsics [3, 3] -> pixels and 1 where inside the picture, [N, J, 3].

    The set gives no size; its principal point is the middle of the picture.
    """
    seen = np.einsum("nij,nkj->nki", pose[:, :3, :3], joints) + pose[:, None, :3, 3]
    ahead = seen[..., 2] > 0.1
    uv = np.einsum("ij,nkj->nki", camera, seen)[..., :2] / np.where(ahead, seen[..., 2], 1)[..., None]
    size = 2 * camera[:2, 2]
    inside = ahead & (uv >= 0).all(-1) & (uv <= size - 1).all(-1)
    return np.concatenate([np.where(inside[..., None], uv, 0), inside[..., None]], -1)


def convert(path: pathlib.Path) -> dict[str, np.ndarray]:
    """One sequence as arrays; what they mean is told in `src/lab/eval/truth/npz/mod.rs`."""
    found = load(path)
    # These count poses at 60 Hz, of which every row has one; pictures are counted as rows are.
    n = len(shaped(path, "img_frame_ids", found["img_frame_ids"], None))
    pose = shaped(path, "cam_poses", found["cam_poses"], n, 4, 4)
    camera = shaped(path, "cam_intrinsics", found["cam_intrinsics"], 3, 3)
    actors, right = found["jointPositions"], found["campose_valid"]
    if not isinstance(actors, list) or not isinstance(right, list) or len(actors) != len(right) or not actors:
        fail(path, "lists 'jointPositions' and 'campose_valid' of as many actors", "others")
    solid = [shaped(path, "jointPositions", a, n, 3 * JOINTS).reshape(n, JOINTS, 3) for a in actors]
    flat = [projected(a, pose, camera) for a in solid]
    valid = [
        (shaped(path, "campose_valid", ok, n) > 0) & (uv[:, SHARED, 2].sum(1) >= LEAST_SEEN)
        for ok, uv in zip(right, flat)
    ]
    name = str(found["sequence"])
    return {
        "positions_3d": np.stack(solid, 1).astype(np.float32),
        "positions_2d": np.stack(flat, 1).astype(np.float32),
        "valid": np.stack(valid, 1).astype(np.uint8),
        "partial": np.ones(n, np.uint8),
        "camera_pose": pose[:, :3].astype(np.float32),
        "camera_matrix": np.broadcast_to(camera.astype(np.float32), (n, 3, 3)),
        "imgname": np.array([f"{name}/image_{i:05d}.jpg" for i in range(n)]),
        "sequence": np.array([name] * n),
    }


def widen(array: np.ndarray, people: int) -> np.ndarray:
    """Room for as many people in every row; nobody is in it."""
    return np.pad(array, [(0, 0), (0, people - array.shape[1])] + [(0, 0)] * (array.ndim - 2))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("pickles", type=pathlib.Path, nargs="+")
    a = parser.parse_args()
    parts = [convert(path) for path in a.pickles]
    people = max(p["valid"].shape[1] for p in parts)
    of_people = ("positions_3d", "positions_2d", "valid")
    arrays = {k: np.concatenate([widen(p[k], people) if k in of_people else p[k] for p in parts]) for k in parts[0]}
    with open(a.out, "wb") as out:
        np.savez_compressed(out, units="m", joint_order="smpl", **arrays)
    print(f"{a.out}: {len(arrays['valid'])} pictures, {int(arrays['valid'].sum())} people")


if __name__ == "__main__":
    main()
