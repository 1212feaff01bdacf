"""Train Stage I.  One process, one GPU; the schedule follows the clock, so it always ends on time.

    python train.py PACK OUT --total 26 --minutes 9 [--resume] [--quant-last 0.12]

With `--open` nothing academic is taken: no LSP, only packs and scenes marked as open, a start from random or from open weights.

`--total` is the length of the whole schedule in minutes, `--minutes` how long this call may take of it (start and saving included).
Run the same line again with `--resume` until the schedule is used up; give `--finish` to the last call.
"""

from __future__ import annotations

import argparse
import copy
import json
import math
import pathlib
import signal
import sys
import time
from dataclasses import dataclass, replace
from typing import TextIO

import torch
from torch import Tensor, nn

import backbone
import checkpoint
import quant
import renorm
import targets
import terms
from ahead import Ahead
from augment import photometric
from clock import Clock
from distil import Teachers, leave_depth
from everyday_tiles import Everyday
from model import SelecSLSNet
from muon import Muon
from pool import Pool, Rendered, Stored
from precision import bf16_pays
from ranks import Group, launch
from real import TEACHER, People, RealBatch, load_photos
from scenes import Generator


@dataclass
class Mix:
    """What a batch is made of."""

    H: int
    W: int
    real: int  # tiles of each kind in a batch (of one process)
    synth: int
    size: tuple[float, float]  # stature in pixels of the real people
    people: list[float]  # probabilities of 0, 1, 2, ... real people in a tile
    zoom: tuple[float, float]  # of synthetic scenes
    close: bool = False  # people of `size` before the camera, most of them without legs; at most `zoom` times as large as rendered
    everyday: int = 0  # tiles of photos in which everybody is labelled
    view: tuple[float, float] = (0.6, 1.3)  # of those photos, times what a whole frame shows
    sized: bool = False  # people of those photos, too, are of `size`


@dataclass
class Phase:
    until: float  # share of the schedule
    mixes: list[Mix]  # taken in turns


GPU_PHASES = [
    Phase(0.30, [Mix(192, 192, 192, 192, (70, 200), [0.06, 0.72, 0.14, 0.08], (0.7, 1.2))]),
    Phase(
        0.78,
        [Mix(256, 256, 128, 128, (80, 290), [0.06, 0.56, 0.22, 0.16], (0.8, 1.3))] * 3
        + [Mix(256, 256, 128, 128, (280, 800), [0.05, 0.73, 0.15, 0.07], (0.5, 2.6), close=True)],
    ),
    Phase(
        1.1,
        [Mix(320, 512, 48, 48, (55, 330), [0.05, 0.30, 0.30, 0.20, 0.15], (0.95, 1.15))] * 3
        + [Mix(320, 512, 48, 48, (300, 900), [0.05, 0.60, 0.20, 0.10, 0.05], (0.5, 2.6), close=True)],
    ),
]
# A CPU has no time for empty pixels: small tiles full of people first, larger ones for larger people and crowds later.  What counts is
# people of 100 to 300 px, at a kiosk rather more.  Where a network is good follows the sizes it is trained with: the fourth model, whose mixes had
# medians of 85 to 120 px, lost 14 points of PCK from 112 to 188 px; the sixth (122 to 170 px) 8 from 150 to 270 px.
CPU_PHASES = [
    Phase(
        0.30,
        [
            Mix(128, 128, 10, 4, (55, 132), [0.08, 0.64, 0.28], (0.5, 1.0)),
            Mix(192, 192, 5, 2, (60, 200), [0.10, 0.46, 0.28, 0.16], (0.6, 1.1)),
        ],
    ),
    Phase(
        0.85,
        [
            Mix(192, 192, 6, 2, (85, 240), [0.08, 0.54, 0.26, 0.12], (0.7, 1.3)),
            Mix(256, 256, 4, 2, (120, 340), [0.08, 0.50, 0.25, 0.12, 0.05], (0.8, 1.5)),
            Mix(192, 192, 6, 2, (85, 240), [0.08, 0.54, 0.26, 0.12], (0.7, 1.3)),
            Mix(256, 256, 4, 2, (280, 800), [0.05, 0.79, 0.16], (0.5, 2.6), close=True),
        ],
    ),
    Phase(
        1.1,
        [
            Mix(256, 256, 4, 1, (100, 340), [0.10, 0.42, 0.24, 0.16, 0.08], (0.8, 1.5)),
            Mix(320, 512, 2, 1, (65, 370), [0.10, 0.20, 0.24, 0.24, 0.22], (0.95, 1.4)),
            Mix(256, 256, 4, 1, (280, 800), [0.05, 0.79, 0.16], (0.5, 2.6), close=True),
            Mix(320, 512, 2, 1, (65, 370), [0.10, 0.20, 0.24, 0.24, 0.22], (0.95, 1.4)),
            Mix(320, 512, 2, 1, (300, 900), [0.05, 0.65, 0.20, 0.10], (0.5, 2.6), close=True),
        ],
    ),
]
# A trained network and photos in which everybody is labelled: those make two of three tiles, what it learnt before the rest. Half of the
# people of Stanford 40 are taller than 250 px in a whole frame, so whole frames hold what close windows do and more beside it.
CPU_EVERYDAY_PHASES = [
    Phase(
        0.50,
        [
            Mix(192, 192, 1, 1, (85, 240), [0.08, 0.54, 0.26, 0.12], (0.7, 1.3), everyday=4),
            Mix(256, 256, 1, 1, (120, 340), [0.08, 0.50, 0.25, 0.12, 0.05], (0.8, 1.5), everyday=4, view=(0.6, 1.2)),
            Mix(256, 256, 1, 1, (280, 800), [0.05, 0.79, 0.16], (0.5, 2.6), close=True, everyday=4),
        ],
    ),
    Phase(
        1.1,
        [
            Mix(320, 512, 1, 1, (65, 370), [0.10, 0.20, 0.24, 0.24, 0.22], (0.95, 1.4), everyday=4, view=(0.85, 1.15)),
            Mix(256, 256, 1, 1, (120, 340), [0.08, 0.50, 0.25, 0.12, 0.05], (0.8, 1.5), everyday=4, view=(0.6, 1.2)),
            Mix(512, 320, 1, 1, (65, 400), [0.10, 0.30, 0.30, 0.30], (1.05, 1.4), everyday=4, view=(0.85, 1.15)),
            Mix(256, 256, 1, 1, (280, 800), [0.05, 0.79, 0.16], (0.5, 2.6), close=True, everyday=4),
            Mix(400, 400, 1, 1, (65, 450), [0.10, 0.30, 0.30, 0.30], (0.95, 1.5), everyday=4, view=(1.0, 1.45)),
        ],
    ),
]
# The same on a GPU, which spends a tenth of a second a step on launches whatever the batch holds.
GPU_EVERYDAY_PHASES = [
    Phase(
        0.35,
        [
            Mix(192, 192, 112, 80, (85, 240), [0.08, 0.54, 0.26, 0.12], (0.7, 1.3), everyday=448),
            Mix(256, 256, 64, 48, (120, 340), [0.08, 0.50, 0.25, 0.12, 0.05], (0.8, 1.5), everyday=256, view=(0.6, 1.2)),
            Mix(256, 256, 64, 48, (280, 800), [0.05, 0.79, 0.16], (0.5, 2.6), close=True, everyday=256),
        ],
    ),
    Phase(
        1.1,
        [
            Mix(320, 512, 32, 24, (65, 370), [0.10, 0.20, 0.24, 0.24, 0.22], (0.95, 1.4), everyday=128, view=(0.85, 1.15)),
            Mix(256, 256, 64, 48, (120, 340), [0.08, 0.50, 0.25, 0.12, 0.05], (0.8, 1.5), everyday=256, view=(0.6, 1.2)),
            Mix(512, 320, 32, 24, (65, 400), [0.10, 0.30, 0.30, 0.30], (1.05, 1.4), everyday=128, view=(0.85, 1.15)),
            Mix(256, 256, 64, 48, (280, 800), [0.05, 0.79, 0.16], (0.5, 2.6), close=True, everyday=256),
            Mix(400, 400, 32, 24, (65, 450), [0.10, 0.30, 0.30, 0.30], (0.95, 1.5), everyday=128, view=(1.0, 1.45)),
        ],
    ),
]
# From random weights and open data alone: small tiles first, since a picture costs by its size, then what people before a screen look like.
NOBODY: list[float] = []
CPU_OPEN_PHASES = [
    Phase(
        0.20,
        [
            Mix(128, 128, 0, 4, (50, 130), NOBODY, (0.35, 0.9), everyday=8, sized=True),
            Mix(128, 128, 0, 4, (70, 200), NOBODY, (0.5, 1.3), everyday=8, sized=True),
            Mix(192, 192, 0, 2, (70, 220), NOBODY, (0.5, 1.1), everyday=4, sized=True),
        ],
    ),
    Phase(
        0.70,
        [
            Mix(192, 192, 0, 2, (80, 260), NOBODY, (0.6, 1.3), everyday=5, sized=True),
            Mix(256, 256, 0, 1, (100, 340), NOBODY, (0.7, 1.4), everyday=3, view=(0.6, 1.2)),
            Mix(192, 192, 0, 2, (200, 600), NOBODY, (0.5, 2.6), close=True, everyday=5),
            Mix(256, 256, 0, 1, (280, 800), NOBODY, (0.5, 2.6), close=True, everyday=3),
        ],
    ),
    Phase(
        1.1,
        [
            Mix(320, 512, 0, 1, (65, 370), NOBODY, (0.95, 1.4), everyday=3, view=(0.85, 1.15)),
            Mix(256, 256, 0, 1, (120, 340), NOBODY, (0.8, 1.5), everyday=4, view=(0.6, 1.2)),
            Mix(512, 320, 0, 1, (65, 400), NOBODY, (1.05, 1.4), everyday=3, view=(0.85, 1.15)),
            Mix(256, 256, 0, 1, (280, 800), NOBODY, (0.5, 2.6), close=True, everyday=4),
        ],
    ),
]
GPU_OPEN_PHASES = [
    Phase(
        0.30,
        [
            Mix(192, 192, 0, 192, (60, 200), NOBODY, (0.5, 1.1), everyday=448, sized=True),
            Mix(192, 192, 0, 192, (80, 260), NOBODY, (0.6, 1.3), everyday=448, sized=True),
        ],
    ),
    Phase(
        0.70,
        [
            Mix(192, 192, 0, 192, (80, 260), NOBODY, (0.6, 1.3), everyday=448, sized=True),
            Mix(256, 256, 0, 128, (100, 340), NOBODY, (0.7, 1.4), everyday=256, view=(0.6, 1.2)),
            Mix(256, 256, 0, 128, (280, 800), NOBODY, (0.5, 2.6), close=True, everyday=256),
        ],
    ),
    Phase(
        1.1,
        [
            Mix(320, 512, 0, 48, (65, 370), NOBODY, (0.95, 1.4), everyday=128, view=(0.85, 1.15)),
            Mix(256, 256, 0, 128, (120, 340), NOBODY, (0.8, 1.5), everyday=256, view=(0.6, 1.2)),
            Mix(512, 320, 0, 48, (65, 400), NOBODY, (1.05, 1.4), everyday=128, view=(0.85, 1.15)),
            Mix(256, 256, 0, 128, (280, 800), NOBODY, (0.5, 2.6), close=True, everyday=256),
            Mix(400, 400, 0, 48, (65, 450), NOBODY, (0.95, 1.5), everyday=128, view=(1.0, 1.45)),
        ],
    ),
]
AWAY = 0.12  # share of open photos' tiles without people, which only they can show
EMA_EVERY = 4  # steps between two updates of the averaged weights
TINY_PHASES = [
    Phase(0.7, [Mix(96, 96, 4, 4, (50, 95), [0.06, 0.72, 0.22], (0.5, 0.9))]),
    Phase(1.1, [Mix(128, 160, 2, 2, (50, 120), [0.06, 0.60, 0.34], (0.4, 0.7))]),
]
TINY_EVERYDAY_PHASES = [Phase(q.until, [replace(m, everyday=2) for m in q.mixes]) for q in TINY_PHASES]
TINY_OPEN_PHASES = [Phase(q.until, [replace(m, real=0, people=NOBODY, everyday=2, sized=True) for m in q.mixes]) for q in TINY_PHASES]
PHASES = {
    "gpu": GPU_PHASES,
    "cpu": CPU_PHASES,
    "tiny": TINY_PHASES,
    "gpu everyday": GPU_EVERYDAY_PHASES,
    "cpu everyday": CPU_EVERYDAY_PHASES,
    "tiny everyday": TINY_EVERYDAY_PHASES,
    "gpu open": GPU_OPEN_PHASES,
    "cpu open": CPU_OPEN_PHASES,
    "tiny open": TINY_OPEN_PHASES,
}
WARM_UP = 300  # steps of a rate that is held


def finite(net: torch.nn.Module) -> bool:
    """Whether every weight and statistic is a number."""
    return all(bool(torch.isfinite(v).all()) for v in net.state_dict().values() if v.is_floating_point())


def turn_of(step: int, mixes: int, every: int) -> int | None:
    """How often the teachers were asked about the mix of this step before; None where they are not asked now.

    The `mixes` are taken in turns, one a step. Each is asked about in one of `every` rounds, neighbours in different ones,
    so that steps with and without teachers alternate."""
    asked, rest = divmod(sum(divmod(step, mixes)), every)
    return None if rest else asked


def lr_at(p: float, top: float, fall: float = 1.0, step: int = 0) -> float:
    """One cycle: 3 % warm-up, cosine to 0.2 %. With `fall` below 1 the rate is held after some steps of warm-up and falls in the last
    `fall` of the schedule alone, in a straight line to 0.2 %, so that the end can be set later."""
    if fall >= 1:
        return top * (p / 0.03 if p < 0.03 else max(0.5 * (1 + math.cos(math.pi * (p - 0.03) / 0.97)), 0.002))
    return top * min((step + 1) / WARM_UP, 1.0) * min(max((1 - p) / fall, 0.002), 1.0)


class Trainer:
    def __init__(self, a: argparse.Namespace):
        self.a = a
        self.dev = torch.device("cuda" if torch.cuda.is_available() and not a.cpu else "cpu")
        self.cuda = self.dev.type == "cuda"
        self.bf16 = a.bf16 and bf16_pays(self.dev)
        self.group = Group(a.ranks)
        torch.manual_seed(a.seed + 101 * self.group.rank)
        if self.cuda:
            torch.backends.cudnn.benchmark = True
            # Geometry runs through matmul: TF32 there would move labels by centimetres.  Convolutions run in bf16 anyway.
            torch.backends.cuda.matmul.allow_tf32 = False
        self.phases = PHASES[("tiny" if a.tiny else "gpu" if self.cuda else "cpu") + (" open" if a.open else " everyday" if a.everyday else "")]
        self.small = not self.cuda or a.tiny
        self.out: pathlib.Path = a.out
        self.out.mkdir(parents=True, exist_ok=True)
        if a.open:
            self._all_open()
        self.net = SelecSLSNet().to(self.dev, memory_format=torch.channels_last)
        if a.init:
            backbone.start(self.net, a.init)
        self.ema = copy.deepcopy(self.net).requires_grad_(False)
        self._freeze()
        self.meta = dict(step=0, images=0, elapsed=0.0, quant=False, lr_scale=1.0, scratch=not a.init, open=a.open)
        self.opt = self._optimizer()
        ck = self.out / "ckpt"
        if a.resume:
            found = checkpoint.load(ck, self.net, self.ema, None, self.dev)
            if found.get("open", False) != a.open:
                kind, option = ("open", "with") if not a.open else ("other", "without")
                raise SystemExit(f"expected a run of the same kind to resume, found one of {kind} data in {ck}: go on {option} --open")
            self.meta |= {"scratch": False} | found
            if self.meta["quant"]:
                self._quantise()
                checkpoint.load(ck, self.net, self.ema, None, self.dev)
            self.opt = self._optimizer()
            checkpoint.load(ck, self.net, self.ema, self.opt, self.dev)
            print(f"resumed at step {self.meta['step']}, {self.meta['elapsed'] / 60:.2f} min of the schedule used", flush=True)
        if a.from_average:
            self.net.load_state_dict(self.ema.state_dict())
        self.stop = False
        if not a.resume:  # every rank starts from rank 0's random numbers
            self.group.same_weights(self.net)
            self.ema.load_state_dict(self.net.state_dict())
        for s in (signal.SIGTERM, signal.SIGINT):
            signal.signal(s, self._on_signal)
        self._pairs()
        self.teachers = Teachers(a.distil, self.dev, self.bf16) if a.distil else None
        self.fwd = torch.compile(self.net) if a.compile else self.net

    def _all_open(self) -> None:
        """Ends the program unless everything that is learnt from may be used commercially."""
        a = self.a
        if not a.everyday or not a.scenes:
            raise SystemExit("expected --everyday and --scenes with --open: nothing else is open")
        parts: dict[str, str] = {}
        for folder in (a.everyday, *a.scenes):
            parts |= terms.ingredients(folder)
        for path in ([a.init] if a.init else []) + a.distil:
            terms.require_open_weights(path)
        if self.group.first:
            print("open: " + "; ".join(f"{k} ({v})" for k, v in parts.items()), flush=True)

    def _on_signal(self, *_: object) -> None:
        self.stop = True

    def _frozen(self) -> list[nn.Module]:
        """The stem and the first modules: they work at the finest resolution, so they cost most, and change least late in training."""
        if self.a.head3d:
            return [self.net.stem, *self.net.features, self.net.head2d]
        return [self.net.stem, *self.net.features[: self.a.freeze - 1]] if self.a.freeze else []

    def _freeze(self) -> None:
        for m in self._frozen():
            m.eval().requires_grad_(False)

    def _optimizer(self) -> torch.optim.Optimizer:
        learnt = [p for p in self.net.parameters() if p.requires_grad]
        hidden = self._hidden() if self.a.muon else {}
        groups = [
            dict(params=[p for p in learnt if p.ndim > 1 and p not in hidden], weight_decay=self.a.wd),
            dict(params=[p for p in learnt if p.ndim <= 1], weight_decay=0.0),
        ]
        adam = dict(betas=(0.9, 0.98), fused=True)
        if self.a.muon:
            return Muon(list(hidden.items()), groups, lr=self.a.lr, wd=self.a.wd, **adam)
        return torch.optim.AdamW(groups, lr=self.a.lr, **adam)

    def _hidden(self) -> dict[nn.Parameter, int]:
        """Weights of the convolutions between the first and the last ones, with their groups."""
        ends = [self.net.stem[0], self.net.head2d.out, self.net.head3d.out]
        convs = [m for m in self.net.modules() if isinstance(m, (nn.Conv2d, nn.ConvTranspose2d)) and m not in ends]
        return {m.weight: m.groups for m in convs if m.weight.requires_grad}

    def _pairs(self) -> None:
        n, e = self.net.state_dict(), self.ema.state_dict()
        keys = [k for k in e if e[k].is_floating_point()]
        self.ema_t, self.net_t = [e[k] for k in keys], [n[k] for k in keys]

    def _quantise(self) -> None:
        for m in (self.net, self.ema):
            quant.prepare(m)
        for m, e in zip(self.net.modules(), self.ema.modules()):
            if isinstance(m, quant.QuantReLU):
                e.amax = m.amax  # ranges are shared, not averaged
            if isinstance(m, nn.BatchNorm2d):
                m.eval()  # the engine folds these statistics: fine-tune with them fixed
        self.meta["quant"] = True
        self._pairs()

    # ------------------------------------------------------------------- data

    def build_data(self) -> None:
        a, t = self.a, time.time()
        # LSP's people teach the 3D head nothing without depth, and it alone is learnt
        lsp = not a.open and not (a.head3d and a.everyday and a.scenes and not (a.pack / TEACHER).exists())
        photos = load_photos(a.pack, self.dev, 40 if a.tiny else 0) if lsp else None
        seed = a.seed + 7919 * self.meta["step"] + 131 * self.group.rank  # a resumed run sees new scenes, every rank its own
        self.people: People | None = None
        if photos is not None:
            if a.cache and not self.group.first:
                self.group.wait()  # rank 0 decodes into the cache
            self.people = People(a.pack, self.dev, photos, seed + 1, limit=150 if a.tiny else 0, cache=a.cache)
            if a.cache and self.group.first:
                self.group.wait()
        self.everyday: Everyday | Ahead | None = None
        if a.everyday:
            away = AWAY if a.open else 0.0
            self.everyday = Ahead(a.everyday, seed + 3, away, self.dev) if self.cuda else Everyday(a.everyday, seed + 3, away)
        t1 = time.time()
        self.pools: list[Pool] = [Stored(p, seed + 2 + i, self.dev) for i, p in enumerate(a.scenes)]
        if not self.pools:
            assert photos is not None
            gen = Generator(a.pack, self.dev, photos, seed, supersample=1 if a.tiny else 2, chunk=4 if self.small else 64)
            self.pools = [Rendered(gen, 64 if a.tiny else a.pool, first=12 if a.tiny else 64 if self.small else 512)]
        if self.cuda:
            torch.cuda.synchronize()
        if self.group.first:
            scenes = [p.filled for p in self.pools]
            print(f"data: photos and people {t1 - t:.1f} s, first {scenes} scenes {time.time() - t1:.1f} s", flush=True)

    def batch(self, ph: Mix) -> tuple[Tensor, Tensor | None, targets.Targets, targets.Targets, RealBatch | None]:
        """Pictures as the network takes them [B, 3, H, W], real ones first; the same before blur, noise and low light, where there are teachers
        to be asked about them; targets of the real and of the rendered ones; what LSP's people were pasted from."""
        h, w = ph.H // 8, ph.W // 8
        images, real, r = [], [], None
        if self.people is not None:
            r = self.people.batch(ph.real, ph.H, ph.W, ph.size, ph.people, ph.close)
            images.append(r.image)
            real.append(targets.real(r.joints2d, r.labelled, r.hidden, r.size_px, r.known, r.box, r.rel3d, r.lifted))
        pool = self.pools[int(torch.randint(len(self.pools), ()))]  # folders of scenes count alike, whatever they hold
        s = pool.draw(ph.synth, ph.H, ph.W, ph.zoom, close=ph.size if ph.close else None)
        if self.everyday is not None:
            e = self.everyday.batch(ph.everyday, ph.H, ph.W, ph.view, ph.size if ph.close or ph.sized else None, ph.close)
            images.append(e.image)
            real.append(targets.everyday(e.joints2d, e.labelled, e.unknown, e.size_px, e.box, e.hazy, e.rel3d, e.lifted))
        tr = real[0] if len(real) == 1 else targets.together(*real)
        clean = torch.cat([*images, s.image])
        x = (photometric(clean, pool.g) - 0.5).contiguous(memory_format=torch.channels_last)
        shown = (clean - 0.5).contiguous(memory_format=torch.channels_last) if self.teachers is not None else None
        ts = targets.synthetic(s.joints2d, s.visible, s.rel3d, s.size_px, s.depth, h, w)
        return x, shown, tr, ts, r

    # ------------------------------------------------------------------- step

    @property
    def lends(self) -> bool:
        """Whether anybody in the photos lends depth."""
        return any(source is not None and source.lends for source in (self.people, self.everyday))

    def losses(
        self, x: Tensor, shown: Tensor | None, tr: targets.Targets, ts: targets.Targets, p: float = 0.0, everyday: int = 0, turn: int = 0
    ) -> tuple[Tensor, Tensor]:
        """The six losses, what the teachers ask of the pictures `shown` to them (0 without), and the joint maps of the real tiles, of which the
        last `everyday` are photos in which everybody is labelled. `turn` counts the questions to the teachers about such
        tiles.

        The labels' 2D losses count less (`--distil-weight`) in the tiles of which teachers are asked: not in those photos, of which the teachers
        say nothing in 2D. Their 3D loss never does: the teachers are silent where labels know depth.
        """
        n = len(tr.maps)
        first3d = 0 if shown is not None or self.lends else n
        share = x.new_ones(len(x))
        if shown is not None:
            share[: n - everyday], share[n:] = 1 - self.a.distil_weight, 1 - self.a.distil_weight
        with torch.autocast(self.dev.type, torch.bfloat16, enabled=self.bf16):
            y, e = self.fwd(x, first3d)
        peak = self.a.peak[0] + (self.a.peak[1] - self.a.peak[0]) * p
        hr, pr = targets.loss2d(y[:n], tr, peak, share[:n])
        hs, ps = targets.loss2d(y[n:], ts, peak, share[n:])
        where = targets.location_loss(y[:n], tr, share[:n]) + targets.location_loss(y[n:], ts, share[n:])
        enc = targets.loss3d(e[n - first3d :], ts)
        if not first3d:  # a teacher's depth counts less than the renderer's
            enc = enc + self.a.lend * targets.loss3d(e[:n], tr)
        asked = self._taught(shown, y, e, tr, peak, everyday, turn) if shown is not None else enc.new_zeros(())
        return torch.stack([hr, pr, hs, ps, enc, where, asked]), y[:n].detach()

    def _taught(self, shown: Tensor, y: Tensor, e: Tensor, tr: targets.Targets, peak: float, everyday: int, turn: int = 0) -> Tensor:
        """The same losses against what the teachers answer to the pictures `shown`: 2D of all tiles together, weighted as those of the two kinds
        are in sum, 3D of the real ones.

        In photos in which everybody is labelled, the last `everyday` of the real tiles, only the teachers' 3D counts: in 2D the labels know
        better.
        """
        assert self.teachers is not None
        t = self.teachers.answer(shown, turn)
        n = len(tr.maps)
        t.weight[n - everyday : n] = 0
        leave_depth(t, tr, self.lends)
        hm, paf = targets.loss2d(y, t, peak)
        flat = (1 + self.a.synth) * (hm + 0.5 * paf) + 2 * self.a.where * targets.location_loss(y, t)
        return flat + self.a.lend * self.a.w3d * targets.loss3d(e, t)

    def step(self, ph: Mix, p: float, turn: int | None) -> Tensor:
        """One step at share `p` of the schedule; `turn` as `turn_of` says."""
        lr = lr_at(p, self.a.lr, self.a.fall, self.meta["step"]) * self.meta["lr_scale"]
        if self.meta["scratch"]:
            renorm.BatchRenorm2d.limits = renorm.limits_at(self.meta["step"])
        for g in self.opt.param_groups:
            g["lr"] = lr
        x, shown, tr, ts, r = self.batch(ph)
        taught = turn is not None and (not ph.close or self.everyday is not None)  # older networks have not seen people as large
        L, y = self.losses(x, shown if taught else None, tr, ts, p, ph.everyday if self.everyday else 0, turn or 0)
        warm = min(1.0, self.meta["step"] / 150)
        synth = self.a.synth
        share = [1.0, 0.5, synth, synth / 2, self.a.w3d, self.a.where * warm, self.a.distil_weight]
        loss = sum(w * part for w, part in zip(share, L.unbind()) if w)
        assert isinstance(loss, Tensor)
        loss.backward()
        if self.a.sync == 1:
            self.group.average_grads(self.net)
        norm = nn.utils.clip_grad_norm_(self.net.parameters(), 4.0 if self.meta["step"] > 50 else 10.0, foreach=True)
        self.opt.step()
        self.opt.zero_grad(set_to_none=True)
        if self.people is not None and r is not None:
            self._remember(self.people, r, y[: ph.real])
        self.meta["step"] += 1
        k = self.meta["step"]
        self.meta["images"] += len(x) * self.group.count
        if k % self.a.sync == 0:
            self._meet()
        if k % EMA_EVERY == 0:
            with torch.no_grad():
                torch._foreach_lerp_(self.ema_t, self.net_t, 1 - min(self.a.ema**EMA_EVERY, (1 + k) / (20 + k)))
        return torch.cat([L.detach(), norm.detach()[None]])

    def _remember(self, people: People, r: RealBatch, y: Tensor) -> None:
        """Photos without people that make the network see some are shown again sooner."""
        bad = (y[:, : targets.NJ].float().amax((2, 3)).mean(1)).clamp(0, 1)
        if self.cuda:
            bad = torch.where(r.empty, bad, (people.photo_weight[r.photo] - 0.1) / 4)  # no wait for the device
            people.fired(r.photo, bad)
        else:
            people.fired(r.photo[r.empty], bad[r.empty])

    def choose_groups(self, ph: Mix) -> None:
        """Time grouped convolutions against their dense equivalents on this device; weights and statistics are put back."""
        if self.a.groups != "auto" or not self.cuda:
            self.net.set_dense_groups(self.a.groups == "dense")
            return
        keep = {k: v.clone() for k, v in self.net.state_dict().items()}
        x, shown, tr, ts, _ = self.batch(ph)
        best: dict[bool, float] = {}
        for dense in (False, True):
            self.net.set_dense_groups(dense)
            for i in range(6):
                if i == 3:
                    torch.cuda.synchronize()
                    t = time.time()
                self.losses(x, shown, tr, ts)[0].sum().backward()
                self.net.zero_grad(set_to_none=True)
            torch.cuda.synchronize()
            best[dense] = (time.time() - t) / 3
        self.net.set_dense_groups(best[True] < best[False])
        self.net.load_state_dict(keep)
        print(f"groups: native {best[False] * 1e3:.0f} ms, dense {best[True] * 1e3:.0f} ms a batch of {len(x)}", flush=True)

    # -------------------------------------------------------------------- run

    @torch.no_grad()
    def _meet(self) -> None:
        """Ranks that went their own ways agree on the mean of their weights; those that share every gradient are equal anyway."""
        if self.a.sync > 1:
            self.group.average(list(self.net.parameters()))

    def save(self) -> None:
        self._meet()
        self.group.average_statistics(self.net)
        self.group.average_statistics(self.ema)
        # the loss is looked at every so many steps: what went wrong since must not take the last good weights' place
        if self.group.first and all(map(finite, (self.net, self.ema))):
            checkpoint.save(self.out / "ckpt", self.net, self.ema, self.opt, self.meta)

    def recover(self) -> None:
        """A non-finite loss: go back to the last checkpoint and go on more slowly."""
        if not (self.out / "ckpt").exists():
            raise SystemExit(f"expected finite losses, found others before there was a checkpoint in {self.out}: begin with a lower --lr")
        print("non-finite loss: back to the last checkpoint at half the rate", flush=True)
        keep = dict(self.meta)
        self.opt = self._optimizer()
        found = checkpoint.load(self.out / "ckpt", self.net, self.ema, self.opt, self.dev)
        if self.meta["quant"] and not found.get("quant"):
            quant.forget(self.net)  # a checkpoint from before the rounding has no ranges to go back to
        self.meta = keep
        self.meta["lr_scale"] *= 0.5

    def run(self, clock: Clock) -> None:
        """`clock` began with the program."""
        a = self.a
        self.build_data()
        self.choose_groups(self.phases[-2].mixes[0])
        t0 = saved = clock.whole()
        off = self.meta["elapsed"]
        end = a.minutes * 60 - (3 if self.small else 12)  # time to write the checkpoint
        total = off + end - t0 if a.finish else a.total * 60  # the last call bends the schedule to end with it
        now, logged = t0, time.monotonic()
        acc, n, images, debt = torch.zeros(8, device=self.dev), 0, self.meta["images"], 0.0
        log = open(self.out / "log.jsonl", "a") if self.group.first else None
        every = 5 if a.tiny else 20 if self.small else 50
        chunk = 4 if self.small else 64
        while True:
            self.meta["elapsed"] = off + now - t0
            p = self.meta["step"] / a.steps if a.steps else self.meta["elapsed"] / max(total, 1e-9)
            p = min(p, 1.0)
            stop = p >= 1 or now >= end or self.stop
            if self.meta["step"] % a.sync == 0:
                p, stop, due = self.group.same([p, float(stop), float(now - saved > a.save_every)])
                if stop:
                    break
            else:
                due = 0.0
            if a.quant_last and p > 1 - a.quant_last and not self.meta["quant"]:
                self._quantise()
                self.fwd = self.net  # a compiled graph would not see the new modules
                print("int8 fake quantisation on", flush=True)
            at = a.sizes_from + (1 - a.sizes_from) * p
            mixes = next((q for q in self.phases if at < q.until), self.phases[-1]).mixes
            ph = mixes[self.meta["step"] % len(mixes)]
            acc += self.step(ph, p, turn_of(self.meta["step"], len(mixes), a.distil_every))
            n += 1
            # whole frames show a scene more fully than tiles do, so they are reused less
            debt += ph.synth / (a.reuse * (1 if ph.W < 512 else 0.5))
            if debt >= chunk:
                for pool in self.pools:
                    pool.refresh(chunk)
                debt -= chunk
            if n >= every:
                v = (acc / n).tolist()  # the only wait of the loop
                if log is not None:
                    self._log(log, v, p, ph, (self.meta["images"] - images) / (time.monotonic() - logged))
                acc.zero_()
                n, images, logged = 0, self.meta["images"], time.monotonic()
                if self.group.any(not all(map(math.isfinite, v))):
                    self.recover()
            if due:
                self.save()
                saved = now
            now = clock.step()
        self.save()
        if isinstance(self.everyday, Ahead):
            self.everyday.close()
        if log is not None:
            log.close()
        if self.group.first:
            hint = "" if p >= 0.999 else ": run again with --resume"
            print(f"stopped at step {self.meta['step']}, {self.meta['images']} images, {100 * p:.1f} % of the schedule{hint}", flush=True)

    def _log(self, log: TextIO, v: list[float], p: float, ph: Mix, ips: float) -> None:
        names = ["hm_real", "paf_real", "hm_syn", "paf_syn", "enc", "where", "taught", "grad"]
        row = dict(p=round(p, 4), t=round(time.time()), step=self.meta["step"], images=self.meta["images"], ips=round(ips, 1))
        row |= dict(tile=[ph.H, ph.W], lr=self.opt.param_groups[0]["lr"]) | {k: round(x, 6) for k, x in zip(names, v)}
        if isinstance(self.everyday, Ahead):
            row["waited"] = round(self.everyday.waited, 1)  # in all: nearly all of the time means that the GPU waits for tiles
        if self.cuda:
            row["gib"] = round(torch.cuda.max_memory_allocated() / 2**30, 1)
        log.write(json.dumps(row) + "\n")
        log.flush()
        print(
            f"p {p:.3f} step {row['step']} {ips:.1f} img/s lr {row['lr']:.2e} hm real {v[0]:.4f} synth {v[2]:.4f} "
            f"paf {v[1]:.4f} {v[3]:.4f} enc {v[4]:.4f} where {v[5]:.1f} taught {v[6]:.4f} grad {v[7]:.2f} {row.get('gib', 0)} GiB",
            flush=True,
        )


def main(argv: list[str]) -> None:
    clock = Clock()
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("pack", type=pathlib.Path)
    ap.add_argument("out", type=pathlib.Path)
    ap.add_argument("--total", type=float, default=26, help="minutes of the whole schedule")
    ap.add_argument("--minutes", type=float, default=9, help="minutes this call may take, start and saving included; of a pause (kill -STOP) two count, or ten steps where those are longer")
    ap.add_argument("--finish", action="store_true", help="end the schedule with this call, whatever --total says; not with --steps")
    ap.add_argument("--steps", type=int, default=0, help="length of the whole schedule in steps, instead of --total")
    ap.add_argument("--resume", action="store_true")
    ap.add_argument("--lr", type=float, default=2e-3)
    ap.add_argument("--fall", type=float, default=1.0, help="below 1: the rate is held and falls in this last share of the schedule alone")
    ap.add_argument("--open", action="store_true", help="only data and weights that may be used commercially; needs --everyday and --scenes")
    ap.add_argument("--init", type=pathlib.Path, help="weights to start from: safetensors, or a public SelecSLS-60 backbone (backbone.py)")
    ap.add_argument("--sizes-from", type=float, default=0.0, help="share of the schedule of tile sizes to leave out: a trained network needs no small tiles")
    ap.add_argument("--head3d", action="store_true", help="learn the 3D head alone: what is found and where stays as it is")
    ap.add_argument("--freeze", type=int, default=0, help="keep the first blocks as they are: 1 is the stem, 3 all of quarter size")
    ap.add_argument("--from-average", action="store_true", help="resume from the averaged weights (before lowering the rate)")
    ap.add_argument("--ranks", type=int, default=1, help="processes that train together, one core each (CPU only)")
    ap.add_argument("--sync", type=int, default=1, help="1: ranks share every gradient; k: they go their own ways and average weights every k steps")
    ap.add_argument("--no-bf16", dest="bf16", action="store_false", help="f32 arithmetic even where bf16 is faster (precision.py)")
    ap.add_argument("--cache", type=pathlib.Path, help="folder for decoded photos, shared by the ranks")
    ap.add_argument("--scenes", type=pathlib.Path, nargs="*", default=[], help="folders of prerender.py, instead of rendering on the way")
    ap.add_argument("--peak", type=float, nargs=2, default=[9.0, 3.0], help="extra weight of heatmap peaks, at the start and at the end")
    ap.add_argument("--synth", type=float, default=1.0, help="weight of the synthetic tiles' 2D losses")
    ap.add_argument("--wd", type=float, default=0.02)
    ap.add_argument("--w3d", type=float, default=0.35, help="weight of the encodings' loss")
    ap.add_argument("--lend", type=float, default=0.7, help="weight of the teacher's 3D of real people, against 1 for rendered ones")
    ap.add_argument("--where", type=float, default=0.004, help="weight of the joint maps' location loss")
    ap.add_argument("--ema", type=float, default=0.999)
    ap.add_argument("--pool", type=int, default=4096, help="scenes kept on the device (0.5 MB each)")
    ap.add_argument("--reuse", type=float, default=12, help="tiles drawn per rendered scene")
    ap.add_argument("--distil", type=pathlib.Path, nargs="*", default=[], help="safetensors files of networks whose mean answer is learnt, too")
    ap.add_argument("--distil-every", type=int, default=1, help="steps from one question to the teachers to the next")
    ap.add_argument("--everyday", type=pathlib.Path, help="folder of everyday.py: photos in which everybody is labelled")
    ap.add_argument("--distil-weight", type=float, default=0.5, help="share of what the teachers ask; the labels have the rest, and all where teachers are silent")
    ap.add_argument("--muon", action="store_true", help="orthogonal updates for the hidden convolutions (README.md, On a CPU)")
    ap.add_argument("--quant-last", type=float, default=0.0, help="share of the schedule, at its end, with int8 fake quantisation")
    ap.add_argument("--groups", choices=["auto", "native", "dense"], default="auto")
    ap.add_argument("--compile", action="store_true", help="torch.compile the network (a minute per tile size)")
    ap.add_argument("--save-every", type=float, default=120, help="seconds")
    ap.add_argument("--seed", type=int, default=1)
    ap.add_argument("--tiny", action="store_true", help="CPU rehearsal sizes")
    ap.add_argument("--cpu", action="store_true")
    a = ap.parse_args(argv)
    if a.ranks > 1 and not a.cpu:
        ap.error("--ranks is for CPUs: give --cpu, too")
    if a.finish and a.steps:
        ap.error("expected --finish, which ends a schedule of minutes with this call, or --steps, found both: to end at another step give --steps alone")
    if not 0 <= a.distil_weight <= 1:
        ap.error(f"--distil-weight is a share from 0 to 1, found {a.distil_weight}")
    children = launch(a.ranks)
    Trainer(a).run(clock)
    for c in children:
        c.wait()


if __name__ == "__main__":
    main(sys.argv[1:])
