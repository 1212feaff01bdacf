"""A network and its folded weights go in, ncnn's `.param` and `.bin` come out (f32)."""

from collections import Counter
from pathlib import Path

import numpy as np

from .network import Network, Node


def write(net: Network, weights: dict, param: Path, binary: Path) -> None:
    """Writes both files; blobs of outputs carry the network's output names, the input is `input`."""
    names = {node: output for output, node in net.outputs.items()}
    layers: list[tuple[str, str, list[str], list[str], str]] = [("Input", "input", [], ["input"], "")]
    data = []
    for n in net.nodes:
        src = names.get(n.inputs[0], n.inputs[0])
        if len(n.inputs) > 1:
            layers.append(("Concat", f"{n.name}.concat", list(n.inputs), [f"{n.name}.concat"], "0=0"))
            src = f"{n.name}.concat"
        out = names.get(n.name, n.name)
        geometry = f"1={n.kernel} 11={n.kernel} 3={n.stride} 13={n.stride}"
        if n.kind == "maxpool":
            # Parameters of Pooling differ: 2 is the stride, 5=1 rounds sizes down as everyone else does.
            pads = " ".join(f"{i}={n.padding}" for i in (3, 13, 14, 15))
            layers.append(("Pooling", n.name, [src], [out], f"0=0 1={n.kernel} 2={n.stride} {pads} 5=1"))
            continue
        w, b = weights[n.name]
        activation = " 9=1" if n.relu and not n.residual else ""
        pads = " ".join(f"{i}={n.padding}" for i in (4, 14, 15, 16))
        group = f" 7={n.groups}" if n.groups > 1 else ""
        kind = ("Deconvolution" if n.kind == "deconv" else "Convolution") + ("DepthWise" if n.groups > 1 else "")
        conv_out = f"{n.name}.conv" if n.residual else out
        layers.append(
            (kind, n.name, [src], [conv_out], f"0={n.out} {geometry} {pads} 5=1 6={w.size}{group}{activation}")
        )
        data += [np.zeros(1, "<u4"), _order(n, w), b.astype("<f4")]  # the zero says: plain f32 weights follow
        if n.residual:
            layers.append(("BinaryOp", f"{n.name}.add", [conv_out, n.residual], [f"{n.name}.add"], "0=0"))
            layers.append(("ReLU", f"{n.name}.relu", [f"{n.name}.add"], [out], ""))
    layers = _split(layers)
    blobs = sum(len(l[3]) for l in layers)
    lines = ["7767517", f"{len(layers)} {blobs}"]
    lines += [" ".join([t, n, str(len(i)), str(len(o)), *i, *o, p]).strip() for t, n, i, o, p in layers]
    param.write_text("\n".join(lines) + "\n")
    with binary.open("wb") as f:
        for d in data:
            f.write(d.tobytes())


def _order(n: Node, w: np.ndarray) -> np.ndarray:
    """Transposed convolutions: per group, output-major, as ncnn wants."""
    if n.kind == "deconv":
        g = n.groups
        w = w.reshape(g, n.cin // g, n.out // g, -1).transpose(0, 2, 1, 3)
    return np.ascontiguousarray(w, "<f4").reshape(-1)


def _split(layers: list) -> list:
    """In ncnn a blob has one reader: copies are named for the others."""
    readers = Counter(i for l in layers for i in l[2])
    used: Counter = Counter()
    done = []
    for kind, name, inputs, outputs, params in layers:
        renamed = []
        for i in inputs:
            renamed.append(f"{i}.{used[i]}" if readers[i] > 1 else i)
            used[i] += 1
        done.append((kind, name, renamed, outputs, params))
        for o in outputs:
            if readers[o] > 1:
                copies = [f"{o}.{c}" for c in range(readers[o])]
                done.append(("Split", f"{o}.split", [o], copies, ""))
    return done
