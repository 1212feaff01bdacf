"""A PyTorch checkpoint and the contract of its weights -> safetensors for `edgecap model import`.

    edgecap model contract --arch selecsls60 > contract.json      # then fill in what is yours to tell
    python convert.py CHECKPOINT.pth contract.json OUT.safetensors
"""

from __future__ import annotations

import json
import pathlib
import sys

import torch

import weights


def state_dict(path: pathlib.Path) -> dict[str, torch.Tensor]:
    """The tensors of a checkpoint by name, whatever its trainer wrapped them in."""
    saved = torch.load(path, map_location="cpu", weights_only=True)  # never runs what a pickle may hold
    for key in ("state_dict_ema", "state_dict", "model_state_dict", "model"):
        saved = saved[key] if isinstance(saved, dict) and isinstance(saved.get(key), dict) else saved
    if not isinstance(saved, dict):
        return {}
    tensors = {k: v for k, v in saved.items() if isinstance(v, torch.Tensor) and v.is_floating_point()}
    while tensors and all(k.startswith(("module.", "_orig_mod.", "model.")) for k in tensors):
        tensors = {k.split(".", 1)[1]: v for k, v in tensors.items()}
    return tensors


def main(checkpoint: pathlib.Path, contract: pathlib.Path, out: pathlib.Path) -> None:
    about = json.loads(contract.read_text())
    if not (tensors := state_dict(checkpoint)):
        raise SystemExit(f"{checkpoint}: expected a state dict, found no tensors by name; save model.state_dict() with torch.save")
    weights.write(out, {k: v.float() for k, v in tensors.items()}, {"format": "pt", "contract": json.dumps(about)})
    # Stage II's contract names what comes out of it; those weights are checked beside Stage I's.
    check = f"STAGE1 --stage2 {out} --check" if "output" in about else f"{out} --arch ARCH --check (ARCH as in 'model contract --arch')"
    print(f"{out} {out.stat().st_size / 2**20:.1f} MiB, {len(tensors)} tensors: edgecap model import {check}")


if __name__ == "__main__":
    if len(sys.argv) != 4:
        raise SystemExit(__doc__)
    main(*map(pathlib.Path, sys.argv[1:]))
