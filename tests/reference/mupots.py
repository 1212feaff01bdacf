"""Compares `edgecap eval` with MuPoTS-3D's own protocol on the same predictions.

    pip install numpy scipy        # and h5py for files of version 7.3, which are left out without it
    python mupots.py EDGECAP

Writes random sequences as the set's `annot.mat`, turns them into an archive by `mat_to_npz.py`, and measures random predictions
(missing joints, missed and invented people) twice: by `edgecap eval` and by the formulas of `mpii_mupots_multiperson_eval.m`
(relative), `mpii_multiperson_get_identity_matching.m` and `mpii_map_to_gt_bone_lengths.m`, joint by joint. The same for the
files of MPI-INF-3DHP with known errors. Exits with 1 when a figure differs by more than 1e-6.
"""

from __future__ import annotations

import importlib.util
import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
import scipy.io

HERE = pathlib.Path(__file__).parent
# From 1, as the set's tools count.
PARENTS = [2, 16, 2, 3, 4, 2, 6, 7, 15, 9, 10, 15, 12, 13, 15, 15, 2]
TRAVERSAL = [16, 2, 1, 17, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14]
MATCHING = range(1, 14)
PELVIS = 14
SPINE = 15
SCORED = 14
BODY_JOINTS = 21
# A man standing, millimetres, in the order of the test sets.
FIGURE = np.array(
    [[0, -800, 0], [0, -520, 30], [-180, -500, 20], [-250, -220, 0], [-260, 30, -60], [180, -500, 40], [240, -220, 60], [250, 30, 0]]
    + [[-120, 80, 0], [-140, 500, -50], [-150, 900, 40], [120, 80, 10], [130, 500, -20], [140, 900, 80], [0, 0, 0], [0, -250, 20], [0, -660, 0]],
    float,
)


def seen(p: np.ndarray) -> np.ndarray:
    return np.stack([960 + 1500 * p[..., 0] / p[..., 2], 540 + 1500 * p[..., 1] / p[..., 2]], -1)


def rescaled(pred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    out = pred.copy()
    for j in TRAVERSAL:
        j, parent = j - 1, PARENTS[j - 1] - 1
        bone = pred[j] - pred[parent]
        length = np.linalg.norm(truth[j] - truth[parent])
        out[j] = out[parent] + bone * length / np.linalg.norm(bone)
    return out


def score(errors: list[np.ndarray]) -> tuple[float, float]:
    all_errors = np.array(errors)[:, :SCORED]
    return float((all_errors < 150).mean()), float(np.mean([(all_errors < t).mean() for t in range(0, 151, 5)]))


def reference(sequences: dict[str, list], predicted: dict[str, list]) -> dict[str, tuple[float, float, float]]:
    out = {}
    for mode in ("all", "matched"):
        pooled, shares = [], []
        for name, frames in sequences.items():
            errors = []
            for i, people in enumerate(frames):
                people = [p for p in people if p["isValidFrame"]]
                candidates = predicted[f"{name}/img_{i:06d}.jpg"]
                taken = [False] * len(candidates)
                for person in people:
                    counts = []
                    for k, c in enumerate(candidates):
                        near = np.all(np.abs(person["annot2"].T[MATCHING] - c["flat"][MATCHING]) < 40, axis=1)
                        counts.append(0 if taken[k] else int((near & c["visible"][MATCHING]).sum()))
                    truth = person["univ_annot3"].T
                    truth = truth - truth[PELVIS]
                    if counts and max(counts) > 0:
                        best = int(np.argmax(counts))
                        taken[best] = True
                        solid = candidates[best]["solid"][:17]
                        pred = rescaled(solid - solid[PELVIS], truth)
                        errors.append(np.linalg.norm(pred - truth, axis=1))
                    elif mode == "all":
                        errors.append(np.full(17, 1e5))
            pooled += errors
            shares.append(score(errors)[0])
        out[mode] = (*score(pooled), float(np.mean(shares)))
    return out


def measured(edgecap: str, folder: pathlib.Path, mats: list[pathlib.Path], lines: list[dict], *more: str) -> dict:
    (folder / "p.jsonl").write_text("\n".join(json.dumps(line) for line in lines))
    subprocess.run([sys.executable, HERE / "mat_to_npz.py", folder / "t.npz", *mats, *more], check=True, stdout=subprocess.DEVNULL)
    call = [edgecap, "eval", "--predictions", folder / "p.jsonl", "--truth", folder / "t.npz", "--json", "-"]
    return json.loads(subprocess.run(call, check=True, stdout=subprocess.PIPE).stdout)


def line(k: int, source: str, people: list[dict]) -> dict:
    """A line of `infer --jsonl`: people with pixels `flat` [17, 2], `visible` [17] and millimetres `solid` [21, 3]."""
    people = [
        {
            "score": 0.5,
            "joints2d": [[*uv, float(v)] for uv, v in zip(p["flat"][:14].tolist(), p["visible"])],
            "joints3d": ((p["solid"] - p["solid"][PELVIS]) / 1000).tolist(),
        }
        for p in people
    ]
    return {"frame": k, "time_ns": k, "source": source, "width": 1920, "height": 1080, "people": people}


def person(r: np.random.Generator, figure: np.ndarray, noise: float) -> dict:
    solid = np.zeros((BODY_JOINTS, 3))
    solid[:17] = figure + r.normal(0, noise, figure.shape)
    visible = r.random(17) < 0.9
    return {"solid": solid, "flat": (seen(figure) + r.normal(0, 25, (17, 2))).astype(np.float32).astype(float), "visible": visible}


def crowd(edgecap: str, r: np.random.Generator) -> bool:
    sequences, predicted = {}, {}
    for name, people in (("TS1", 2), ("TS2", 3)):
        sequences[name] = []
        for i in range(12):
            figures = [FIGURE * r.uniform(0.8, 1.1) + [900 * k - 700, r.normal(0, 50), 4000 + 300 * k] for k in range(people)]
            figures = [f + r.normal(0, 15, f.shape) for f in figures]
            sequences[name].append(
                [
                    {"annot2": seen(f).T, "annot3": f.T, "univ_annot3": 1.1 * f.T, "isValidFrame": np.uint8(r.random() < 0.9)}
                    for f in figures
                ]
            )
            found = [person(r, f, 45) for f in figures if r.random() < 0.8]
            found += [person(r, FIGURE + [r.uniform(-1000, 1000), 0, 4500], 45) for _ in range(r.integers(0, 2))]
            predicted[f"{name}/img_{i:06d}.jpg"] = found
    with tempfile.TemporaryDirectory() as folder:
        folder, mats = pathlib.Path(folder), []
        for name, frames in sequences.items():
            cells = np.empty((len(frames), len(frames[0])), object)
            for i, k in np.ndindex(cells.shape):
                cells[i, k] = frames[i][k]
            (folder / name).mkdir()
            mats.append(folder / name / "annot.mat")
            scipy.io.savemat(mats[-1], {"annotations": cells}, do_compression=True)
        lines = [line(k, source, people) for k, (source, people) in enumerate(predicted.items())]
        report = measured(edgecap, folder, mats, lines)
        with np.load(folder / "t.npz") as archive:
            partial = archive["partial"].tolist()
    # Where somebody of the sequence has no label, not where the other sequence has more people.
    unlabelled = [int(any(not p["isValidFrame"] for p in people)) for frames in sequences.values() for people in frames]
    ours = {m["protocol"]: (m["pck150"], m["auc"], m["pck150_per_sequence"]) for m in report["mupots"]}
    theirs = reference(sequences, predicted)
    print("MuPoTS-3D", ours, theirs)
    return partial == unlabelled and all(np.allclose(ours[m], theirs[m], rtol=0, atol=1e-6) for m in theirs)


def write_73(path: pathlib.Path, arrays: dict[str, np.ndarray]) -> None:
    """A MATLAB file of version 7.3: HDF5 behind 512 bytes of its own, axes backwards."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, array in arrays.items():
            file[name] = np.asarray(array).T
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(128))


def single(edgecap: str, r: np.random.Generator, training: bool, save=scipy.io.savemat) -> bool:
    """MPI-INF-3DHP: every wrist 60 mm too near, a spine 200 mm off, and one frame that is not valid. The set's 3DPCK has no spine."""
    frames = 6
    figures = np.stack([FIGURE + [0, 0, 4000 + 50 * i] for i in range(frames)])
    figures += r.normal(0, 10, figures.shape)
    found = []
    for f in figures:
        # Of the training set's joints the hands and toes lie at the pelvis here, and so they do in the prediction.
        solid = np.tile(f[PELVIS], (BODY_JOINTS, 1))
        solid[:17] = f
        solid[[4, 7], 2] -= 60
        solid[SPINE, 0] += 200
        found.append({"solid": solid, "flat": seen(f), "visible": np.ones(17, bool)})
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        (folder / "TS1").mkdir()
        mat = folder / "TS1" / "annot.mat"
        if training:
            relevant = np.array([8, 6, 15, 16, 17, 10, 11, 12, 24, 25, 26, 19, 20, 21, 5, 4, 7]) - 1
            whole = np.zeros((frames, 28, 3))
            whole[:] = figures[:, 14:15]
            whole[:, relevant] = figures
            flat, solid = (np.empty(2, object) for _ in range(2))
            for c in range(2):
                # The second camera sees something else.
                flat[c], solid[c] = seen(whole).reshape(frames, -1) + 500 * c, whole.reshape(frames, -1) * (1 + c)
            named = {"annot2": flat[:, None], "annot3": solid[:, None], "univ_annot3": solid[:, None], "cameras": [[0], [4]], "frames": np.arange(frames)}
            scipy.io.savemat(mat, named)
            lines = [line(k, "", [p]) for k, p in enumerate(found)]
            report = measured(edgecap, folder, [mat], lines, "--camera", "0")
            people, joints = frames, BODY_JOINTS
        else:
            valid = np.ones((frames, 1), np.uint8)
            valid[2] = 0
            arrays = {"annot2": seen(figures), "annot3": 0.9 * figures, "univ_annot3": figures}
            arrays = {k: v.transpose(2, 1, 0)[:, :, None] for k, v in arrays.items()}
            save(mat, {**arrays, "valid_frame": valid})
            lines = [line(k, f"TS1/imageSequence/img_{k + 1:06d}.jpg", [p]) for k, p in enumerate(found)]
            report = measured(edgecap, folder, [mat], lines)
            people, joints = frames - 1, 17
    pose = report["pose3d"]
    print("MPI-INF-3DHP", "training" if training else "test", pose)
    right = pose["people"] == pose["truth"] == people and pose["pck150"] == 1
    return right and abs(pose["mpjpe_mm"] - (2 * 60 + 200) / joints) < 1e-3


def main() -> None:
    edgecap = str(pathlib.Path(sys.argv[1]).resolve())
    r = np.random.default_rng(1)
    good = [crowd(edgecap, r), single(edgecap, r, training=False), single(edgecap, r, training=True)]
    if importlib.util.find_spec("h5py"):
        good.append(single(edgecap, r, training=False, save=write_73))
    else:
        print("skipped: files of version 7.3, which h5py writes")
    sys.exit(0 if all(good) else 1)


if __name__ == "__main__":
    main()
