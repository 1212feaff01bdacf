"""What Stage I really reports, for Stage II to learn from: python mistakes.py PACK OUT.pt --stage1 FILE --scenes FOLDER ...

Every person that the grouping finds in a training picture and that can be matched to a label becomes one record of 14 joints:
`conf` (0 = missed), `at` (the true joint next to which the answer lies: another one where left is taken for right or an elbow for a
hand) and `off` (from there, in statures); where the person's 3D is known, also how far the encodings are from the truth.  `apply` puts
the record of one person on the pose of another.

Of people whose 3D is known, from the renderer or from teacher.py, the answer is kept as it is, encodings included (`Seen`); of the others,
real ones in photos, too (`Looks`): they show how Stage I encodes whom no renderer drew.
"""

from __future__ import annotations

import argparse
import pathlib
import sys
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np
import torch
from torch import Tensor

import evaluate
import terms
from coco17 import LABELLED
from everyday_tiles import FRAME
from everyday_tiles import stature as in_sight
from group import people
from letterbox import letterbox
from model import SelecSLSNet, channel_mask
from pool import Stored
from precision import bf16_pays
from real import decode, decode_all, load_set
from skeleton import FLIP14, FLIP21, NB, NJ, PARENTS21

ASSOCIATION = pathlib.Path(__file__).resolve().parents[1] / "association.toml"
NEAR = 0.15  # of the stature: a joint that counts for the match
GROSS = 0.10  # farther off than this, an answer may be another joint's

Known = tuple[np.ndarray, np.ndarray, float]  # joints [14, 2] in pixels, labelled [14], stature in pixels


@dataclass
class Mistakes:
    """n people: `conf` [n, 14], `at` [n, 14] joint numbers, `off` [n, 14, 2] statures.

    An encoding is taken for `slope` [n, 3] times the truth, by axis (regression to the mean makes it shallow), and an error `wrong`
    [n, 14, 63] metres, which is known of the people of whom `lifted` [n] is true. Who was collected together has one slope.
    """

    conf: Tensor
    at: Tensor
    off: Tensor
    wrong: Tensor
    lifted: Tensor
    slope: Tensor

    def take(self, rows: slice) -> Mistakes:
        """Some of the people."""
        return Mistakes(self.conf[rows], self.at[rows], self.off[rows], self.wrong[rows], self.lifted[rows], self.slope[rows])

    def apply(self, uv: Tensor, stature_px: Tensor, rel: Tensor, g: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
        """Pixels [n, 14, 2], confidences [n, 14] and encodings [n, 14, 63] (0 where no error is known) as Stage I might report people
        standing at uv whose joints are rel [n, 21, 3]."""
        n, d = len(uv), uv.device
        i = torch.randint(len(self.conf), (n,), generator=g, device=d)
        conf, at, off = self.conf[i], self.at[i], self.off[i]
        flip = torch.tensor(FLIP14, device=d)
        mirror = torch.rand(n, generator=g, device=d) < 0.5
        m = mirror[:, None]
        conf = torch.where(m, conf[:, flip], conf)
        at = torch.where(m, flip[at[:, flip]], at)
        off = torch.where(m[..., None], off[:, flip] * torch.tensor([-1.0, 1.0], device=d), off)
        # not every record fits every pose: shrink and grow the mistakes a little, so that the same one never comes twice
        off = off * (0.7 + 0.6 * torch.rand(n, 1, 1, generator=g, device=d)) + 0.006 * torch.randn(n, NJ, 2, generator=g, device=d)
        wrong = self.wrong[i].unflatten(2, (NB, 3))
        left = torch.tensor([-1.0, 1.0, 1.0], device=d)
        wrong = torch.where(mirror[:, None, None, None], wrong[:, flip][:, :, torch.tensor(FLIP21, device=d)] * left, wrong)
        enc = ((bones(rel) * self.slope[i, None])[:, None] + wrong).flatten(2) * channel_mask(d) * self.lifted[i, None, None]
        return uv.gather(1, at[..., None].expand(-1, -1, 2)) + off * stature_px[:, None, None], conf, enc * (conf > 0)[..., None]


@dataclass
class Seen:
    """n people as Stage I reported them and as they are: `uv` [n, 14, 2] pixels, `conf` [n, 14] (0 = missed), `enc` [n, 14, 63] metres,
    `rel` [n, 21, 3] metres about the pelvis at canonical stature, view-aligned."""

    uv: Tensor
    conf: Tensor
    enc: Tensor
    rel: Tensor


@dataclass
class Looks:
    """n people as Stage I reported them, of whom no 3D is known: as in `Seen`."""

    uv: Tensor
    conf: Tensor
    enc: Tensor


def bones(rel: Tensor) -> Tensor:
    """Joints [..., 21, 3] -> vectors from each one's parent."""
    return rel - rel[..., PARENTS21, :]


def thresholds(path: pathlib.Path) -> evaluate.Group:
    """Those of the program: Stage II is to learn of whomever it will be asked about, faint and half hidden people as well."""
    t = tomllib.loads(path.read_text())
    return dict(thr=t["joint_threshold"], neck_thr=t["neck_threshold"], paf_thr=t["limb_threshold"], min_joints=t["min_joints"])


def is_open(path: pathlib.Path) -> bool:
    """Whether `main` wrote this with --open."""
    return bool(torch.load(path, map_location="cpu", weights_only=True).get("open"))


def load(paths: list[pathlib.Path], device: torch.device) -> tuple[Mistakes, Seen, Looks]:
    """What `main` wrote to these files, in a fixed random order: the first few are a fair sample."""
    files = [torch.load(path, map_location="cpu", weights_only=True) for path in paths]
    for path, d in zip(paths, files):
        if "looks" not in d:
            raise SystemExit(f"expected people without known 3D in {path}, found an older file: collect it again with mistakes.py")
        d["mistakes"]["slope"] = d["mistakes"]["slope"].expand(len(d["mistakes"]["conf"]), 3)

    def shuffled(part: str) -> dict[str, Tensor]:
        i = torch.randperm(sum(len(d[part]["conf"]) for d in files), generator=torch.Generator().manual_seed(0))
        whole = {k: torch.cat([d[part][k] for d in files])[i] for k in files[0][part]}
        return {k: (v.float() if v.is_floating_point() else v).to(device) for k, v in whole.items()}

    return Mistakes(**shuffled("mistakes")), Seen(**shuffled("seen")), Looks(**shuffled("looks"))


def match(pred: list[np.ndarray], truth: list[Known]) -> list[tuple[int, int]]:
    """Greedy matching of people [14, 3] to (joints [14, 2], labelled [14], stature in pixels)."""
    near = np.zeros((len(pred), len(truth)))
    for a, q in enumerate(pred):
        for k, (j, ok, size) in enumerate(truth):
            near[a, k] = ((np.linalg.norm(q[:, :2] - j, axis=1) < NEAR * size) & (q[:, 2] > 0) & ok).sum()
    out = []
    while near.size and near.max() >= 4:
        a, k = (int(v) for v in np.unravel_index(near.argmax(), near.shape))
        near[a], near[:, k] = 0, 0
        out.append((a, k))
    return out


def record(q: np.ndarray, j: np.ndarray, size: float) -> tuple[np.ndarray, ...]:
    """`conf`, `at` and `off` of an answer [14, 3] to a wholly labelled person."""
    gap = np.linalg.norm(q[:, None, :2] - j[None], axis=2) / size
    own = gap[np.arange(NJ), np.arange(NJ)]
    at = np.where((own > GROSS) & (gap.min(1) < 0.6 * own), gap.argmin(1), np.arange(NJ))
    return q[:, 2].clip(0, 1), at, (q[:, :2] - j[at]) / size * (q[:, 2:] > 0)


def stature(j: np.ndarray) -> float:
    """Of a labelled person in pixels: the chain head - neck - hips - longer leg, which bent limbs and perspective shorten."""

    def d(a: int, b: int) -> float:
        return float(np.linalg.norm(j[a] - j[b]))

    torso = float(np.linalg.norm(j[1] - (j[8] + j[11]) / 2))
    return max(d(0, 1) + torso + max(d(8, 9) + d(9, 10), d(11, 12) + d(12, 13)), 2.6 * torso)


@dataclass
class Shown:
    """A picture as the network takes it, 0..255, everybody in it, and the 3D [21, 3] of those of whom it is known."""

    picture: Tensor
    truth: list[Known]
    rel: list[Tensor | None]


def of_lsp(pack: pathlib.Path, photos: int, rng: np.random.Generator) -> Iterator[Shown]:
    # the teacher's rows follow the same order: LSP-Extended, then LSP
    path = pack / "teacher.npz"
    z = dict(np.load(path)) if path.exists() else None
    first = 0
    for name, share in (("lspet_train", 0.5), ("lsp_train", 0.5)) if photos else ():
        arc = load_set(pack, name)
        pick = np.sort(rng.permutation(len(arc.files))[: round(photos * share)])
        for i, image in zip(pick, decode_all([arc.files[i] for i in pick])):
            j, k = arc.joints[i], rng.uniform(0.6, 1.4)  # people of 90 to 200 px
            h, w = (int(v * k) // 16 * 16 + 32 for v in image.shape[:2])
            big, s, du, dv = letterbox(image, w, h)
            at = j[:, :2] * s + [du, dv]
            lent = z is not None and bool(z["lift"][first + i])
            rel = torch.from_numpy(z["bones"][first + i]).float() if lent and z else None
            yield Shown(big, [(at, j[:, 2] > 0, stature(at))], [rel])
        first += len(arc.files)


def of_everyday(folder: pathlib.Path, photos: int, rng: np.random.Generator) -> Iterator[Shown]:
    """Photos of everyday.py, whole, as the program shows them to the network; squeezed ones are left out."""
    z = np.load(folder / "people.npz")
    start, offset, joints, state, box = (z[k] for k in ("start", "offset", "joints", "state", "box"))
    files = np.memmap(folder / "pictures.bin", np.uint8, "r")
    labelled = np.flatnonzero([(state[a:b] == LABELLED).any() for a, b in zip(start, start[1:])] & ~z["stretched"])
    for i in np.sort(rng.permutation(labelled)[:photos]):
        own = slice(start[i], start[i + 1])
        image = decode(files[offset[i] : offset[i + 1]].tobytes())
        x, s, du, dv = letterbox(image, *(FRAME[::-1] if image.shape[0] > image.shape[1] else FRAME))
        at, ok = joints[own] * s + [du, dv], state[own] == LABELLED
        long = (box[own, 2:] - box[own, :2]).max(1) * s
        tall = in_sight(torch.from_numpy(at).float(), torch.from_numpy(ok), torch.from_numpy(long).float()).tolist()
        yield Shown(x, list(zip(at, ok, tall)), [None] * len(tall))


def of_scenes(folder: pathlib.Path, frames: int, rng: np.random.Generator) -> Iterator[Shown]:
    data = Stored(folder, 0)
    for i in rng.permutation(data.filled)[:frames]:
        j, vis, size = (data.data[k][i].numpy() for k in ("joints2d", "visible", "size_px"))
        here = [p for p in range(len(size)) if size[p] > 36 and (vis[p] > 0).sum() >= 4]
        truth = [(j[p], np.ones(NJ, bool), float(size[p])) for p in here]
        yield Shown(data.data["image"][i : i + 1].float(), truth, [data.data["rel3d"][i, p].clone() for p in here])


@torch.no_grad()
def collect(net: SelecSLSNet, pictures: Iterable[Shown], group: evaluate.Group) -> tuple[Mistakes, Seen, Looks]:
    wrong: list[tuple[np.ndarray, ...]] = []
    of: list[int] = []  # which of `seen` each of them is, or -1
    seen: list[tuple[Tensor, ...]] = []
    looks = [(torch.zeros(0, NJ, 2), torch.zeros(0, NJ), torch.zeros(0, NJ, 3 * NB).half())]
    for shown in pictures:
        with torch.autocast("cpu", torch.bfloat16, enabled=bf16_pays(torch.device("cpu"))):
            y, e = net(evaluate.as_input(shown.picture))
        pred = people(y[0].float(), **group)
        for a, k in match(pred, shown.truth):
            j, ok, size = shown.truth[k]
            if ok.all():  # an answer at an unlabelled joint could not be judged
                wrong.append(record(pred[a], j, size))
                of.append(-1 if shown.rel[k] is None else len(seen))
            uv, conf = torch.from_numpy(pred[a][:, :2]).float(), torch.from_numpy(pred[a][:, 2]).float().clamp(0, 1)
            answer = (uv, conf, evaluate.read_encodings(e[0], uv).half())
            if (r := shown.rel[k]) is not None:
                seen.append((*answer, r))
            else:
                looks.append(tuple(t[None] for t in answer))  # type: ignore[arg-type]
    if not wrong or not seen:
        raise SystemExit(
            f"expected people whom the network finds where labels have them, found {len(wrong)} with all joints labelled and {len(seen)} with known 3D:"
            " give weights that are trained, the --association that was fitted to them, or more pictures"
        )
    conf, at, off = (torch.from_numpy(np.stack(x)) for x in zip(*wrong))
    known = Seen(*(torch.stack(x) for x in zip(*seen)))
    slope, error = encodings(known)
    which = torch.tensor(of)
    lifted = which >= 0
    return Mistakes(conf.float(), at.long(), off.float(), error[which.clamp_min(0)] * lifted[:, None, None], lifted, slope.expand(len(at), 3)), known, Looks(*(torch.cat(x) for x in zip(*looks)))


def encodings(seen: Seen) -> tuple[Tensor, Tensor]:
    """How the encodings of `seen` follow the truth: their slope over it by axis [3], and what the slope leaves, [n, 14, 63] (half)."""
    said = seen.enc.float().unflatten(2, (NB, 3))
    true = bones(seen.rel)[:, None].expand_as(said)
    there = channel_mask().unflatten(1, (NB, 3)) * (seen.conf > 0)[:, :, None, None]

    def sum_(x: Tensor) -> Tensor:
        return (x * there).sum((0, 1, 2))

    n = sum_(torch.ones_like(said)).clamp_min(1)
    centred = true - sum_(true) / n
    slope = sum_(centred * (said - sum_(said) / n)) / sum_(centred.square()).clamp_min(1e-6)
    return slope, ((said - true * slope) * there).flatten(2).half()


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("pack", type=pathlib.Path)
    ap.add_argument("out", type=pathlib.Path)
    ap.add_argument("--stage1", type=pathlib.Path, required=True, help="safetensors file, or a run's folder")
    ap.add_argument("--scenes", type=pathlib.Path, nargs="*", default=[])
    ap.add_argument("--photos", type=int, default=1200, help="of LSP's; 0 with --open")
    ap.add_argument("--everyday", type=pathlib.Path, help="folder of everyday.py: real people for stage2.py --keep")
    ap.add_argument("--everyday-photos", type=int, default=2600)
    ap.add_argument("--open", action="store_true", help="only open scenes, and what open weights say of them")
    ap.add_argument("--frames", type=int, default=600, help="of each folder of scenes")
    ap.add_argument("--association", type=pathlib.Path, default=ASSOCIATION, help="toml with the thresholds that the program asks these weights by")
    ap.add_argument("--threads", type=int, default=1)
    ap.add_argument("--seed", type=int, default=1)
    a = ap.parse_args(argv)
    if a.open:
        a.photos = 0
        terms.require_open_weights(a.stage1)
        for folder in a.scenes + ([a.everyday] if a.everyday else []):
            terms.ingredients(folder)
    if not a.scenes and not (a.photos and (a.pack / "teacher.npz").exists()):
        raise SystemExit("expected people whose 3D is known, found none: give --scenes, or a pack with teacher.npz and --photos")
    torch.set_num_threads(a.threads)
    file = a.stage1 if a.stage1.is_file() else None
    net, _, _ = evaluate.load(a.stage1, torch.device("cpu"), file)
    group = thresholds(a.association)
    rng = np.random.default_rng(a.seed)
    pictures = chain(of_lsp(a.pack, a.photos, rng), *(of_scenes(f, a.frames, rng) for f in a.scenes))
    if a.everyday:
        pictures = chain(pictures, of_everyday(a.everyday, a.everyday_photos, rng))
    m, known, looks = collect(net.to(memory_format=torch.channels_last), pictures, group)
    torch.save({"mistakes": m.__dict__, "seen": known.__dict__, "looks": looks.__dict__, "open": a.open}, a.out)
    seen = m.conf > 0
    own = m.at == torch.arange(NJ)
    print(f"encodings' slope over the truth: {m.slope[0].tolist()}; their error is known of {int(m.lifted.sum())} people")
    print(f"{len(known.conf)} people with known 3D, {len(looks.conf)} without; {len(m.conf)} with mistakes to learn from, {seen.float().sum(1).mean():.1f} joints each, {100 * (~own & seen).sum() / seen.sum():.1f} % at another joint,")
    print(f"the others {m.off[seen & own].norm(dim=1).median():.3f} statures off in the median, {m.off[seen & own].norm(dim=1).quantile(0.9):.3f} at 90 %")


if __name__ == "__main__":
    main(sys.argv[1:])
