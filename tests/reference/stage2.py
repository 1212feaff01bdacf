"""PyTorch's answers for Stage II, for `tests/stages`.

    python stage2.py MODELS_TRAIN WEIGHTS.safetensors DATA/stage2-reference.safetensors

Writes the folded layers, random detections (some joints missing, some without a neck), the network's view-aligned joints, and the same
joints turned to camera axes for given camera-space necks.  Point EDGECAP_DATA at DATA and run
`cargo test --test stages pytorch -- --show-output`.
"""

from __future__ import annotations

import pathlib
import sys

import torch
from safetensors.torch import load_file, save_file


def main(kit: pathlib.Path, weights: pathlib.Path, out: pathlib.Path) -> None:
    sys.path.insert(0, str(kit))
    from body import ray_rotation
    from model import Stage2, channel_mask, stage2_input

    net = Stage2()
    state = {k: v.float() for k, v in load_file(weights).items()}
    missing, unexpected = net.load_state_dict(state, strict=False)
    assert not unexpected and all(k.endswith("num_batches_tracked") for k in missing), (missing, unexpected)
    net.eval()

    g = torch.Generator().manual_seed(5)
    n = 37
    neck = torch.rand(n, 2, generator=g) * torch.tensor([440.0, 250.0]) + 30
    uv = neck[:, None] + 40 * torch.randn(n, 14, 2, generator=g)
    conf = torch.rand(n, 14, generator=g) * (torch.rand(n, 14, generator=g) < 0.8)
    conf[:, 1] = conf[:, 1].clamp_min(0.4)
    conf[-3:, 1] = 0
    seen = (conf > 0).float()[..., None]
    uv = uv * seen
    enc = 0.3 * torch.randn(n, 14, 63, generator=g) * seen

    def run(e: torch.Tensor) -> torch.Tensor:
        with torch.no_grad():
            return net(stage2_input(uv, conf, e, channel_mask()))

    with torch.no_grad():
        aligned = run(enc)
        # neck pixels of a camera with f = 400 whose principal point is the middle of 512 x 320
        at = torch.cat([(uv[:, 1] - torch.tensor([255.5, 159.5])) / 400, torch.ones(n, 1)], 1)
        camera = aligned @ ray_rotation(at)  # rows: the transpose of ray_rotation applied to every joint

    tensors = dict(uv=uv, conf=conf, enc=enc, aligned=aligned, aligned_without_encodings=run(0 * enc), camera=camera)
    for i in range(1, 6):
        w = state[f"fc{i}.0.weight"]
        if i < 5:
            scale = state[f"fc{i}.1.weight"] / (state[f"fc{i}.1.running_var"] + 1e-5).sqrt()
            tensors[f"fc{i}.weight"] = w * scale[:, None]
            tensors[f"fc{i}.bias"] = state[f"fc{i}.1.bias"] - state[f"fc{i}.1.running_mean"] * scale
        else:
            tensors["fc5.weight"], tensors["fc5.bias"] = w, state["fc5.0.bias"]
    save_file({k: v.contiguous() for k, v in tensors.items()}, out)


if __name__ == "__main__":
    main(*map(pathlib.Path, sys.argv[1:4]))
