"""Turns the MATLAB ground truth of MuPoTS-3D and MPI-INF-3DHP into an archive that `edgecap eval --truth` reads.

    pip install numpy scipy h5py        # h5py only for files of version 7.3 (the test set of MPI-INF-3DHP)
    python mat_to_npz.py OUT.npz MultiPersonTestSet/TS*/annot.mat          # MuPoTS-3D
    python mat_to_npz.py OUT.npz mpi_inf_3dhp_test_set/TS*/annot_data.mat  # MPI-INF-3DHP, test
    python mat_to_npz.py OUT.npz S1/Seq1/annot.mat --camera 0              # MPI-INF-3DHP, one camera's training video

The folder of each file (TS1, …) becomes its sequence and the start of the pictures' names. 3D joints are those of the universal
skeleton, as in the sets' own protocols; `--metric` takes the true ones instead. What the arrays mean is told in
`src/lab/eval/truth/npz/mod.rs`.
"""

from __future__ import annotations

import argparse
import pathlib
import sys

import numpy as np
import scipy.io

JOINTS_TRAINING = 28
JOINTS_TEST = 17


def fail(path: pathlib.Path, expected: str, found: str) -> None:
    print(f"mat_to_npz: {path}: expected {expected}, found {found}", file=sys.stderr)
    sys.exit(65)


def load(path: pathlib.Path) -> dict[str, np.ndarray]:
    """Variables of a MATLAB file, in MATLAB's own index order."""
    try:
        if path.read_bytes()[:8] != b"MATLAB 7":
            return scipy.io.loadmat(path)
        import h5py

        with h5py.File(path) as file:
            # HDF5 lists MATLAB's axes backwards.
            return {k: np.array(v).T for k, v in file.items() if isinstance(v, h5py.Dataset) and v.dtype != object}
    except ImportError:
        fail(path, "the module h5py for a file of version 7.3", "none; pip install h5py")
    except OSError as e:
        print(f"mat_to_npz: cannot read {path}: {e}", file=sys.stderr)
        sys.exit(66)
    except Exception as e:  # scipy and h5py raise many kinds for a damaged file
        fail(path, "a MATLAB file in one piece", f"{e}; download it again")
    raise AssertionError


def mupots(path: pathlib.Path, cells: np.ndarray, solid: str) -> dict[str, np.ndarray]:
    """[frames, people] cells of structs with annot2 [2, 17], annot3 and univ_annot3 [3, 17] and isValidFrame."""
    rows, people = cells.shape
    p3 = np.zeros((rows, people, JOINTS_TEST, 3), np.float32)
    p2 = np.zeros((rows, people, JOINTS_TEST, 2), np.float32)
    valid = np.zeros((rows, people), np.uint8)
    for i, k in np.ndindex(rows, people):
        person = cells[i, k]
        person = person.item() if person.dtype == object and person.size == 1 else person
        names = person.dtype.names or ()
        if any(n not in names for n in ("annot2", solid, "isValidFrame")):
            fail(path, f"annotations with annot2, {solid} and isValidFrame", f"{names} in frame {i}")
        annotated = {n: np.asarray(person[n].ravel()[0]) for n in ("annot2", solid, "isValidFrame")}
        valid[i, k] = bool(annotated["isValidFrame"].any())
        if not valid[i, k]:
            continue
        for name, to, wide in ((solid, p3, 3), ("annot2", p2, 2)):
            if annotated[name].shape != (wide, JOINTS_TEST):
                fail(path, f"{name} of {wide}x{JOINTS_TEST}", f"{annotated[name].shape} in frame {i}")
            to[i, k] = annotated[name].T
    folder = path.resolve().parent.name
    return {
        "positions_3d": p3,
        "positions_2d": p2,
        "valid": valid,
        # Of its own people, not of those of the file with the most.
        "partial": (valid == 0).any(1).astype(np.uint8),
        "imgname": np.array([f"{folder}/img_{i:06d}.jpg" for i in range(rows)]),
        "sequence": np.array([folder] * rows),
    }


def dhp_test(path: pathlib.Path, mat: dict[str, np.ndarray], solid: str) -> dict[str, np.ndarray]:
    """annot2 [2, 17, 1, N], annot3 and univ_annot3 [3, 17, 1, N], valid_frame N."""
    arrays = {n: np.squeeze(mat[n], axis=2) if mat[n].ndim == 4 else mat[n] for n in ("annot2", solid)}
    rows = arrays[solid].shape[-1]
    for name, wide in (("annot2", 2), (solid, 3)):
        if arrays[name].shape != (wide, JOINTS_TEST, rows):
            fail(path, f"{name} of {wide}x{JOINTS_TEST}x1x{rows}", f"{mat[name].shape}")
    keep = np.flatnonzero(np.ravel(mat["valid_frame"]))
    folder = path.resolve().parent.name
    return {
        "positions_3d": arrays[solid].transpose(2, 1, 0)[keep][:, None],
        "positions_2d": arrays["annot2"].transpose(2, 1, 0)[keep][:, None],
        "valid": np.ones((len(keep), 1), np.uint8),
        "imgname": np.array([f"{folder}/imageSequence/img_{i + 1:06d}.jpg" for i in keep]),
        "sequence": np.array([folder] * len(keep)),
    }


def dhp_training(path: pathlib.Path, mat: dict[str, np.ndarray], solid: str, camera: int | None) -> dict[str, np.ndarray]:
    """A cell per camera of annot2 [N, 56], annot3 and univ_annot3 [N, 84]: the joints' coordinates one after the other."""
    cameras = list(np.ravel(mat["cameras"]))
    if camera not in cameras:
        fail(path, f"--camera to be one of {cameras}", f"{camera}")
    cell = {n: np.asarray(np.ravel(mat[n])[cameras.index(camera)]) for n in ("annot2", solid)}
    rows = len(cell[solid])
    for name, wide in (("annot2", 2), (solid, 3)):
        if cell[name].shape != (rows, wide * JOINTS_TRAINING):
            fail(path, f"{name} of {rows}x{wide * JOINTS_TRAINING}", f"{cell[name].shape}")
    return {
        "positions_3d": cell[solid].reshape(rows, 1, JOINTS_TRAINING, 3),
        "positions_2d": cell["annot2"].reshape(rows, 1, JOINTS_TRAINING, 2),
        "valid": np.ones((rows, 1), np.uint8),
        "frames": np.ravel(mat["frames"]).astype(np.int64) if "frames" in mat else np.arange(rows),
    }


def convert(path: pathlib.Path, metric: bool, camera: int | None) -> dict[str, np.ndarray]:
    mat = load(path)
    solid = "annot3" if metric else "univ_annot3"
    if "annotations" in mat:
        return mupots(path, mat["annotations"], solid)
    missing = [n for n in ("annot2", solid) if n not in mat]
    if missing or not {"valid_frame", "cameras"} & mat.keys():
        known = sorted(k for k in mat if not k.startswith("__"))
        fail(path, f"'annotations', or 'annot2', '{solid}' and 'valid_frame' or 'cameras'", f"{known}")
    if "valid_frame" in mat:
        return dhp_test(path, mat, solid)
    return dhp_training(path, mat, solid, camera)


def widen(array: np.ndarray, people: int) -> np.ndarray:
    """Room for as many people in every row; nobody is in it."""
    if array.ndim < 2:
        return array
    return np.pad(array, [(0, 0), (0, people - array.shape[1])] + [(0, 0)] * (array.ndim - 2))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("mat", type=pathlib.Path, nargs="+")
    parser.add_argument("--metric", action="store_true", help="true joints (annot3), not the universal skeleton's")
    parser.add_argument("--camera", type=int, help="camera of a training sequence of MPI-INF-3DHP")
    a = parser.parse_args()
    parts = [convert(path, a.metric, a.camera) for path in a.mat]
    if any(p.keys() != parts[0].keys() for p in parts) or (len(parts) > 1 and "frames" in parts[0]):
        fail(a.mat[0], "files of one set; a video on its own", "several kinds, or several videos")
    people = max(p["valid"].shape[1] for p in parts)
    arrays = {k: np.concatenate([widen(p[k], people) for p in parts]) for k in parts[0]}
    # A file by that name, whatever its ending.
    with open(a.out, "wb") as out:
        np.savez_compressed(out, units="mm", joint_order="mpi_inf_3dhp", **arrays)
    print(f"{a.out}: {arrays['valid'].shape[0]} rows, {int(arrays['valid'].sum())} people")


if __name__ == "__main__":
    main()
