"""Adults as they are: random MakeHuman bodies, and weights that give them the statures and girths of a measured population.

Marginals: 2012 U.S. Army Anthropometric Survey (ANSUR II), Gordon et al., NATICK/TR-15/007 (public), means and standard
deviations rounded to the centimetre: 4,082 men and 1,986 women.  Soldiers: leaner and younger than everybody.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from makehuman import BaseMesh

MEASURES = ("stature", "chest", "waist", "hips")
# (mean, standard deviation) in metres
SURVEY = {
    "male": {"stature": (1.76, 0.07), "chest": (1.06, 0.09), "waist": (0.94, 0.11), "hips": (1.02, 0.08)},
    "female": {"stature": (1.63, 0.06), "chest": (0.95, 0.08), "waist": (0.86, 0.10), "hips": (1.02, 0.08)},
}
# Heights of the girths as shares of stature: the same survey's chest, waist (omphalion) and buttock heights.
GIRTH_AT = {"chest": 0.725, "waist": 0.600, "hips": 0.508}

# Measures that MakeHuman changes besides its main factors.
DETAILS = (
    "legs/upperlegs-height legs/lowerlegs-height legs/measure-thigh-circ legs/measure-calf-circ arms/measure-lowerarm-length "
    "arms/measure-upperarm-length arms/measure-upperarm-circ torso/measure-shoulder-dist torso/measure-waist-circ "
    "torso/measure-hips-circ torso/measure-bust-circ torso/torso-scale-vert torso/measure-napetowaist-dist torso/torso-scale-depth "
    "hip/hip-scale-horiz neck/measure-neck-height stomach/stomach-tone buttocks/buttocks-volume head/head-scale-vert"
).split()
DETAIL_SPREAD = 0.3  # standard deviation, of a target's full strength
DETAIL_MEAN = {"torso/measure-bust-circ": 0.4, "torso/measure-waist-circ": 0.5, "torso/measure-hips-circ": 0.5}


def thirds(x: float) -> dict[str, float]:
    """MakeHuman's blend of a factor from 0 to 1 between three targets."""
    low, high = max(0.0, 1 - 2 * x), max(0.0, 2 * x - 1)
    return {"min": low, "average": 1 - low - high, "max": high}


def draw(mesh: BaseMesh, sex: str, rng: np.random.Generator) -> np.ndarray:
    """One body [vertices, 3] of the whole base mesh, wider spread than any population; `weigh` puts that right."""

    def factor(mean: float, spread: float) -> float:
        return float(np.clip(rng.normal(mean, spread), 0, 1))

    body = mesh.vertices.copy()

    def add(name: str, weight: float) -> None:
        target = mesh.target(name) if weight > 1e-6 else None
        if target is not None:
            body[target[0]] += weight * target[1]

    own = rng.uniform(0.85, 1.0)
    age = rng.beta(1.3, 2.2)
    # Means that put MakeHuman's lean average where the survey's girths are: raking has less to do then.
    muscle, weight = thirds(factor(0.58, 0.22)), thirds(factor(0.75, 0.28))
    height, proportion = thirds(factor(0.50, 0.05)), thirds(factor(0.5, 0.22))
    origin = rng.dirichlet([0.8, 0.8, 0.8])
    sexes = {sex: own, ("female" if sex == "male" else "male"): 1 - own}
    for g, gw in sexes.items():
        for a, aw in (("young", 1 - age), ("old", age)):
            for o, ow in zip(("african", "asian", "caucasian"), origin):
                add(f"macrodetails/{o}-{g}-{a}", gw * aw * ow)
            for m, mw in muscle.items():
                for w, ww in weight.items():
                    share, name = gw * aw * mw * ww, f"{g}-{a}-{m}muscle-{w}weight"
                    add(f"macrodetails/universal-{name}", share)
                    for end in ("min", "max"):
                        add(f"macrodetails/height/{name}-{end}height", share * height[end])
                    add(f"macrodetails/proportions/{name}-uncommonproportions", share * proportion["min"])
                    add(f"macrodetails/proportions/{name}-idealproportions", share * proportion["max"])
    for detail in DETAILS:
        x = float(np.clip(rng.normal(DETAIL_MEAN.get(detail, 0.0), DETAIL_SPREAD), -1, 1))
        add(f"{detail}-{'incr' if x > 0 else 'decr'}", abs(x))
    return body


def girth(vertices: np.ndarray, faces: np.ndarray, height: float) -> float:
    """Length of a tape round the cut of the mesh [v, 3] at y = `height`, metres: the cut's convex outline."""
    y = vertices[:, 1] - height
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    edges = edges[(y[edges[:, 0]] < 0) != (y[edges[:, 1]] < 0)]
    a, b = edges.T
    t = (y[a] / (y[a] - y[b]))[:, None]
    cut = (vertices[a] + t * (vertices[b] - vertices[a]))[:, [0, 2]]
    hull = convex_outline(cut)
    return float(np.linalg.norm(hull - np.roll(hull, 1, 0), axis=1).sum())


def convex_outline(points: np.ndarray) -> np.ndarray:
    """Convex hull of points [n, 2], in order (Andrew's monotone chain)."""

    def half(rows: np.ndarray) -> list[np.ndarray]:
        chain: list[np.ndarray] = []
        for p in rows:
            while len(chain) > 1:
                u, v = chain[-1] - chain[-2], p - chain[-2]
                if u[0] * v[1] - u[1] * v[0] > 0:
                    break
                chain.pop()
            chain.append(p)
        return chain[:-1]

    rows = np.unique(points, axis=0)
    return np.array(half(rows) + half(rows[::-1]))


def measure(vertices: np.ndarray, torso: np.ndarray) -> np.ndarray:
    """[4] stature, chest, waist and hips in metres of a T-posed body [v, 3]; `torso` are the faces that a tape goes round (no arms)."""
    stature = float(np.ptp(vertices[:, 1]))
    floor = vertices[:, 1].min()
    return np.array([stature] + [girth(vertices, torso, floor + GIRTH_AT[m] * stature) for m in MEASURES[1:]])


@dataclass
class Weighed:
    weight: np.ndarray  # [n], sums to 1
    effective: float  # (sum w)^2 / sum w^2: how many equal samples that is worth


def weigh(measures: np.ndarray, male: np.ndarray, rounds: int = 400) -> Weighed:
    """Weights by raking: bodies with `measures` [n, 4] get, sex by sex, the survey's distribution of every measure in turn.

    Distributions are normal, in bins half a deviation wide; bins without a body cannot be filled, so compare what comes out.
    """
    weight = np.ones(len(measures))
    edges = np.concatenate([[-np.inf], np.arange(-2.5, 2.6, 0.5), [np.inf]])
    share = np.diff([_normal(e) for e in edges])
    for _ in range(rounds):
        for sex, is_sex in (("male", male), ("female", ~male)):
            for k, name in enumerate(MEASURES):
                mean, deviation = SURVEY[sex][name]
                bins = np.digitize((measures[:, k] - mean) / deviation, edges[1:-1])
                for b, wanted in enumerate(share):
                    here = is_sex & (bins == b)
                    if here.any():
                        # At most fourfold from where it was: a bin of one body must not carry a population.
                        weight[here] *= np.clip(wanted / max(weight[here].sum(), 1e-12), 0.25, 4)
            weight[is_sex] *= 0.5 / weight[is_sex].sum()
            weight[is_sex] = np.minimum(weight[is_sex], 8 * np.median(weight[is_sex]) + 1.5 / is_sex.sum())
    weight /= weight.sum()
    return Weighed(weight, float(1 / (weight**2).sum()))


def _normal(x: float) -> float:
    from math import erf

    return 0.5 * (1 + erf(x / 2**0.5)) if np.isfinite(x) else float(x > 0)
