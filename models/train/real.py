"""Real photos, decoded once on to the device; all augmentation runs there, so no CPU worker can starve the GPU."""

from __future__ import annotations

import hashlib
import math
import os
import pathlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from augment import GREYS, lying
from constants import constant
from skeleton import FLIP14, FLIP21, NB, NJ, limb_chain


T = TypeVar("T")


def decode(buf: bytes) -> np.ndarray:
    """A picture's file -> RGB uint8, upright.  OpenCV releases the interpreter lock, so threads help; pillow is the fallback."""
    try:
        import cv2

        return cv2.cvtColor(cv2.imdecode(np.frombuffer(buf, np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    except ImportError:
        import io

        from PIL import Image, ImageOps

        # OpenCV and the program turn photos as their EXIF says
        return np.array(ImageOps.exif_transpose(Image.open(io.BytesIO(buf))).convert("RGB"))  # a copy, which may be written to


@dataclass
class Archive:
    """The packed pictures of one set."""

    files: list[bytes]
    names: list[str]
    size: np.ndarray  # [n, 2] height, width
    joints: np.ndarray  # [n, 14, 3]


def load_set(pack: pathlib.Path, name: str, limit: int = 0) -> Archive:
    z = np.load(pack / "images.npz")
    ids = np.nonzero(z["set"] == z["set_names"].tolist().index(name))[0]
    if limit and limit < len(ids):
        ids = ids[np.linspace(0, len(ids) - 1, limit).astype(int)]
    blob, off = (pack / "images.bin").read_bytes(), z["offset"]
    return Archive([blob[off[i] : off[i + 1]] for i in ids], z["names"][ids].tolist(), z["size"][ids].astype(np.int64), z["joints"][ids])


def each(work: Callable[[int], T], n: int) -> list[T]:
    """`work` of 0 to n-1 by threads, each of which runs PyTorch's operations alone: threads of threads are slower."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with ThreadPoolExecutor(16) as threads:
            return list(threads.map(work, range(n)))
    finally:
        torch.set_num_threads(before)


def cached_name(files: list[bytes], side: int) -> str:
    """Of decoded pictures, by what is in their files: another pack has as many pictures of other sizes, and joints are in pixels."""
    digest = hashlib.blake2s()
    for f in files:
        digest.update(f)
    return f"people_{len(files)}_{side}_{digest.hexdigest()[:16]}.npy"


def decode_all(files: list[bytes]) -> list[np.ndarray]:
    return each(lambda i: decode(files[i]), len(files))


HELD_EVERY = 7  # every seventh photo without people is kept out of training, to count false people on
# INRIA's photos without people that have some after all: found by the network and looked at
PEOPLED = {f"{i:04}.jpg" for i in (1, 16, 22, 156, 159, 171, 230, 374, 376, 377, 388, 431, 450, 541, 599, 672)}


def held_out(name: str) -> bool:
    """Whether INRIA's photo `name`, which says its number, is kept out of training: also where a pack holds a part of them, or in another order."""
    return int(pathlib.PurePath(name).stem) % HELD_EVERY == HELD_EVERY - 1


def load_photos(
    pack: pathlib.Path, device: torch.device, limit: int = 0, size: tuple[int, int] = (300, 400), held: bool = False
) -> Tensor:
    """Photos without people, uint8 [M, 3, 300, 400]: those for training, or with `held` those for measuring only.

    Portrait pictures are cropped about their middle.
    """
    out = []
    archive = load_set(pack, "background")
    files = [f for f, name in zip(archive.files, archive.names) if held_out(name) == held and name not in PEOPLED]
    if limit and limit < len(files):
        files = [files[i] for i in np.linspace(0, len(files) - 1, limit).astype(int)]
    for im in decode_all(files):
        t = torch.from_numpy(im).permute(2, 0, 1)[None].float()
        h, w = t.shape[2:]
        s = max(size[0] / h, size[1] / w)
        t = F.interpolate(t, scale_factor=s, mode="bilinear", antialias=True, recompute_scale_factor=True)
        y, x = (t.shape[2] - size[0]) // 2, (t.shape[3] - size[1]) // 2
        out.append(
            F.pad(t, (0, 2, 0, 2), mode="replicate")[:, :, max(y, 0) : max(y, 0) + size[0], max(x, 0) : max(x, 0) + size[1]]
            .round()
            .to(torch.uint8)
        )
    return torch.cat(out).to(device)


TEACHER = "teacher.npz"  # of a pack: teacher.py's answers
TAUGHT = ("lspet_train", "lsp_train")  # sets that it has rows of, in this order
WHOLE = 0.85  # share of the tiles of one person that show all of the photo
TRUST = 0.7  # share of the teacher in a mended label: errors go as 0.10 to 0.13 of the torso (teacher) against 0.11 to 0.20 (LSP-Extended)
CONFLICT = 0.5  # of the torso: beyond it teacher and label mean different things, and nobody knows who is right


def mend(labels: np.ndarray, teacher: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Crowd-sourced labels [n, 14, 3] mended by the teacher's [n, 14, 3]; and bool [n]: the two disagree about the person as a whole.

    On LSP, whose labels are accurate, the teacher lies 0.05 to 0.08 of the torso's length from them (median) and shows no bias, hips
    included; from LSP-Extended's it lies 0.08 to 0.17 away: the difference is the labels' own error.  A joint on which they agree roughly
    moves most of the way to the teacher, one on which they contradict each other is left out.  Where most joints contradict (sides
    exchanged, somebody else, a pose the teacher fails on) the labels stay as they are.
    """
    torso = np.linalg.norm(labels[:, [2, 5], :2].mean(1) - labels[:, [8, 11], :2].mean(1), axis=1).clip(15)
    both = (labels[..., 2] > 0) & (teacher[..., 2] > 0)
    apart = np.linalg.norm(labels[..., :2] - teacher[..., :2], axis=-1) / torso[:, None]
    near = (both & (apart < CONFLICT)).sum(1) / both.sum(1).clip(1)
    same = near > 0.6
    sure = both & (teacher[..., 2] > 0.6) & same[:, None]
    out = labels.copy()
    moved = (1 - TRUST) * labels[..., :2] + TRUST * teacher[..., :2]
    out[..., :2] = np.where((sure & (apart < CONFLICT))[..., None], moved, labels[..., :2])
    out[..., 2] = np.where(sure & (apart >= CONFLICT), 0, labels[..., 2])
    return out, (both.sum(1) >= 4) & ~same


def arrange(n: Tensor, P: int, size: tuple[float, float], g: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
    """How tall people are and where: of `n` [B] people a tile, at most P, statures [B, P] in pixels from the range `size` and the place
    of everybody's middle, [B, P] shares of the tile's width and height.

    Who is taller is nearer and comes later, to be pasted over the others; those beyond `n` come last and mean nothing.
    """
    B, d = len(n), n.device

    def rand(*s: int) -> Tensor:
        return torch.rand(*s, generator=g, device=d)

    used, company = torch.arange(P, device=d) < n[:, None], n[:, None] > 1
    tall = torch.exp(math.log(size[0]) + rand(B, P) * math.log(size[1] / size[0]))
    apart = torch.where(rand(B, 1) < 0.35, 1.4, 0.6)  # some stand well behind others
    tall = torch.where(company, tall[:, :1] * torch.exp((rand(B, P) - 0.5) * apart), tall)
    tall = torch.where(used, tall, torch.inf).sort(1)[0].clamp(max=1.35 * size[1])
    slots = (rand(B, P) + 1e3 * ~used).argsort(1).argsort(1)
    spread = torch.where(rand(B, 1) < 0.4, 0.3 + 0.5 * rand(B, 1), 1.0)  # some stand close together and hide each other
    row = ((slots + 0.5) / n[:, None].clamp_min(1) - 0.5 + (rand(B, P) - 0.5) * 0.35) * spread + (rand(B, 1) - 0.5) * (1 - spread)
    cx = 0.5 + torch.where(company, row, (rand(B, P) - 0.5) * 0.6)
    return tall, cx, 0.5 + (rand(B, P) - 0.5) * 0.45


@dataclass
class RealBatch:
    image: Tensor  # float 0..1 [B, 3, H, W]
    joints2d: Tensor  # [B, P, 14, 2]
    labelled: Tensor  # bool [B, P, 14]
    hidden: Tensor  # bool [B, P, 14]: labelled in the photo, here behind somebody who was pasted later; not among `labelled`
    size_px: Tensor  # [B, P], 0 = nobody
    known: Tensor  # [B, h, w] at stride 8: 1 where the picture's content is labelled (boxes of people, background photos)
    box: Tensor  # bool [B, P, h, w]: inside the person's box (its unlabelled joints are ignored there)
    photo: Tensor  # [B] background photo, by index
    empty: Tensor  # bool [B]: nobody was pasted
    rel3d: Tensor  # [B, P, 21, 3] the teacher's 3D, metres at canonical stature
    lifted: Tensor  # bool [B, P]: it is to be trusted


class People:
    """LSP and LSP-Extended: one labelled person a picture, bystanders unlabelled."""

    def __init__(
        self,
        pack: pathlib.Path,
        device: torch.device,
        photos: Tensor,
        seed: int = 0,
        limit: int = 0,
        cache: pathlib.Path | None = None,
    ):
        """`cache`: a folder in which the decoded pictures are kept and mapped, so that several processes share one copy."""
        self.device, self.photos = device, photos
        self.photo_weight = torch.ones(len(photos), device=device)
        self.g = torch.Generator(device=device).manual_seed(seed)
        sets = [load_set(pack, n, limit) for n in TAUGHT]
        files = [f for s in sets for f in s.files]
        size = np.concatenate([s.size for s in sets])
        joints = np.concatenate([s.joints for s in sets])
        lsp = np.repeat([0, 1], [len(s.files) for s in sets])
        S = int(size.max())
        self.S = S
        joints, doubt = self._teacher(pack / TEACHER, joints, size, lsp > 0, limit)
        self.lends = bool(self.lift.any())  # whether anybody lends depth
        stored = cache / cached_name(files, S) if cache else None
        if stored is not None and stored.exists():
            self.pictures = torch.from_numpy(np.load(stored, mmap_mode="c"))
        else:
            self.pictures = self._decode(files, S)
            if stored is not None:
                stored.parent.mkdir(parents=True, exist_ok=True)
                part = stored.with_name(f"{stored.name}.{os.getpid()}")
                with open(part, "wb") as f:
                    np.save(f, self.pictures.numpy())
                os.replace(part, stored)
                self.pictures = torch.from_numpy(np.load(stored, mmap_mode="c"))
        self.pictures = self.pictures.to(device)
        self.size = torch.from_numpy(size).to(device)
        self.joints = torch.from_numpy(joints[..., :2]).to(device)
        self.lab = torch.from_numpy(joints[..., 2] > 0).to(device)
        ok = (joints[..., 2] > 0).sum(1) >= 7
        # LSP proper is accurately labelled and upright, like the pictures met in use; LSP-Extended is mostly acrobatics.
        j = joints
        upright = (j[:, [1, 8, 11], 2] > 0).all(1) & (j[:, [8, 11], 1].mean(1) - j[:, 1, 1] > np.abs(j[:, [8, 11], 0].mean(1) - j[:, 1, 0]))
        weight = ok * np.where(lsp, 2.5, 1.0) * np.where(upright, 1.5, 0.7) * np.where(doubt, 0.4, 1.0)
        self.weight = torch.from_numpy(weight.astype(np.float32)).to(device)
        lo = np.where(j[..., 2:] > 0, j[..., :2], 1e6).min(1)
        hi = np.where(j[..., 2:] > 0, j[..., :2], -1e6).max(1)
        m = 0.12 * np.maximum((hi - lo).max(1, keepdims=True), 60) + 4
        self.lo, self.hi = (torch.from_numpy(x.astype(np.float32)).to(device) for x in (lo - m, hi + m))
        # Stature in source pixels, from the labelled limb chain; LSP crops are scaled to about 150 px people, which is the fallback.
        full_ok = (j[..., 2] > 0).all(1)
        self.stature = torch.from_numpy(np.where(full_ok, np.clip(limb_chain(j), 90, 200), 150.0).astype(np.float32)).to(device)
        self.flip, self.flip21 = torch.tensor(FLIP14, device=device), torch.tensor(FLIP21, device=device)

    def _teacher(
        self, path: pathlib.Path, joints: np.ndarray, size: np.ndarray, accurate: np.ndarray, limit: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Take up teacher.py's answers, if the pack has them.

        Returns the labels, filled in where there are none and mended where they are not `accurate` (bool [n]), and bool [n]: the
        teacher contradicts them as a whole.
        """
        n = len(joints)
        if limit or not path.exists():
            self.bones, self.lift = torch.zeros(n, NB, 3, device=self.device), torch.zeros(n, dtype=torch.bool, device=self.device)
            self.mask, self.cut = torch.zeros(n, 1, 1, dtype=torch.uint8, device=self.device), self.lift
            return joints, np.zeros(n, bool)
        z = np.load(path)
        if len(z["ok"]) != n:
            raise SystemExit(f"expected {n} rows in {path}, found {len(z['ok'])}: run teacher.py on this pack again")
        t = z["joints"]
        inside = (t[..., 0] > 2) & (t[..., 1] > 2) & (t[..., 0] < size[:, None, 1] - 3) & (t[..., 1] < size[:, None, 0] - 3)
        fill = (joints[..., 2] == 0) & (t[..., 2] > 0.8) & inside & z["ok"][:, None]
        joints = np.where(fill[..., None], np.concatenate([t[..., :2], np.ones_like(t[..., 2:])], -1), joints)
        self.bones = torch.from_numpy(z["bones"].astype(np.float32)).to(self.device)
        self.lift = torch.from_numpy(z["lift"]).to(self.device)
        self.mask, self.cut = torch.from_numpy(z["mask"]).to(self.device), torch.from_numpy(z["ok"]).to(self.device)
        mended, doubt = mend(joints, t)
        return np.where(accurate[:, None, None], joints, mended), doubt & ~accurate

    @staticmethod
    def _decode(files: list[bytes], S: int) -> Tensor:
        """uint8 [2n, 3, S, S]: every picture in the top left corner, then antialiased copies of half the size for people drawn small."""
        n = len(files)
        out = torch.zeros(2 * n, 3, S, S, dtype=torch.uint8)

        def place(i: int) -> None:
            t = torch.from_numpy(decode(files[i])).permute(2, 0, 1)
            h, w = t.shape[1:]
            out[i] = F.pad(t[None].float(), (0, S - w, 0, S - h), mode="replicate")[0].to(torch.uint8)
            out[n + i, :, : (S + 1) // 2, : (S + 1) // 2] = F.avg_pool2d(out[i : i + 1].float(), 2, ceil_mode=True)[0].round().to(torch.uint8)

        each(place, n)
        return out

    def fired(self, photo: Tensor, answer: Tensor) -> None:
        """Remember how strongly the network answered on photos without people; `batch` shows the worst ones more often."""
        old = self.photo_weight[photo]
        self.photo_weight[photo] = old + 0.3 * ((0.1 + 4 * answer.to(old)) - old)

    @torch.no_grad()
    def batch(
        self, B: int, H: int, W: int, size: tuple[float, float], people: list[float], close: bool = False, whole: float = WHOLE
    ) -> RealBatch:
        """`size`: range of statures in pixels; `people`: probabilities of 0, 1, 2, ... people; `close`: three of four are placed by head
        and neck instead of their middle; `whole`: share of the tiles of one person that show all of the photo, bystanders included."""
        d, g = self.device, self.g
        P, h, w = len(people) - 1, H // 8, W // 8

        def rand(*s: int) -> Tensor:
            return torch.rand(*s, generator=g, device=d)

        n = torch.multinomial(torch.tensor(people, device=d), B, True, generator=g)
        id_ = torch.multinomial(self.weight, B * P, True, generator=g).view(B, P)
        used = torch.arange(P, device=d) < n[:, None]

        # background photo
        gy, gx = torch.meshgrid(torch.linspace(-1, 1, H, device=d), torch.linspace(-1, 1, W, device=d), indexing="ij")
        s = (0.3 + 0.6 * rand(B))[:, None, None]
        c = (rand(B, 2, 1, 1) * 2 - 1) * (1 - s[:, None])
        asp = (W / H) / (self.photos.shape[3] / self.photos.shape[2])
        grid = torch.stack([gx * s * min(asp, 1) + c[:, 0], gy * s / max(asp, 1) + c[:, 1]], -1)
        photo = torch.multinomial(self.photo_weight, B, True, generator=g)
        canvas = F.grid_sample(self.photos[photo].float(), grid, align_corners=False, padding_mode="reflection") / 255

        # the grey or black bars that a frame of another shape is padded with
        side, wide = torch.randint(4, (B, 1, 1), generator=g, device=d), (0.05 + 0.4 * rand(B))[:, None, None]
        along = torch.where(side < 2, gx[None], gy[None]) * torch.where(side % 2 == 0, 1.0, -1.0)
        bar = (along > 1 - 2 * wide) & (rand(B) < 0.12)[:, None, None]
        shade = constant(GREYS, d)[torch.randint(len(GREYS), (B,), generator=g, device=d)]
        canvas = torch.where(bar[:, None], shade[:, None, None, None], canvas)

        tall, cx, cy = arrange(n, P, size, g)
        cx, cy = cx * W, cy * H
        # similarity that takes (flipped) source pixels to the canvas
        k = tall / self.stature[id_]
        a = (torch.randn(B, P, generator=g, device=d) * 0.22).clamp(-0.6, 0.6)
        a = a + lying(rand(B, P))
        fl = rand(B, P) < 0.5
        lo, hi = self.lo[id_], self.hi[id_]
        mid = (lo + hi) / 2
        if close:
            head = self.lab[id_][:, :, :2].all(-1) & (rand(B, P) < 0.75)
            mid = torch.where(head[..., None], self.joints[id_][:, :, :2].mean(2), mid)
        co, si = k * a.cos(), k * a.sin()
        sgn = torch.where(fl, -1.0, 1.0)
        # x' = co*sgn*(x - mx) - si*(y - my) + cx ;  y' = si*sgn*(x - mx) + co*(y - my) + cy
        A = torch.stack([co * sgn, -si, si * sgn, co], -1).view(B, P, 2, 2)
        centre = torch.stack([cx, cy], -1)
        J = ((self.joints[id_] - mid[:, :, None]) @ A.transpose(-1, -2)) + centre[:, :, None]
        lab = self.lab[id_]
        J = torch.where(fl[..., None, None], J[:, :, self.flip], J)
        lab = torch.where(fl[..., None], lab[:, :, self.flip], lab) & used[..., None]

        Ai = torch.linalg.inv_ex(A)[0]  # inv would wait for the device to check its result
        px = torch.stack(
            torch.meshgrid(torch.arange(W, device=d, dtype=torch.float32), torch.arange(H, device=d, dtype=torch.float32), indexing="xy"),
            -1,
        )
        cell = px[::8, ::8] + 3.5
        bones = self.bones[id_]
        bones = torch.where(fl[..., None, None], bones[:, :, self.flip21] * torch.tensor([-1.0, 1.0, 1.0], device=d), bones)
        ca, sa = a.cos()[..., None], a.sin()[..., None]
        bones = torch.stack([bones[..., 0] * ca - bones[..., 1] * sa, bones[..., 0] * sa + bones[..., 1] * ca, bones[..., 2]], -1)
        uncut = (n == 1) & (rand(B) < whole)
        # people cut out along the teacher's outline stand in the scene; the others bring a box of their own surroundings along
        cut = self.cut[id_] & ~uncut[:, None] & (rand(B, P) < 0.7)
        known = torch.ones(B, h, w, device=d)
        hidden = torch.zeros_like(lab)
        boxes = torch.zeros(B, P, h, w, dtype=torch.bool, device=d)
        for p in range(P):
            # on a GPU all rows, with or without somebody to paste: to ask which would wait for it
            r = torch.arange(B, device=d) if d.type == "cuda" else used[:, p].nonzero()[:, 0]
            if not len(r):
                break
            who, scale, here, alone = id_[r, p], k[r, p], used[r, p, None, None], uncut[r, None, None]
            outlined = cut[r, p, None, None]

            def src(pts: Tensor) -> Tensor:
                return (pts - centre[r, p, None, None]) @ Ai[r, p, None].transpose(-1, -2) + mid[r, p, None, None]

            def cover(q: Tensor, soft: float) -> tuple[Tensor, Tensor]:
                """Inside the picture, inside the box (feathered): 0..1."""
                sz = self.size[who].flip(1).float()[:, None, None]
                pic = torch.minimum(q + 0.5, sz - 0.5 - q).amin(-1)
                box = torch.minimum(q - lo[r, p, None, None], hi[r, p, None, None] - q).amin(-1)
                return (pic > 0).float(), (box / soft + 0.5).clamp(0, 1)

            q = src(px)
            small = scale < 0.62
            uv = torch.where(small[:, None, None, None], (q - 0.5) / 2, q)
            tex = self.pictures[who + len(self.size) * small].float()
            tex = F.grid_sample(tex, (uv * 2 + 1) / self.S - 1, align_corners=False, padding_mode="border") / 255
            pic, box = cover(q, 8.0)
            alpha = torch.where(alone, pic, pic * box)
            if d.type == "cuda" or outlined.any():
                side = self.mask.shape[-1]
                outline = self.mask[who, None].float()
                outline = F.grid_sample(outline, (q + 0.5) / side - 1, align_corners=False, padding_mode="zeros")[:, 0] / 255
                alpha = torch.where(outlined, pic * (outline * 2.5 - 0.6).clamp(0, 1), alpha)
            alpha = alpha * here
            canvas[r] = torch.lerp(canvas[r], tex, alpha[:, None])
            at = src(cell)
            pic, box = cover(at, 1.0)
            inbox = (pic * box > 0.5) & here
            pasted = torch.where(alone, pic, pic * cover(at, 16.0)[1]) > 0.02
            # what was pasted is unknown (bystanders) except in the labelled person's box; a later paste hides earlier ones
            hides = F.interpolate(alpha[:, None], (h, w), mode="area")[:, 0] > 0.5
            pasted = torch.where(outlined, hides, pasted)
            known[r] = torch.where(pasted & here, (inbox | outlined).float(), known[r])
            if p:
                boxes[r, :p] = boxes[r, :p] & ~hides[:, None]
                ci = (J[r, :p] / 8).long()
                x, y = ci[..., 0].clamp(0, w - 1), ci[..., 1].clamp(0, h - 1)
                hid = hides.flatten(1).gather(1, (y * w + x).flatten(1)).view(len(r), p, NJ)
                hidden[r, :p] = hidden[r, :p] | (lab[r, :p] & hid)
                lab[r, :p] = lab[r, :p] & ~hid
            boxes[r, p] = inbox
        return RealBatch(canvas, J, lab, hidden, torch.where(used, tall, 0.0), known, boxes, photo, n == 0, bones, self.lift[id_])
