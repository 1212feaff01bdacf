"""Train Stage II: 14 x (u, v, confidence, 63 encodings) -> 21 joints, on mocap through a virtual camera.

    python stage2.py PACK OUT --minutes 8 [--stage1 OUT/ckpt]

Inputs imitate Stage I: joints drop out singly, by limb and below the edge of the frame; positions are noisy and sometimes swapped;
encodings are flattened, turned, now and then another person's, and as wrong as Stage I's: little in the median, much in the tails.
With `--posed`, people in `edgecap synth`'s poses join those of the motion capture. Given what mistakes.py collected, a part of every batch carries true mistakes, and people as Stage I reported them are added; given a
Stage I checkpoint, its true outputs on rendered scenes.  With `--mean-of` it learns what other Stage II networks say together, instead of
the truth: one network then answers as well as several looks at a person.  With `--keep` it goes on to answer as that network does about
real people, whom the truth of renderings would teach it to see otherwise.  Light enough for a CPU.
"""

from __future__ import annotations

import argparse
import copy
import math
import pathlib
import sys
import time

import torch
import torch.nn.functional as F
from torch import Tensor

import mistakes
import rotations as rot
import terms
import weights
from body import Body, Mocap, canonical
from clock import Clock
from measure import errors, naive
from mistakes import Looks, Mistakes, bones, load
from model import SelecSLSNet, Stage2, channel_mask, stage2_input
from posed import Posed
from skeleton import FLIP14, FLIP21, NB, NECK, NJ, ROOT, STRIDE

LIMB_CHAINS = [
    [3, 4],
    [4],
    [6, 7],
    [7],
    [9, 10],
    [10],
    [12, 13],
    [13],
    [2, 3, 4],
    [5, 6, 7],
    [8, 9, 10],
    [11, 12, 13],
    [8, 9, 10, 11, 12, 13],
    [9, 10, 12, 13],
]


CLOSE = 0.3  # share of people who stand right before the camera
NEAR = 400  # stature in pixels of those whom the report counts as close
KEPT = 300  # pixels from the topmost to the lowest joint of those whom `--keep` asks about: closer ones are to be learnt anew
LEAST = 4  # joints in the picture, the neck among them: fewer are not reported


class People3D:
    """Random posed people in front of random cameras: pixels and 3D joints, no pictures."""

    def __init__(self, pack: pathlib.Path, device: torch.device, seed: int, held: bool = False):
        self.body, self.device = Body(pack, device), device
        mocap = Mocap(pack, device)
        self.clips = mocap.held if held else mocap.train
        self.held = held
        self.g = torch.Generator(device=device).manual_seed(seed)

    @torch.no_grad()
    def sample(self, n: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """uv [n, 14, 2] in pixels of a 512 x 320 frame, rel3d [n, 21, 3], stature in pixels [n], joints in the picture bool [n, 14].

        From 0.6 to a dozen metres away; of those who stand before a screen the picture shows what is left above hips or thighs. Whoever the
        program would not report, without neck or with fewer than four joints in the picture, is drawn anew.
        """
        drawn = self._draw(n + n // 4 + 8)
        inside = drawn[3]
        kept = (inside[:, NECK] & (inside.sum(1) >= LEAST)).nonzero()[:, 0]
        kept = kept[torch.arange(n, device=self.device) % len(kept)]
        return tuple(t[kept] for t in drawn)  # type: ignore[return-value]

    def _draw(self, n: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        d, g, b = self.device, self.g, self.body

        def rand(*s: int) -> Tensor:
            return torch.rand(*s, generator=g, device=d)

        w, stature = b.random_shapes(n, g)
        _, rest = b.shaped(w, stature, with_verts=False)
        if self.held:  # the clips as they are, mirrored or not
            q = b.random_poses(self.clips, n, g, extreme=0, jitter=0)
        else:
            q = b.random_poses(self.clips, n, g)
        _, _, joints = b.kinematics(q, rest, (rand(n) * 2 - 1) * math.pi)
        f = 256 / torch.tan((35 + 55 * rand(n)) * math.pi / 360)
        close = rand(n) < CLOSE
        tall = torch.where(close, 280 * (900 / 280) ** rand(n), 40 * 8 ** rand(n))
        dist = torch.maximum(f * 1.68 / tall, torch.where(close, 0.6, 1.5))
        hc = torch.where(close, 0.7 + 1.2 * rand(n), 0.6 + 2.4 * rand(n))
        # What the camera looks at: hips of those far away, somewhere from hips to head of those close by, more or less in the middle.
        aim = 0.9 + 0.7 * rand(n) * close
        off = (rand(n) - 0.5) * torch.where(close, 200.0, 120.0)
        pitch = (torch.atan2(hc - aim, dist) - torch.atan2(off, f)).clamp(-0.44, 0.87)
        roll = 0.06 * torch.randn(n, generator=g, device=d)
        x = (rand(n) - 0.5) * 512 / f * dist
        p = joints * torch.tensor([1.0, -1.0, -1.0], device=d) + torch.stack([x, hc, dist], 1)[:, None]
        turn = rot.from_rotvec(torch.stack([pitch, torch.zeros_like(pitch), torch.zeros_like(pitch)], 1))
        tilt = rot.from_rotvec(torch.stack([torch.zeros_like(roll), torch.zeros_like(roll), roll], 1))
        R = rot.matrix(rot.qmul(tilt, turn))
        cam = p @ R.transpose(1, 2)
        z = cam[:, :NJ, 2]
        uv = cam[:, :NJ, :2] / z[..., None].clamp_min(0.2) * f[:, None, None]
        half = torch.tensor([256.0, 160.0], device=d)
        half = torch.where(rand(n, 1) < 0.2, half.flip(0), half)[:, None]  # upright pictures
        inside = (uv.abs() <= half).all(-1) & (z > 0.2)
        return uv, canonical(cam, stature), f * stature / cam[:, ROOT, 2].clamp_min(0.3), inside


def imitate(uv: Tensor, rel: Tensor, g: torch.Generator, mask: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """What Stage I would report: noisy uv, confidences (0 = missed), encodings [n, 14, 63]."""
    n, d = len(uv), uv.device

    def rand(*s: int) -> Tensor:
        return torch.rand(n, *s, generator=g, device=d)

    def randn(*s: int) -> Tensor:
        return torch.randn(n, *s, generator=g, device=d)

    size = (uv - uv.mean(1, keepdim=True)).square().sum(-1).mean(1).sqrt()[:, None, None]
    level = rand(1, 1) * 1.5  # some people are seen well, some badly
    conf = 0.2 + 0.8 * rand(NJ)
    faint = 1 + 2 * (0.6 - conf).clamp_min(0)[..., None]  # what Stage I is less sure of lies farther off
    noisy = uv + randn(NJ, 2) * size * 0.03 * level * faint + randn(NJ, 2) * size * 0.5 * (rand(NJ, 1) < 0.012 * level * faint)
    f14 = torch.tensor(FLIP14, device=d)
    swap = rand(2) < 0.025 * level[:, :, 0]  # arms or legs taken for each other
    arms = torch.tensor([j in (2, 3, 4, 5, 6, 7) for j in range(NJ)], device=d)
    legs = torch.tensor([j >= 8 for j in range(NJ)], device=d)
    sw = (swap[:, :1] & arms) | (swap[:, 1:] & legs)
    noisy = torch.where(sw[..., None], noisy[:, f14], noisy)

    drop = rand(NJ) < (0.18 * rand(1) ** 2 * 2)
    for c in LIMB_CHAINS:
        m = torch.zeros(NJ, dtype=torch.bool, device=d)
        m[c] = True
        drop = drop | ((rand(1) < 0.035) & m)
    cut = rand(1) < 0.12  # the frame's lower edge
    ys = uv[..., 1]
    line = ys.amin(1, keepdim=True) + (ys.amax(1, keepdim=True) - ys.amin(1, keepdim=True)) * (0.35 + 0.6 * rand(1))
    drop = drop | (cut & (ys > line))
    drop[:, 1] = False  # nobody is found without a neck
    drop = drop & (rand(1) > 0.15)  # and many are seen whole
    conf = conf * ~drop

    b = bones(rel)
    # regression to the mean makes encodings small, depth most
    worst = level[:, :, 0] / 1.5
    flat = torch.stack([1 - 0.6 * rand(1) * worst, 1 - 0.12 * rand(1) * worst, 1 - 0.2 * rand(1) - 0.8 * rand(1) * worst], -1)
    b = b * flat * (1 + 0.05 * randn(1, 1))
    turn = rot.matrix(rot.from_rotvec(randn(3) * torch.tensor([0.07, 0.12, 0.04], device=d) * level[:, :, 0]))
    b = b @ turn.transpose(1, 2)
    # The joints that read a bone err alike (0.86 of the variance, third model); errors of 0.02 m in the median and 0.08 m RMS are a
    # mixture of widths.
    common, own = randn(NB, 3), torch.randn(n, NJ, NB, 3, generator=g, device=d)
    std = torch.tensor([0.03, 0.03, 0.04], device=d) * torch.exp(0.75 * randn(NB, 1)) * (0.5 + 0.8 * level.reshape(n, 1, 1))
    enc = b[:, None] + (common[:, None] * 0.93 + own * 0.37) * std[:, None]
    sign = torch.where(rand(NB) < 0.05 * level[:, :, 0], -1.0, 1.0)  # depth taken for its mirror image
    enc[..., 2] = enc[..., 2] * sign[:, None]
    other = rand(NJ) < 0.03 * level[:, :, 0]  # another person's value at a contested cell
    enc = torch.where(other[..., None, None], enc.roll(1, 0), enc)
    enc = torch.where(sw[..., None, None], enc[:, f14][:, :, FLIP21], enc)  # what lies there, under the other side's name
    return noisy, conf, enc.flatten(2) * mask


def as_of_real_people(enc: Tensor, share: float, g: torch.Generator) -> Tensor:
    """Encodings [n, 14, 63] of renderings, a `share` of the people as Stage I encodes real ones: shallower, depth most, and noisier, alike
    at every joint that reads a bone. Against truth from several calibrated views they had 0.74 to 0.83 of a bone's length across and 0.35 to
    0.60 in depth, of renderings 0.78 to 0.92 and 0.71."""
    n, d = len(enc), enc.device
    amount = torch.rand(n, 1, 1, 1, generator=g, device=d) * (torch.rand(n, 1, 1, 1, generator=g, device=d) < share)
    flat = 1 - amount * torch.rand(n, 1, 1, 3, generator=g, device=d) * torch.tensor([0.25, 0.25, 0.8], device=d)
    noise = torch.randn(n, 1, NB, 3, generator=g, device=d) * torch.tensor([0.03, 0.04, 0.06], device=d) * amount
    e = enc.unflatten(2, (NB, 3))
    return torch.where(e == 0, e, e * flat + noise).flatten(2)


@torch.no_grad()
def stage1_features(
    net: SelecSLSNet, pack: pathlib.Path, device: torch.device, scenes: int, seed: int, tiny: bool = False, held: bool = False
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """True Stage I outputs at the labelled joints of rendered scenes: uv, conf, enc, rel3d of every person with a visible neck."""
    from augment import photometric
    from real import load_photos
    from scenes import Generator

    gen = Generator(
        pack, device, load_photos(pack, device, 40 if tiny else 0), seed, held, supersample=1 if tiny else 2, chunk=4 if tiny else 64
    )
    net.eval()
    out: list[tuple[Tensor, ...]] = []
    step = 4 if tiny else 64
    for _ in range(0, scenes, step):
        s = gen.render(step)
        x = photometric(s.image.float() / 255, gen.g) - 0.5
        with torch.autocast(device.type, torch.bfloat16, enabled=device.type == "cuda"):
            y, e = net(x.contiguous(memory_format=torch.channels_last))
        out.append(read_out(y.float(), e.float(), s.joints2d, s.visible, s.rel3d, s.size_px, gen.g))
    return tuple(torch.cat(t) for t in zip(*out))  # type: ignore[return-value]


def read_out(
    y: Tensor, e: Tensor, joints2d: Tensor, visible: Tensor, rel: Tensor, size: Tensor, g: torch.Generator
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    B, P = size.shape
    h, w = y.shape[2:]
    uv = joints2d + torch.randn(joints2d.shape, generator=g, device=y.device) * size[..., None, None] * 0.012
    cell = ((uv - (STRIDE - 1) / 2) / STRIDE).round().long()
    x, r = cell[..., 0].clamp(0, w - 1), cell[..., 1].clamp(0, h - 1)
    at = (r * w + x).permute(0, 2, 1)  # [B, 14, P]
    peak = F.max_pool2d(y[:, :NJ], 3, 1, 1).flatten(2).gather(2, at).permute(0, 2, 1)  # [B, P, 14]
    enc = e.flatten(2).gather(2, at.flatten(1)[:, None].expand(-1, e.shape[1], -1)).view(B, -1, NJ, P).permute(0, 3, 2, 1)
    conf = torch.where((visible > 0) & (peak > 0.12), peak.clamp(0, 1), torch.zeros_like(peak))
    keep = (size > 36) & (conf[..., 1] > 0) & ((conf > 0).sum(-1) >= 4)
    return uv[keep], conf[keep], enc[keep], rel[keep]


def mirror(uv: Tensor, conf: Tensor, enc: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """What Stage I would say of the mirror image."""
    left = torch.tensor([-1.0, 1.0, 1.0], device=uv.device)
    enc = enc.unflatten(2, (NB, 3))[:, FLIP14][:, :, FLIP21] * left
    return uv[:, FLIP14] * left[:2], conf[:, FLIP14], enc.flatten(2)


def mirror3d(rel: Tensor) -> Tensor:
    """The joints [n, 21, 3] of the mirror image."""
    return rel[:, FLIP21] * torch.tensor([-1.0, 1.0, 1.0], device=rel.device)


def mirrored(uv: Tensor, conf: Tensor, enc: Tensor, rel: Tensor, g: torch.Generator) -> tuple[Tensor, ...]:
    """Every second person as in a mirror, and all of them a little displaced: the same few thousand answers come again and again."""
    n, d = len(uv), uv.device
    flip = torch.rand(n, generator=g, device=d) < 0.5
    other = (*mirror(uv, conf, enc), mirror3d(rel))
    uv, conf, enc, rel = (torch.where(flip.view(-1, *[1] * (a.dim() - 1)), b, a) for a, b in zip((uv, conf, enc, rel), other))
    size = (uv - uv.mean(1, keepdim=True)).square().sum(-1).mean(1).sqrt()[:, None, None]
    uv = uv + 0.02 * size * torch.randn(uv.shape, generator=g, device=d)
    drop = (torch.rand(conf.shape, generator=g, device=d) < 0.05) & (torch.arange(NJ, device=d) != NECK)
    return uv, conf * ~drop, enc, rel


@torch.no_grad()
def agreed(nets: list[Stage2], uv: Tensor, conf: Tensor, enc: Tensor, mask: Tensor) -> Tensor:
    """The mean answer of several networks [n, 21, 3], each asked with the encodings and from 2D alone, of the person and of the mirror image."""
    total = torch.zeros(len(uv), NB, 3, device=uv.device)
    for e in (enc, torch.zeros_like(enc)):
        plain, other = stage2_input(uv, conf, e, mask), stage2_input(*mirror(uv, conf, e), mask)
        for net in nets:
            total += net(plain) + mirror3d(net(other))
    return total / (4 * len(nets))


@torch.no_grad()
def kept_answers(net: Stage2, looks: Looks, mask: Tensor) -> tuple[Tensor, ...]:
    """`uv`, `conf` and `enc` of those of `looks` who are not close, and what `net` says of them, looking at the mirror image, too: [n, 21, 3]."""
    seen, y = looks.conf > 0, looks.uv[..., 1]
    tall = torch.where(seen, y, -torch.inf).amax(1) - torch.where(seen, y, torch.inf).amin(1)
    answer = tuple(t[tall < KEPT] for t in (looks.uv, looks.conf, looks.enc))
    rel = net(stage2_input(*answer, mask)) + mirror3d(net(stage2_input(*mirror(*answer), mask)))
    return (*answer, rel / 2)


def train(a: argparse.Namespace) -> None:
    clock = Clock()
    dev = torch.device("cuda" if torch.cuda.is_available() and not a.cpu else "cpu")
    if a.threads:
        torch.set_num_threads(a.threads)
    if a.open:
        terms.ingredients(a.pack)
        for path in [p for p in (a.init, a.keep) if p] + a.mean_of:
            terms.require_open_weights(path)
        if a.stage1:
            raise SystemExit("expected no --stage1 with --open: it looks at backgrounds that are not open")
        for path in a.mistakes:
            if not mistakes.is_open(path):
                raise SystemExit(f"expected mistakes of open weights in open scenes, found {path}: collect them with mistakes.py --open")
    torch.manual_seed(a.seed)
    mask = channel_mask(dev)
    data = People3D(a.pack, dev, a.seed)
    held = People3D(a.pack, dev, 4242, held=True)
    uv, rel_t, tall, there = held.sample(a.test)
    posed = Posed(a.posed, dev, a.seed + 5) if a.posed else None
    if posed:
        p_uv, p_rel, _, p_in = posed.held()
        p_noisy, p_conf, p_enc = imitate(p_uv, p_rel, torch.Generator(device=dev).manual_seed(9), mask)
        p_test = stage2_input(p_noisy, p_conf * p_in, p_enc, mask)
    wrong: Mistakes | None = None
    true: list[tuple[Tensor, ...]] = []  # Stage I's own answers
    if a.mistakes:
        whole_set, seen, looks = load(a.mistakes, dev)
        cut = len(whole_set.conf) // 7  # records that are only measured with
        wrong, kept = whole_set.take(slice(cut, None)), whole_set.take(slice(cut))
        real_uv, real_conf, real_enc = kept.apply(uv, tall, rel_t, torch.Generator(device=dev).manual_seed(8))
        real_conf = real_conf * there
        real_test = stage2_input(real_uv, real_conf, real_enc, mask)
        real_blind = stage2_input(real_uv, real_conf, torch.zeros_like(real_enc), mask)
    noisy, conf, enc = imitate(uv, rel_t, torch.Generator(device=dev).manual_seed(7), mask)
    conf = conf * there
    whole = there.float()
    clean = stage2_input(uv, whole, bones(rel_t).flatten(1)[:, None].expand(-1, NJ, -1), mask)
    clean2d = stage2_input(uv, whole, torch.zeros(len(uv), NJ, 3 * NB, device=dev), mask)
    test = stage2_input(noisy, conf, enc, mask)
    blind = stage2_input(noisy, conf, torch.zeros_like(enc), mask)  # what a runtime without a trained 3D head feeds
    if a.mistakes:
        cut = len(seen.conf) // 7
        true.append(tuple(t[cut:] for t in (seen.uv, seen.conf, seen.enc, seen.rel)))
        seen_rel, seen_answers = seen.rel[:cut], (seen.uv[:cut], seen.conf[:cut], seen.enc[:cut])
        seen_test = stage2_input(*seen_answers, mask)
        seen_blind = stage2_input(*seen_answers[:2], torch.zeros_like(seen.enc[:cut]), mask)
    if a.stage1:
        import checkpoint

        net = SelecSLSNet().to(dev)
        ema = copy.deepcopy(net)
        checkpoint.load(a.stage1, net, ema, None, dev)
        true.append(stage1_features(ema, a.pack, dev, a.scenes, a.seed + 77))
        print(f"{len(true[-1][0])} people seen by Stage I in {a.scenes} scenes, {clock.whole():.0f} s", flush=True)
    answers = tuple(torch.cat(t) for t in zip(*true))
    net2 = Stage2().to(dev)
    if a.init:
        if a.init.suffix == ".safetensors":
            weights.load_into(net2, a.init)
        else:
            net2.load_state_dict(torch.load(a.init, map_location=dev, weights_only=True)["net"])
    avg = copy.deepcopy(net2).requires_grad_(False).eval()
    panel = [Stage2().to(dev).requires_grad_(False).eval() for _ in a.mean_of]
    for member, path in zip(panel, a.mean_of):
        weights.load_into(member, path)
    kept_people: tuple[Tensor, ...] = ()
    if a.keep:
        if not a.mistakes or not len(looks.conf):
            raise SystemExit("expected people of photos to --keep answers about, found none: collect them with mistakes.py --everyday and give --mistakes")
        before = Stage2().to(dev).requires_grad_(False).eval()
        weights.load_into(before, a.keep)
        kept_people = kept_answers(before, looks, mask)
        print(f"{len(kept_people[0])} real people stay as {a.keep} sees them", flush=True)
    opt = torch.optim.AdamW(net2.parameters(), lr=a.lr, weight_decay=0.01, betas=(0.9, 0.98))
    step, logged = 0, time.monotonic()
    now = t0 = clock.whole()
    end = a.minutes * 60
    weight = torch.tensor([1.0] * 14 + [0.5, 1, 1, 0.7, 0.7, 0.7, 0.7], device=dev)[:, None]
    acc = torch.zeros((), device=dev)
    fresh: list[tuple[Tensor, Tensor, Tensor, Tensor]] = []
    while now < end and not (a.steps and step >= a.steps):
        p = step / a.steps if a.steps else (now - t0) / (end - t0)
        for grp in opt.param_groups:
            grp["lr"] = a.lr * min(p / 0.02, 1) * max(0.5 * (1 + math.cos(math.pi * p)), 0.002)
        # posing people costs more than the network: use a batch of them with several corruptions
        if step % a.repeat == 0:
            n = round(a.batch * a.posed_share) if posed else 0
            fresh = [data.sample(a.batch - n)]
            if posed:
                fresh = [tuple(torch.cat(z) for z in zip(fresh[0], posed.sample(n)))]  # type: ignore[list-item]
        uv, rel, size, inside = fresh[0]
        x_uv, x_c, x_e = imitate(uv, rel, data.g, mask)
        x_e = x_e * (torch.rand(len(x_e), 1, 1, generator=data.g, device=dev) >= a.without)
        if wrong is not None:
            m_uv, m_c, m_e = wrong.apply(uv, size, rel, data.g)
            m_e = as_of_real_people(m_e, a.real, data.g)
            use = torch.rand(len(uv), 1, generator=data.g, device=dev) < a.share
            m_e = m_e * (torch.rand(len(uv), 1, 1, generator=data.g, device=dev) >= a.without)
            x_uv, x_c, x_e = torch.where(use[..., None], m_uv, x_uv), torch.where(use, m_c, x_c), torch.where(use[..., None], m_e, x_e)
        x_c = x_c * inside
        if answers:
            i = torch.randint(len(answers[0]), (max(1, round(a.seen * a.batch)),), generator=data.g, device=dev)
            t_uv, t_c, t_e, t_rel = mirrored(*(t[i] for t in answers), data.g)
            t_e = as_of_real_people(t_e, a.real, data.g)
            t_e = t_e * (torch.rand(len(t_e), 1, 1, generator=data.g, device=dev) >= a.without / 2)
            x_uv, x_c, x_e, rel = (torch.cat(z) for z in ((x_uv, t_uv), (x_c, t_c), (x_e, t_e), (rel, t_rel)))
        if panel:
            rel = agreed(panel, x_uv, x_c, x_e, mask)
        if kept_people:
            i = torch.randint(len(kept_people[0]), (max(1, round(a.kept * a.batch)),), generator=data.g, device=dev)
            *t, t_rel = mirrored(*(t[i] for t in kept_people), data.g)
            x_uv, x_c, x_e, rel = (torch.cat(z) for z in zip((x_uv, x_c, x_e, rel), (*t, t_rel)))
        with torch.autocast(dev.type, torch.bfloat16, enabled=a.bf16):
            out = net2(stage2_input(x_uv, x_c, x_e, mask)).float()
        # Smooth L1 in decimetres on joints and on bones: bones keep limb lengths consistent
        loss = (F.smooth_l1_loss(out * 10, rel * 10, reduction="none", beta=0.3) * weight).mean() + 0.5 * F.smooth_l1_loss(
            bones(out) * 10, bones(rel) * 10, beta=0.3
        )
        opt.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(net2.parameters(), 2.0)
        opt.step()
        step += 1
        acc += loss.detach()
        with torch.no_grad():
            k = 1 - min(0.998, (1 + step) / (20 + step))
            src = net2.state_dict()
            for name, v in avg.state_dict().items():
                if v.is_floating_point():
                    v.lerp_(src[name], k)
        if step % a.log == 0 or (a.steps and step == a.steps):
            with torch.no_grad():
                r, r2 = errors(avg(test), rel_t), errors(avg(blind), rel_t)
            print(
                f"step {step} {a.log / (time.monotonic() - logged):.1f} steps/s loss {acc.item() / a.log:.4f} held-out clips, imitated input: "
                + " ".join(f"{k} {v:.1f}" for k, v in r.items())
                + f", from 2D alone: mpjpe {r2['mpjpe']:.1f} pa_mpjpe {r2['pa_mpjpe']:.1f}"
                + (f", as seen {errors(avg(seen_test), seen_rel)}" if wrong is not None else ""),
                flush=True,
            )
            acc.zero_()
            logged = time.monotonic()
        now = clock.step()
    with torch.no_grad():
        report = {
            "imitated": errors(avg(test), rel_t),
            "imitated, 2D alone": errors(avg(blind), rel_t),
            "clean": errors(avg(clean), rel_t),
            "clean, 2D alone": errors(avg(clean2d), rel_t),
            "imitated, chained bones without stage II": errors(naive(conf, enc), rel_t),
        }
        if wrong is not None:
            report["Stage I's true mistakes"] = errors(avg(real_test), rel_t)
            report["Stage I's true mistakes, 2D alone"] = errors(avg(real_blind), rel_t)
            report["as Stage I sees people"] = errors(avg(seen_test), seen_rel)
            report["as Stage I sees people, 2D alone"] = errors(avg(seen_blind), seen_rel)
            if panel:
                report["Stage I's true mistakes, --mean-of"] = errors(agreed(panel, real_uv, real_conf, real_enc, mask), rel_t)
                report["as Stage I sees people, --mean-of"] = errors(agreed(panel, *seen_answers, mask), seen_rel)
            report["as Stage I sees people, mean of both"] = errors((avg(seen_test) + avg(seen_blind)) / 2, seen_rel)
        if posed:
            report["posed people, imitated"] = errors(avg(p_test), p_rel)
        near = tall > NEAR
        report["imitated, close to the camera"] = errors(avg(test[near]), rel_t[near])
        report["imitated, farther away"] = errors(avg(test[~near]), rel_t[~near])
        full = (conf > 0).all(1)
        report["imitated, all 14 joints seen"] = errors(avg(test[full]), rel_t[full])
        report["imitated, joints missing"] = errors(avg(test[~full]), rel_t[~full])
    for k, v in report.items():
        print(f"{k:45}" + " ".join(f"{n} {x:6.1f}" for n, x in v.items()), flush=True)
    a.out.mkdir(parents=True, exist_ok=True)
    torch.save({"net": avg.state_dict(), "step": step, "people": step * a.batch, "report": report, "stage1": bool(a.stage1), "open": a.open}, a.out / "stage2.pt")


if __name__ == "__main__":
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("pack", type=pathlib.Path)
    ap.add_argument("out", type=pathlib.Path)
    ap.add_argument("--minutes", type=float, default=8, help="of a pause (kill -STOP) two count, or ten steps where those are longer")
    ap.add_argument("--steps", type=int, default=0)
    ap.add_argument("--batch", type=int, default=512)
    ap.add_argument("--seen", type=float, default=0.3, help="people as Stage I reported them added to a batch, over its size")
    ap.add_argument("--repeat", type=int, default=3, help="steps on the same people, corrupted anew each time")
    ap.add_argument("--lr", type=float, default=2e-3)
    ap.add_argument("--stage1", type=pathlib.Path, help="checkpoint folder of Stage I")
    ap.add_argument("--scenes", type=int, default=8192)
    ap.add_argument("--test", type=int, default=4096)
    ap.add_argument("--log", type=int, default=200)
    ap.add_argument("--seed", type=int, default=3)
    ap.add_argument("--mean-of", type=pathlib.Path, nargs="*", default=[], help="Stage II files whose mean answer, with and without encodings, is learnt")
    ap.add_argument("--keep", type=pathlib.Path, help="Stage II file whose answers about real people of unknown 3D stay")
    ap.add_argument("--kept", type=float, default=0.2, help="such people added to a batch, over its size")
    ap.add_argument("--posed", type=pathlib.Path, help="truth.json of edgecap synth --stills --truth-only")
    ap.add_argument("--posed-share", type=float, default=0.4, help="their share of a batch")
    ap.add_argument("--without", type=float, default=0.5, help="share of people shown without encodings: one network for both inputs")
    ap.add_argument("--mistakes", type=pathlib.Path, nargs="*", default=[], help="what mistakes.py collected")
    ap.add_argument("--share", type=float, default=0.6, help="share of people that carry those mistakes")
    ap.add_argument("--real", type=float, default=0.0, help="share of the people with Stage I's answers whose encodings become as shallow and noisy as those of real people")
    ap.add_argument("--init", type=pathlib.Path, help="stage2.pt, or an exported stage2.safetensors, to start from")
    ap.add_argument("--open", action="store_true", help="only motion and weights that may be used commercially")
    ap.add_argument("--bf16", action="store_true", help="twice as fast where the CPU has AMX; end with a few minutes without")
    ap.add_argument("--threads", type=int, default=0)
    ap.add_argument("--cpu", action="store_true")
    train(ap.parse_args(sys.argv[1:]))
