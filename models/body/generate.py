"""Makes the body model from MakeHuman's CC0 assets: python generate.py MAKEHUMAN OUT.npz [--bodies 1200] [--vertices 6890] [--full FULL.npz]

OUT holds SMPL's fields in small integers (see README.md); FULL the same in the plain form that other programs read.
Prints everything that README.md says about the model.  Needs numpy and scipy.
"""

from __future__ import annotations

import argparse
import pathlib

import numpy as np

import population
import tree
from decimate import decimate
from makehuman import BODY_VERTICES, BaseMesh
from regress import regressor

COMPONENTS = 10
BONES_A_VERTEX = 4
TEMPLATE_UNIT = 6e-5  # metres: 16 bits reach 1.97 m
SHAPE_UNIT = 2e-5  # metres a standard deviation
REGRESSOR_UNIT = 1 / 65535
HELD_OUT = 100


def sample(mesh: BaseMesh, weight: np.ndarray, count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """T-posed bodies [n, body vertices, 3], their 24 joints, 21 points and who is male; half and half."""
    rng = np.random.default_rng(seed)
    male = np.arange(count) % 2 == 0
    crown = int(mesh.vertices[:BODY_VERTICES, 1].argmax())
    parts = []
    for k in range(0, count, 50):  # fifty at a time: the whole mesh of a thousand bodies would be half a gigabyte
        whole = np.stack([population.draw(mesh, "male" if m else "female", rng) for m in male[k : k + 50]])
        joints, points = tree.joints24(mesh, whole), tree.joints21(mesh, whole, crown)
        parts.append(tree.t_pose(whole[:, :BODY_VERTICES], joints, points, weight))
    bodies, joints, points = (np.concatenate(p) for p in zip(*parts))
    return bodies.astype(np.float32), joints, points, male


def torso_faces(faces: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Faces that a tape round the trunk touches: not those of the arms."""
    arms = weight[:, 16:].sum(1) > 0.5
    return faces[~arms[faces].any(1)]


def fewest_bones(weight: np.ndarray) -> np.ndarray:
    """Every row's largest weights, in 255ths that sum to 255."""
    out = weight.copy()
    np.put_along_axis(out, np.argsort(-out, 1)[:, BONES_A_VERTEX:], 0, 1)
    whole = np.round(255 * out / out.sum(1, keepdims=True)).astype(int)
    rows = np.arange(len(whole))
    whole[rows, whole.argmax(1)] += 255 - whole.sum(1)
    return whole


def describe(values: np.ndarray, weight: np.ndarray, male: np.ndarray) -> None:
    print("measure: mean ± deviation in cm, men | women (survey's in brackets)")
    for k, name in enumerate(population.MEASURES):
        cells = []
        for sex, is_sex in (("male", male), ("female", ~male)):
            w = weight[is_sex] / weight[is_sex].sum()
            mean = (w * values[is_sex, k]).sum()
            deviation = (w * (values[is_sex, k] - mean) ** 2).sum() ** 0.5
            a, b = population.SURVEY[sex][name]
            cells.append(f"{100 * mean:.1f} ± {100 * deviation:.1f} ({100 * a:.0f} ± {100 * b:.0f})")
        print(f"  {name}: {' | '.join(cells)}")


def main() -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("makehuman", type=pathlib.Path)
    ap.add_argument("out", type=pathlib.Path)
    ap.add_argument("--bodies", type=int, default=1200)
    ap.add_argument("--vertices", type=int, default=6890)
    ap.add_argument("--full", type=pathlib.Path, help="also write the plain form, float32 and dense")
    a = ap.parse_args()

    mesh = BaseMesh(a.makehuman)
    weight = tree.weights(mesh)
    bodies, joints, points, male = sample(mesh, weight, a.bodies, seed=0)
    torso = torso_faces(mesh.faces, weight)
    measures = np.stack([population.measure(b, torso) for b in bodies])
    weighed = population.weigh(measures, male)
    print(f"{a.bodies} bodies drawn, worth {weighed.effective:.0f} after weighing")
    describe(measures, weighed.weight, male)

    mean = np.einsum("n,nvd->vd", weighed.weight, bodies)
    kept, faces = decimate(mean.astype(float), mesh.faces, weight, a.vertices)
    print(f"{len(kept)} vertices, {len(faces)} faces")
    bodies, skin = bodies[:, kept], fewest_bones(weight[kept])

    template = mean[kept]
    rows = (bodies - template).reshape(len(bodies), -1)
    _, s, v = np.linalg.svd(np.sqrt(weighed.weight)[:, None] * rows, full_matrices=False)
    explained = np.cumsum(s**2) / (s**2).sum()
    print("variance explained by 1, 2, 5, 10, 20 components: " + ", ".join(f"{100 * explained[k - 1]:.1f} %" for k in (1, 2, 5, 10, 20)))
    # A sign that means something: the first vertex row of each component's largest entry grows.
    sign = np.sign(v[np.arange(COMPONENTS), np.abs(v[:COMPONENTS]).argmax(1)])
    shape = (sign[:, None] * v[:COMPONENTS] * s[:COMPONENTS, None]).reshape(COMPONENTS, -1, 3).transpose(1, 2, 0)

    held, held_joints, held_points, held_male = sample(mesh, weight, HELD_OUT, seed=1)
    held_weight = population.weigh(np.stack([population.measure(b, torso) for b in held]), held_male).weight
    left = (held[:, kept] - template).reshape(HELD_OUT, -1)
    for k in (1, 2, 5, 10, 20):
        rest = left - left @ v[:k].T @ v[:k]
        error = np.linalg.norm(rest.reshape(HELD_OUT, -1, 3), axis=2).mean(1)
        print(f"vertices of {HELD_OUT} other bodies with {k} components: {1e3 * (held_weight * error).sum():.1f} mm off")

    to24 = np.stack([regressor(bodies, joints[:, j], template, weighed.weight) for j in range(24)])
    to21 = np.stack([regressor(bodies, points[:, j], template, weighed.weight) for j in range(21)])
    for name, row, truth in (("24 joints", to24, held_joints), ("21 joints", to21, held_points)):
        error = np.linalg.norm(np.einsum("jv,nvd->njd", row, held[:, kept]) - truth, axis=2)
        error = (held_weight[:, None] * error).sum(0)
        print(f"{name} of other bodies by regressor: {1e3 * error.mean():.1f} mm off, worst joint {1e3 * error.max():.1f}")

    parents = np.array(tree.PARENTS)
    small = dict(
        v_template=np.round(template / TEMPLATE_UNIT).astype(np.int16),
        v_template_unit=np.float64(TEMPLATE_UNIT),
        shapedirs=np.round(shape / SHAPE_UNIT).astype(np.int16),
        shapedirs_unit=np.float64(SHAPE_UNIT),
        f=faces.astype(np.uint16),
        weights=skin.astype(np.uint8),
        weights_unit=np.float64(1 / 255),
        J_regressor=np.round(to24 / REGRESSOR_UNIT).astype(np.uint16),
        J_regressor_unit=np.float64(REGRESSOR_UNIT),
        J_regressor_edgecap21=np.round(to21 / REGRESSOR_UNIT).astype(np.uint16),
        J_regressor_edgecap21_unit=np.float64(REGRESSOR_UNIT),
        kintree_table=np.array([np.where(parents < 0, 2**32 - 1, parents), np.arange(24)], np.uint32),
    )
    np.savez_compressed(a.out, **small)
    print(f"{a.out}: {a.out.stat().st_size / 1e6:.2f} MB")
    if a.full:
        full = {k: v for k, v in small.items() if not k.endswith("_unit")}
        for k in list(full):
            if f"{k}_unit" in small:
                full[k] = (full[k] * small[f"{k}_unit"]).astype(np.float32)
        full |= dict(f=faces.astype(np.uint32), posedirs=np.zeros((len(kept), 3, 207), np.float32))
        np.savez_compressed(a.full, **full)


if __name__ == "__main__":
    main()
