"""Weights of a network: PyTorch names in safetensors, or random ones; batch norm folded for those who need it."""

import json
from pathlib import Path

import numpy as np
from safetensors import safe_open
from safetensors.numpy import save_file

from .network import Network, Node


def random(net: Network, seed: int, contract: str, path: Path) -> None:
    """Writes random weights whose activations stay in range, with batch norms that have something to fold."""
    rng = np.random.default_rng(seed)
    t = {}
    for n in net.nodes:
        if n.kind == "maxpool":
            continue
        shape = _stored(n)
        fan_in = n.cin // n.groups * n.kernel**2 / (n.stride**2 if n.kind == "deconv" else 1)
        t[n.weight] = rng.normal(0, np.sqrt(2 / fan_in), shape)
        if n.bias:
            t[n.bias] = rng.uniform(-0.1, 0.1, n.out)
        if n.norm:
            # Sums of a residual chain would double at every block.
            gain = 0.4 if n.residual else 1.0
            t[f"{n.norm}.weight"] = gain * rng.uniform(0.8, 1.2, n.out)
            t[f"{n.norm}.bias"] = rng.uniform(-0.1, 0.1, n.out)
            t[f"{n.norm}.running_mean"] = rng.uniform(-0.1, 0.1, n.out)
            t[f"{n.norm}.running_var"] = rng.uniform(0.8, 1.25, n.out)
    save_file({k: v.astype(np.float32) for k, v in t.items()}, path, metadata={"contract": contract})


def folded(net: Network, path: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """(weight, bias) of every convolution, batch norm folded; weights keep PyTorch's order of axes."""
    with safe_open(path, "numpy") as f:
        eps = json.loads(f.metadata()["contract"])["batchnorm_eps"]
        get = lambda name: f.get_tensor(name).astype(np.float64)
        return {n.name: _fold(n, get, eps) for n in net.nodes if n.kind != "maxpool"}


def _stored(n: Node) -> tuple[int, ...]:
    if n.kind == "deconv":
        return (n.cin, n.out // n.groups, n.kernel, n.kernel)
    return (n.out, n.cin // n.groups, n.kernel, n.kernel)


def _fold(n: Node, get, eps: float) -> tuple[np.ndarray, np.ndarray]:
    w = get(n.weight)
    if w.shape != _stored(n):
        raise SystemExit(f"tensor {n.weight}: expected shape {_stored(n)}, found {w.shape}; are these weights for this network?")
    b = get(n.bias) if n.bias else np.zeros(n.out)
    if n.norm:
        a = get(f"{n.norm}.weight") / np.sqrt(get(f"{n.norm}.running_var") + eps)
        b = get(f"{n.norm}.bias") + (b - get(f"{n.norm}.running_mean")) * a
        if n.kind == "deconv":
            # Axis 0 holds inputs group by group, axis 1 the outputs of that group.
            g, gi, go = n.groups, n.cin // n.groups, n.out // n.groups
            w = (w.reshape(g, gi, go, -1) * a.reshape(g, 1, go, 1)).reshape(w.shape)
        else:
            w = w * a.reshape(-1, 1, 1, 1)
    return w.astype(np.float32), b.astype(np.float32)
