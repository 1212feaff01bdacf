"""Learn to tell people from what only looks like some: python person_score.py CANDIDATES.jsonl --held HELD.jsonl --toml ../association.toml.

`CANDIDATES` are the lines of `examples/association_candidates.rs`: looks, at every size that the program takes for photos, at pictures in which everybody is
labelled (`composites.py`, `edgecap synth`) and at photos without people, none of which the figures of the model card are measured on. A logistic regression is
fitted to every candidate's object keypoint similarity with the person it is assigned to (0: nobody, or somebody who has a better candidate). `--held` gives
looks at photos without people that nothing was trained on: the least score is the one above which reports are worth most, or higher, so that nobody is
reported in `--quiet` of these looks. Where the lines come from several combinations of settings, each gets its own score, and the one wins in which the
candidates it is fitted to and keeps are worth most: their similarity above 0.3. The file's other settings stay as they are: they have to be those of the model
that the candidates are from.
"""

from __future__ import annotations

import argparse
import json
import pathlib
import re
import sys
from dataclasses import dataclass

import numpy as np
import torch

from skeleton import NJ, NL

CROWDED = 0.1  # who is this similar to somebody without labels that count is neither right nor wrong
FEATURES = 2 * NJ + NL + 3  # of a candidate
WORTHLESS = 0.3  # a candidate of this similarity does as much good as harm
TRUST = 0.01  # weight of the ridge that keeps weights small


@dataclass
class Candidates:
    features: np.ndarray  # [n, F] as src/detect/score.rs orders them
    similarity: np.ndarray  # [n] with the person assigned to it
    look: np.ndarray  # [n] which line it is from
    source: np.ndarray  # [n] which set of pictures
    looks: dict[str, int]  # number of looks at the pictures of every set
    people: dict[str, int]  # number of people in these looks


def assign(similar: np.ndarray, crowd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[candidates, people] -> similarity of every candidate with its own person, and whether it counts."""
    own, counts = np.zeros(len(similar)), np.ones(len(similar), bool)
    free = similar.copy()
    for _ in range(min(free.shape)):
        c, p = np.unravel_index(free.argmax(), free.shape)
        if free[c, p] <= 0:
            break
        own[c] = free[c, p]
        counts[c] = not crowd[p]
        free[c], free[:, p] = -1, -1
    if crowd.any():
        counts &= similar[:, crowd].max(1) <= CROWDED
    return own, counts


KEYS = ("neck_threshold", "joint_threshold", "limb_threshold", "length_weight")  # of the association, in the order of a line's settings
Settings = tuple[float, ...]


def load(path: pathlib.Path) -> dict[Settings, Candidates]:
    rows: dict[Settings, list[dict]] = {}
    with open(path) as lines:
        for row in map(json.loads, lines):
            rows.setdefault(tuple(row["settings"]), []).append(row)
    return {t: collect(r) for t, r in rows.items()}


def collect(rows: list[dict]) -> Candidates:
    features, similarity, look, source = [], [], [], []
    looks: dict[str, int] = {}
    people: dict[str, int] = {}
    for i, row in enumerate(rows):
        looks[row["set"]] = looks.get(row["set"], 0) + 1
        people[row["set"]] = people.get(row["set"], 0) + len(row["crowd"])
        found = row["candidates"]
        if not found:
            continue
        similar = np.array([c["oks"] for c in found]).reshape(len(found), len(row["crowd"]))
        own, counts = assign(similar, np.array(row["crowd"], bool))
        for c, s, use in zip(found, own, counts):
            if use:
                features.append(c["features"])
                similarity.append(s)
                look.append(i)
                source.append(row["set"])
    wide = len(features[0]) if features else FEATURES  # where nobody is seen at all nothing else says how wide
    return Candidates(np.array(features).reshape(-1, wide), np.array(similarity), np.array(look), np.array(source), looks, people)


def fit(c: Candidates) -> tuple[np.ndarray, float]:
    """Weights [F] and bias; every set of pictures counts alike."""
    mean, spread = c.features.mean(0), c.features.std(0) + 1e-6
    x = torch.tensor((c.features - mean) / spread)
    y = torch.tensor(c.similarity)
    names, which = np.unique(c.source, return_inverse=True)
    weight = torch.tensor((len(c.source) / len(names) / np.bincount(which))[which])
    w = torch.zeros(x.shape[1] + 1, dtype=torch.float64, requires_grad=True)
    opt = torch.optim.LBFGS([w], max_iter=300, line_search_fn="strong_wolfe")

    def loss() -> torch.Tensor:
        opt.zero_grad()
        logit = x @ w[1:] + w[0]
        out = torch.nn.functional.binary_cross_entropy_with_logits(logit, y, weight=weight) + TRUST * w[1:].square().mean()
        out.backward()
        return out

    opt.step(loss)
    v = w.detach().numpy()
    weights = v[1:] / spread
    return weights, float(v[0] - weights @ mean)


def score(c: Candidates, weights: np.ndarray, bias: float) -> np.ndarray:
    return 1 / (1 + np.exp(-(c.features @ weights + bias)))


def threshold(c: Candidates, s: np.ndarray, quiet: float) -> float:
    """The score above which somebody is reported in at most 1 - `quiet` of the looks at photos without people."""
    nobody = {name: n for name, n in c.looks.items() if not c.people[name]}
    if not nobody:
        raise SystemExit("expected photos without people in --held, found none: give association_candidates a folder of them by --quiet")
    highest = [s[(c.source == name) & (c.look == i)].max() for name in nobody for i in np.unique(c.look[c.source == name])]
    total = sum(nobody.values())
    allowed = int(np.floor((1 - quiet) * total + 1e-9))
    highest = sorted(highest, reverse=True)
    return float(highest[allowed]) + 0.001 if allowed < len(highest) else 0.0


def best_threshold(c: Candidates, s: np.ndarray) -> float:
    """The score above which the candidates reported are worth most together, halfway to the next one below."""
    order = np.argsort(-s)
    last = np.cumsum(c.similarity[order] - WORTHLESS).argmax()
    return float(np.append(s[order], 0.0)[last : last + 2].mean())


def named(t: Settings) -> str:
    return " ".join(f"{key.split('_')[0]} {v}" for key, v in zip(KEYS, t))


def score_settings(weights: np.ndarray, bias: float) -> dict[str, object]:
    """The keys of `[score]`."""
    r = [round(float(v), 4) for v in weights]
    joint, squared, limb, single = r[:NJ], r[NJ : 2 * NJ], r[2 * NJ : 2 * NJ + NL], r[2 * NJ + NL :]
    return dict(bias=round(bias, 4), joint=joint, joint_squared=squared, limb=limb) | dict(zip(("found", "clearest", "highest"), single))


def written(text: str, values: dict[str, object]) -> str:
    """`text` of a TOML file with these keys replaced."""
    for key, value in values.items():
        text, n = re.subn(rf"(?m)^{key} = .*$", f"{key} = {value}", text)
        if n != 1:
            raise SystemExit(f"expected one line '{key} = …' in the TOML file, found {n}")
    return text


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("candidates", type=pathlib.Path)
    ap.add_argument("--held", type=pathlib.Path, required=True)
    ap.add_argument("--toml", type=pathlib.Path, required=True)
    ap.add_argument("--quiet", type=float, default=0.95)
    a = ap.parse_args(argv)
    train, held = load(a.candidates), load(a.held)
    if train.keys() != held.keys():
        raise SystemExit(f"expected the same settings in both files, found {sorted(train)} and {sorted(held)}")
    tried = []
    for t, c in sorted(train.items()):
        weights, bias = fit(c)
        s = score(c, weights, bias)
        least = max(threshold(held[t], score(held[t], weights, bias), a.quiet), best_threshold(c, s))
        kept = s >= least
        tried.append(((c.similarity[kept] - WORTHLESS).sum(), (c.similarity[kept] >= 0.5).sum(), (c.similarity[kept] < WORTHLESS).sum(), t, weights, bias, least))
        print(
            f"{named(t)}: least score {least:.3f}, worth {tried[-1][0]:.0f}, "
            f"people similar by 0.5 or more {tried[-1][1]}, candidates below {WORTHLESS} {tried[-1][2]}"
        )
    *_, t, weights, bias, least = max(tried, key=lambda x: x[0])
    values = score_settings(weights, bias) | dict(zip(KEYS, t)) | dict(min_score=round(least, 3))
    a.toml.write_text(written(a.toml.read_text(), values))
    for c, name in ((train[t], "fitted to"), (held[t], "held out")):
        s = score(c, weights, bias)
        for src in c.looks:
            k = c.source == src
            right = c.similarity[k] >= 0.5
            print(
                f"{name} {src}: {k.sum()} candidates in {c.looks[src]} looks, similar by 0.5 or more {right.sum()}, of these kept "
                f"{(right & (s[k] >= least)).sum()}; others kept {(~right & (s[k] >= least)).sum()}"
            )
    print(f"written: {named(t)}, min_score {least:.3f}")


if __name__ == "__main__":
    main(sys.argv[1:])
