"""Measure weights on held-out pictures; writes OUT/eval.json and overlays.

    python evaluate.py PACK OUT [--stage1 FILE.safetensors] [--stage2 FILE.safetensors] [--data DATA] [--scenes FOLDER]

Without `--stage1` the checkpoint in OUT/ckpt is measured, without `--stage2` OUT/stage2.pt if it is there.

lsp      PCK@0.2 of the torso on LSP-test: one person a picture, each joint is the maximum of its map
photos   recall, OKS and false people on photos of several people, whole frames of 512 x 320 (needs DATA)
empty    share of held-out photos without people in which nobody is reported
scenes   people, joints and 3D on synthetic scenes of held-out motion over held-out photos
real3d   PA-MPJPE on four real photos with true 3D, root-aligned MPJPE after rescaling (needs DATA)
"""

from __future__ import annotations

import argparse
import copy
import json
import pathlib
import sys
import time

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

import checkpoint
import photos
import quant
import weights
from distil import mirror_maps
from group import argmax_joints, people
from letterbox import letterbox, to_original
from model import SelecSLSNet, Stage2, channel_mask, stage2_input
from pool import Stored
from real import decode_all, load_photos, load_set
from skeleton import JOINTS14, LIMBS, NJ, STRIDE
from measure import errors, naive, procrustes

Group = dict[str, float]  # thresholds of group.people


def load(out: pathlib.Path, dev: torch.device, stage1: pathlib.Path | None = None, stage2: pathlib.Path | None = None) -> tuple[SelecSLSNet, Stage2 | None, dict]:
    net = SelecSLSNet().to(dev)
    ema = copy.deepcopy(net)
    if stage1:
        meta = json.loads(weights.load_into(ema, stage1).get("contract", "{}"))
    else:
        meta = checkpoint.load(out / "ckpt", net, ema, None, dev)
        if meta.get("quant"):
            quant.prepare(ema)
            checkpoint.load(out / "ckpt", net, ema, None, dev)
    s2 = None
    if stage2:
        s2 = Stage2().to(dev)
        weights.load_into(s2, stage2)
    elif (out / "stage2.pt").exists():
        s2 = Stage2().to(dev)
        s2.load_state_dict(torch.load(out / "stage2.pt", map_location=dev, weights_only=True)["net"])
    if s2 is not None:
        s2.eval()
    return ema.eval(), s2, meta


def as_input(image: Tensor) -> Tensor:
    """0..255 -> what the network takes."""
    return (image / 255 - 0.5).contiguous(memory_format=torch.channels_last)


@torch.no_grad()
def lsp(net: SelecSLSNet, pack: pathlib.Path, dev: torch.device, limit: int, scale: float, mirror: bool = True, tile: int = 256) -> dict:
    """Each joint is the maximum of its map (the set has one person a picture); plain and averaged with the mirror image."""
    arc = load_set(pack, "lsp_test", limit)
    ims, off = [], []
    for im in decode_all(arc.files):
        t = torch.from_numpy(im).permute(2, 0, 1)[None].float()
        s = min(scale, (tile - 8) / max(t.shape[2:]))
        t = F.interpolate(t, size=[round(t.shape[2] * s), round(t.shape[3] * s)], mode="bilinear", antialias=True, align_corners=False)
        h, w = t.shape[2:]
        y, x = (tile - h) // 2, (tile - w) // 2
        ims.append(F.pad(t, (x, tile - w - x, y, tile - h - y), value=128))
        off.append((x, y, w / im.shape[1], h / im.shape[0]))
    hit: dict[str, list[np.ndarray]] = {"plain": []} | ({"mirrored": []} if mirror else {})
    o = np.array(off, np.float32)
    for i in range(0, len(ims), 50):
        x = as_input(torch.cat(ims[i : i + 50]).to(dev))
        maps = {"plain": net(x, len(x))[0][:, :NJ].float()}
        if mirror:
            b = mirror_maps(net(x.flip(3), len(x))[0])[:, :NJ].float()
            maps["mirrored"] = (maps["plain"] + b) / 2
        gt, oo = arc.joints[i : i + 50], o[i : i + 50]
        torso = np.linalg.norm(gt[:, 5, :2] - gt[:, 8, :2], axis=1)[:, None]
        for k, m in maps.items():
            p = (argmax_joints(m) - oo[:, None, :2] + 0.5) / oo[:, None, 2:] - 0.5
            hit[k].append(np.linalg.norm(p - gt[..., :2], axis=2) < 0.2 * torso)
    return {
        k: {"mean": round(float(np.concatenate(v).mean() * 100), 2)}
        | {n: round(float(x) * 100, 1) for n, x in zip(JOINTS14, np.concatenate(v).mean(0))}
        for k, v in hit.items()
    }


@torch.no_grad()
def several(net: SelecSLSNet, data: pathlib.Path, dev: torch.device, group: Group, overlay: pathlib.Path | None = None) -> dict:
    """People of eight and more labelled shared joints, at least 40 px tall in the frame.

    Reports on crowds and on people without labels do not count.
    """
    wanted = found = reports = false = tp50 = 0
    scores: list[float] = []
    by_height: dict[str, list[float]] = {}
    for n, ph in enumerate(photos.load(data / "photos")):
        x, s, du, dv = letterbox(ph.image)
        y, _ = net(as_input(x.to(dev)), 1)
        pred = people(y[0], **group)
        if overlay is not None:
            draw(x[0].to(torch.uint8), pred, overlay / f"photo_{n:02}.jpg")
        pred = to_original(pred, s, du, dv)
        best, nobody = photos.match(pred, ph)
        if ph.complete:
            reports += int((best > 0).sum()) + nobody
            tp50 += int((best >= 0.5).sum())
            false += nobody
        for p, b in zip(ph.people, best):
            if (p.joints[:, 2] > 0).sum() < 8 or p.box[3] * s < 40:
                continue
            wanted += 1
            found += b >= 0.3
            if b >= 0.3:
                scores.append(float(b))
            tall = p.box[3] * s
            by_height.setdefault("40-100" if tall < 100 else "100-200" if tall < 200 else "200-320", []).append(float(b))
    return {
        "people": wanted,
        "found_oks30": found / max(wanted, 1),
        "found_oks50": float(np.mean([b >= 0.5 for v in by_height.values() for b in v])),
        "mean_oks_of_found": float(np.mean(scores)) if scores else 0.0,
        "reports": reports,
        "reports_right_oks50": tp50,
        "false_reports": false,
        "found_by_height_px": {k: f"{sum(b >= 0.3 for b in v)}/{len(v)}" for k, v in sorted(by_height.items())},
    }


@torch.no_grad()
def empty(net: SelecSLSNet, pack: pathlib.Path, dev: torch.device, group: Group) -> dict:
    """Held-out photos without people at the frame's size."""
    ims = load_photos(pack, dev, held=True)
    wrong = count = 0
    for im in ims:
        x = letterbox(im.permute(1, 2, 0).cpu().numpy())[0]
        n = len(people(net(as_input(x.to(dev)), 1)[0][0], **group))
        wrong += n > 0
        count += n
    return {"photos": len(ims), "quiet": 1 - wrong / max(len(ims), 1), "false_people": count}


@torch.no_grad()
def scenes(net: SelecSLSNet, s2: Stage2 | None, folder: pathlib.Path, dev: torch.device, n: int, group: Group, overlay: pathlib.Path | None = None) -> dict:
    """`folder`: scenes rendered by prerender.py --held."""
    pool = Stored(folder, 0)
    data, n = pool.data, min(n, pool.filled)
    mask = channel_mask(dev)
    c = dict(joints=0, found=0, right=0, predicted=0, people=0, people_found=0, predictions=0)
    P_uv, P_conf, P_enc, P_rel = [], [], [], []
    step = 8
    for i in range(0, n, step):
        image = data["image"][i : i + step]
        y, e = net(as_input(image.to(dev).float()))
        j, vis, size = (data[k][i : i + step].numpy() for k in ("joints2d", "visible", "size_px"))
        rel = data["rel3d"][i : i + step]
        for b in range(len(image)):
            pred = people(y[b], **group)
            seen = (vis[b] == 1) | (vis[b] == 2)
            gts = [p for p in range(j.shape[1]) if size[b, p] >= 40 and seen[p].sum() >= 8]
            anyone = [p for p in range(j.shape[1]) if size[b, p] > 0 and vis[b, p].any()]
            near = np.zeros((len(pred), len(anyone)))
            for a, q in enumerate(pred):
                for k, p in enumerate(anyone):
                    near[a, k] = ((np.linalg.norm(q[:, :2] - j[b, p], axis=1) < 0.1 * size[b, p]) & (q[:, 2] > 0) & (vis[b, p] > 0)).sum()
            c["people"] += len(gts)
            c["predictions"] += len(pred)
            c["joints"] += int(sum(seen[p].sum() for p in gts))
            c["predicted"] += int(sum((q[:, 2] > 0).sum() for q in pred))
            while near.size and near.max() >= 3:
                a, k = np.unravel_index(near.argmax(), near.shape)
                q, p = pred[a], anyone[k]
                good = (np.linalg.norm(q[:, :2] - j[b, p], axis=1) < 0.1 * size[b, p]) & (q[:, 2] > 0)
                near[a], near[:, k] = 0, 0
                c["right"] += int((good & (vis[b, p] > 0)).sum())
                if p not in gts:
                    c["predictions"] -= 1  # small or mostly hidden people are neither asked for nor wrong
                    continue
                c["people_found"] += 1
                c["found"] += int((good & seen[p]).sum())
                uv = torch.from_numpy(q[:, :2]).to(dev)
                P_uv.append(uv)
                P_conf.append(torch.from_numpy(q[:, 2]).to(dev).clamp(0, 1))
                P_enc.append(read_encodings(e[b], uv))
                P_rel.append(rel[b, p].to(dev))
            if overlay is not None and i + b < 8:
                draw(image[b], pred, overlay / f"scene_{i + b:02}.jpg")
    out: dict = {
        "scenes": n,
        "joint_recall": c["found"] / max(c["joints"], 1),
        "joint_precision": c["right"] / max(c["predicted"], 1),
        "person_recall": c["people_found"] / max(c["people"], 1),
        "person_precision": c["people_found"] / max(c["predictions"], 1),
        **c,
    }
    if P_uv:
        uv, conf, enc, rel = (torch.stack(x) for x in (P_uv, P_conf, P_enc, P_rel))
        out["chained_bones"] = errors(naive(conf, enc * mask * (conf > 0)[..., None]), rel)
        if s2 is not None:
            out["stage2"] = errors(s2(stage2_input(uv, conf, enc, mask)), rel)
            out["stage2_from_2d_alone"] = errors(s2(stage2_input(uv, conf, torch.zeros_like(enc), mask)), rel)
    return out


def read_encodings(e: Tensor, uv: Tensor) -> Tensor:
    """The 63 channels of [63, h, w] at the cell nearest each joint [14, 2] (pixels) -> [14, 63]."""
    cell = ((uv - (STRIDE - 1) / 2) / STRIDE).round().long()
    return e[:, cell[:, 1].clamp(0, e.shape[1] - 1), cell[:, 0].clamp(0, e.shape[2] - 1)].T.float()


# (theirs, ours) in the public 17-joint orders; the neck comes last but one, the pelvis last.  3DHP's first 15 are ours.
LIMBS_H36M = [(1, 8), (2, 9), (3, 10), (4, 11), (5, 12), (6, 13), (11, 5), (12, 6), (13, 7), (14, 2), (15, 3), (16, 4)]
ORDERS = {"h36m": [*LIMBS_H36M, (8, 1), (0, 14)], "mpi_inf_3dhp": [*((j, j) for j in range(2, 14)), (1, 1), (14, 14)]}


@torch.no_grad()
def real3d(net: SelecSLSNet, s2: Stage2, data: pathlib.Path, dev: torch.device, group: Group) -> dict:
    """Four photos.  `found`: Stage I's own joints; `given`: true 2D joints, so that Stage II is measured alone."""
    from PIL import Image

    out: dict = {}
    mask = channel_mask(dev)
    for a in json.loads((data / "real3d/annotations.json").read_text()):
        order = ORDERS[a["set"]]
        theirs, ours = [t for t, _ in order], [o for _, o in order]
        seen = ours[:-1]  # the pelvis is no evidence joint
        image = np.asarray(Image.open(data / "real3d" / a["file"]).convert("RGB"))
        x, s, du, dv = letterbox(image)
        y, e = net(as_input(x.to(dev)))
        j3 = np.array(a["joints3d_camera_m"])[theirs, :3]
        truth = torch.tensor(j3 - j3[-1], dtype=torch.float32)
        at = np.array(a["joints2d"])[theirs[:-1], :2] * s + [du, dv]

        def score(q: np.ndarray, *uses: float) -> float:
            uv, conf = torch.from_numpy(q[:, :2]).float().to(dev), torch.from_numpy(q[:, 2]).float().clamp(0, 1).to(dev)
            enc = torch.stack([read_encodings(e[0], uv) * use for use in uses])
            n = len(uses)
            p = s2(stage2_input(uv.expand(n, -1, -1), conf.expand(n, -1), enc, mask)).mean(0)[ours].cpu()
            return float((procrustes(p[None], truth[None])[0] - truth).norm(dim=1).mean() * 1000)

        given = np.zeros((NJ, 3), np.float32)
        given[seen, :2], given[seen, 2] = at, 1
        row: dict = {"given_joints_pa_mpjpe": score(given, 1.0), "given_joints_2d_alone_pa_mpjpe": score(given, 0.0)}
        pred = people(y[0], **group)
        err = [np.linalg.norm(q[seen, :2] - at, axis=1)[q[seen, 2] > 0].mean() for q in pred]
        if err:
            q = pred[int(np.argmin(err))]
            row |= dict(joints=int((q[:, 2] > 0).sum()), pixels=float(min(err)))
            row |= dict(pa_mpjpe=score(q, 1.0), from_2d_alone_pa_mpjpe=score(q, 0.0), mean_of_both_pa_mpjpe=score(q, 1.0, 0.0))
        out[a["file"]] = row
    return out


def draw(image: Tensor, pred: list[np.ndarray], path: pathlib.Path) -> None:
    from PIL import Image, ImageDraw

    im = Image.fromarray(image.permute(1, 2, 0).cpu().numpy())
    d = ImageDraw.Draw(im)
    for q in pred:
        for a, b in LIMBS:
            if q[a, 2] > 0 and q[b, 2] > 0:
                d.line([tuple(q[a, :2]), tuple(q[b, :2])], fill=(0, 160, 255) if a in (2, 3, 4, 8, 9, 10) else (255, 120, 0), width=2)
    path.parent.mkdir(parents=True, exist_ok=True)
    im.save(path, quality=85)


def rounded(x: object) -> object:
    if isinstance(x, dict):
        return {k: rounded(v) for k, v in x.items()}
    return round(x, 3) if isinstance(x, float) else x


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("pack", type=pathlib.Path)
    ap.add_argument("out", type=pathlib.Path)
    ap.add_argument("--stage1", type=pathlib.Path)
    ap.add_argument("--stage2", type=pathlib.Path)
    ap.add_argument("--data", type=pathlib.Path, help="data folder, for the photos that are not packed")
    ap.add_argument("--scenes", type=pathlib.Path, nargs="*", default=[], help="folders of held-out scenes (prerender.py --held)")
    ap.add_argument("--number", type=int, default=512, help="scenes of each folder at most")
    ap.add_argument("--limit", type=int, default=0, help="pictures of LSP-test (0: all 1,000)")
    ap.add_argument("--scale", type=float, default=1.0, help="of the LSP pictures; people are about 150 px tall at 1")
    ap.add_argument("--thr", type=float, default=0.5, help="heatmap threshold")
    ap.add_argument("--paf", type=float, default=0.25, help="limb threshold")
    ap.add_argument("--joints", type=int, default=8, help="fewest joints of a person")
    ap.add_argument("--only", nargs="*", default=["lsp", "photos", "empty", "scenes", "real3d"])
    ap.add_argument("--overlays", action="store_true")
    ap.add_argument("--threads", type=int, default=0)
    ap.add_argument("--cpu", action="store_true")
    a = ap.parse_args(argv)
    if a.threads:
        torch.set_num_threads(a.threads)
    dev = torch.device("cuda" if torch.cuda.is_available() and not a.cpu else "cpu")
    t = time.time()
    net, s2, meta = load(a.out, dev, a.stage1, a.stage2)
    net = net.to(memory_format=torch.channels_last)
    group: Group = dict(thr=a.thr, paf_thr=a.paf, min_joints=a.joints)
    overlay = a.out / "overlays" if a.overlays else None
    r: dict = {"step": meta.get("step"), "images": meta.get("images"), "group": group}
    if "lsp" in a.only:
        r["lsp_test"] = lsp(net, a.pack, dev, a.limit, a.scale, mirror=not a.limit)
    if "photos" in a.only and a.data:
        r["photos"] = several(net, a.data, dev, group, overlay)
    if "empty" in a.only:
        r["empty"] = empty(net, a.pack, dev, group)
    if "scenes" in a.only:
        r["scenes"] = {f.name: scenes(net, s2, f, dev, a.number, group, overlay / f.name if overlay else None) for f in a.scenes}
    if "real3d" in a.only and a.data and s2 is not None:
        r["real3d"] = real3d(net, s2, a.data, dev, group)
    r["seconds"] = time.time() - t
    text = json.dumps(rounded(r), indent=1)
    a.out.mkdir(parents=True, exist_ok=True)
    (a.out / "eval.json").write_text(text)
    print(text)


if __name__ == "__main__":
    main(sys.argv[1:])
