"""Reading and writing safetensors files: a length, a JSON header, raw little-endian data.  Not worth a dependency."""

from __future__ import annotations

import json
import os
import pathlib
import struct

import numpy as np
import torch
from torch import Tensor

NAMES = {torch.float32: "F32", torch.float16: "F16"}
TYPES = {"F32": np.float32, "F16": np.float16}


def write(path: pathlib.Path, tensors: dict[str, Tensor], metadata: dict[str, str]) -> None:
    """Write all at once: a reader sees the old file or the new one, never half of it."""
    head: dict[str, object] = {"__metadata__": metadata}
    at, blobs = 0, []
    for k in sorted(tensors):
        t = tensors[k].detach().cpu().contiguous()
        b = t.numpy().tobytes()
        head[k] = {"dtype": NAMES[t.dtype], "shape": list(t.shape), "data_offsets": [at, at + len(b)]}
        at += len(b)
        blobs.append(b)
    h = json.dumps(head).encode()
    h += b" " * (-len(h) % 8)
    part = path.with_name(f"{path.name}.{os.getpid()}")
    part.write_bytes(struct.pack("<Q", len(h)) + h + b"".join(blobs))
    os.replace(part, path)


def read(path: pathlib.Path) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Tensors as f32, and the metadata."""
    raw = path.read_bytes()
    if len(raw) < 8 or 8 + struct.unpack("<Q", raw[:8])[0] > len(raw):
        raise SystemExit(f"expected a safetensors file, found {len(raw)} bytes in {path}: fetch it again")
    n = struct.unpack("<Q", raw[:8])[0]
    head = json.loads(raw[8 : 8 + n])
    meta = head.pop("__metadata__", {})
    out = {}
    for k, v in head.items():
        a, b = v["data_offsets"]
        if v["dtype"] not in TYPES:
            raise SystemExit(f"expected F32 or F16, found {v['dtype']} for {k} in {path}")
        out[k] = torch.from_numpy(np.frombuffer(raw[8 + n + a : 8 + n + b], TYPES[v["dtype"]]).astype(np.float32)).view(v["shape"])
    return out, meta


def load_into(net: torch.nn.Module, path: pathlib.Path) -> dict[str, str]:
    """Fill a network from a file; names and shapes must agree (counters of batches may be missing)."""
    tensors, meta = read(path)
    own = net.state_dict()
    missing = [k for k in own if k not in tensors and not k.endswith("num_batches_tracked")]
    extra = [k for k in tensors if k not in own]
    if missing or extra:
        raise SystemExit(f"expected the tensors of {type(net).__name__} in {path}, missing {missing[:3]}, unknown {extra[:3]}")
    net.load_state_dict(tensors, strict=False)
    return meta
