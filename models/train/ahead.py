"""Tiles of photos made by other processes ahead of time: a GPU takes a thousand a second, one core makes three hundred.

Pictures come back in memory that all processes share, labels through a pipe.
"""

from __future__ import annotations

import dataclasses
import mmap
import multiprocessing
import os
import pathlib
import time
from collections import deque
from concurrent.futures import Future, ProcessPoolExecutor

import numpy as np
import torch
from torch import Tensor

from everyday_tiles import Batch, Everyday

CHUNK = 16  # tiles a task
MOST = 3 * 512 * 512  # bytes of a tile
SLOTS = 1024  # chunks on their way; only memory that was written to is taken
DEPTH = 3  # batches of every kind asked for before they are wanted
LABELS = [f.name for f in dataclasses.fields(Batch) if f.name != "image"]

_everyday: Everyday | None = None  # of a worker
_memory: mmap.mmap | None = None


def _alone() -> None:
    torch.set_num_threads(1)


def _make(slot: int, seed: int, n: int, H: int, W: int, *rest: object) -> list[np.ndarray]:
    """Tiles into a slot; returns their labels."""
    assert _everyday is not None and _memory is not None
    _everyday.g.manual_seed(seed)
    b = _everyday.batch(n, H, W, *rest)  # type: ignore[arg-type]
    np.frombuffer(_memory, np.uint8, n * 3 * H * W, slot * CHUNK * MOST)[:] = (b.image * 255).round().to(torch.uint8).numpy().ravel()
    return [getattr(b, k).numpy() for k in LABELS]


def _joined(parts: list[np.ndarray]) -> Tensor:
    """Labels of tiles with room for different numbers of people, of as many as any."""
    room = max(p.shape[1] for p in parts)
    out = np.zeros((sum(map(len, parts)), room, *parts[0].shape[2:]), parts[0].dtype)
    at = 0
    for p in parts:
        out[at : at + len(p), : p.shape[1]] = p
        at += len(p)
    return torch.from_numpy(out)


class Ahead:
    """Draws what `Everyday` draws, of decoded photos, on a device."""

    def __init__(self, folder: pathlib.Path, seed: int, away: float, device: torch.device, workers: int = 0):
        """`workers`: processes; 0: one a core but one."""
        global _everyday, _memory
        self.device, self.seed = device, seed << 32
        _everyday = Everyday(folder, seed, away)
        _everyday.keep_decoded()
        self.lends = _everyday.lends
        _memory = mmap.mmap(-1, SLOTS * CHUNK * MOST)
        self.memory = _memory
        self.free = deque(range(SLOTS))
        # by kind, the one that was wanted last at the end
        self.asked: dict[tuple[object, ...], deque[list[tuple[int, int, Future[list[np.ndarray]]]]]] = {}
        workers = workers or max(1, len(os.sched_getaffinity(0)) - 1)
        self.waited = 0.0  # seconds, for tiles that were not ready
        self.workers = ProcessPoolExecutor(workers, multiprocessing.get_context("fork"), _alone)

    def _slot(self, wanted: tuple[object, ...]) -> int:
        """A free slot; where there is none, those of the kind that was not wanted for longest: a phase before this one's."""
        while not self.free:
            kind = next((k for k, queue in self.asked.items() if queue and k != wanted), None)
            if kind is None:
                raise SystemExit(f"expected batches of {SLOTS * CHUNK} tiles together, found {DEPTH + 1} that hold more: raise ahead.SLOTS")
            for slot, _, future in self.asked[kind].popleft():
                if not future.cancel():
                    future.result()
                self.free.append(slot)
        return self.free.popleft()

    def _ask(self, n: int, H: int, W: int, *rest: object) -> list[tuple[int, int, Future[list[np.ndarray]]]]:
        if 3 * H * W > MOST:
            raise SystemExit(f"expected tiles of at most {MOST} bytes, found {H} x {W}: raise ahead.MOST")
        out = []
        for at in range(0, n, CHUNK):
            slot, count = self._slot((n, H, W, *rest)), min(CHUNK, n - at)
            self.seed += 1
            out.append((slot, count, self.workers.submit(_make, slot, self.seed, count, H, W, *rest)))
        return out

    def batch(
        self,
        n: int,
        H: int,
        W: int,
        zoom: tuple[float, float],
        tall: tuple[float, float] | None = None,
        close: bool = False,
    ) -> Batch:
        """As `Everyday.batch`; kinds that were asked for before are ready or under way."""
        kind = (n, H, W, zoom, tall, close)
        queue = self.asked.pop(kind, deque())
        self.asked[kind] = queue  # now the last of all
        while len(queue) <= DEPTH:
            queue.append(self._ask(*kind))
        cuda = self.device.type == "cuda"
        image = torch.empty(n, 3, H, W, dtype=torch.uint8, pin_memory=cuda)
        labels, at = [], 0
        for slot, count, future in queue.popleft():
            began = time.perf_counter()
            labels.append(future.result())
            self.waited += time.perf_counter() - began
            tiles = np.frombuffer(self.memory, np.uint8, count * 3 * H * W, slot * CHUNK * MOST)
            image[at : at + count] = torch.from_numpy(tiles.reshape(count, 3, H, W))
            self.free.append(slot)
            at += count

        def moved(t: Tensor) -> Tensor:
            return (t.pin_memory() if cuda else t).to(self.device, non_blocking=True)

        return Batch(image.to(self.device, non_blocking=True).float() / 255, *(moved(_joined([part[k] for part in labels])) for k in range(len(LABELS))))

    def close(self) -> None:
        self.workers.shutdown(cancel_futures=True)
