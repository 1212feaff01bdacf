"""A network file of `models/*.toml` goes in, a list of single operations comes out.

Written anew from the format's description, not from the engine's reader: agreement of outputs then checks both.
"""

import tomllib
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Node:
    """One operation; `inputs` are names of nodes whose channels are concatenated."""

    name: str
    kind: str  # conv, deconv or maxpool
    inputs: tuple[str, ...]
    cin: int
    out: int
    kernel: int
    stride: int
    padding: int
    groups: int = 1
    relu: bool = False
    weight: str = ""
    bias: str | None = None
    norm: str | None = None
    residual: str | None = None


@dataclass(frozen=True)
class Network:
    """Operations in order; `outputs` maps an output's name to its node."""

    name: str
    nodes: tuple[Node, ...]
    outputs: dict[str, str]
    channels: dict[str, int]

    def sizes(self, height: int, width: int) -> dict[str, tuple[int, int]]:
        """(height, width) of every node's output."""
        sizes = {"input": (height, width)}
        for n in self.nodes:
            sizes[n.name] = tuple(
                (x - 1) * n.stride + n.kernel - 2 * n.padding
                if n.kind == "deconv"
                else (x + 2 * n.padding - n.kernel) // n.stride + 1
                for x in sizes[n.inputs[0]]
            )
        return sizes

    def macs(self, height: int, width: int) -> int:
        """Multiply-accumulates of one run."""
        sizes, total = self.sizes(height, width), 0
        for n in self.nodes:
            if n.kind != "maxpool":
                h, w = sizes[n.inputs[0] if n.kind == "deconv" else n.name]
                total += h * w * n.kernel**2 * n.cin // n.groups * n.out
        return total


def load(path: Path) -> Network:
    """Reads a network file."""
    spec = tomllib.loads(path.read_text())
    b = _Builder(spec["input"]["channels"])
    for layer in spec["layers"]:
        b.layer(layer)
    outputs = {name: b.named[layer] for name, layer in spec["output"].items()}
    return Network(spec["name"], tuple(b.nodes), outputs, b.channels)


class _Builder:
    def __init__(self, channels: int):
        self.nodes: list[Node] = []
        self.channels = {"input": channels}
        self.named = {"input": "input"}
        self.last = "input"

    def conv(self, name, inputs, out, kernel, stride=1, groups=1, relu=True, kind="conv", **names) -> str:
        names = names or {"weight": f"{name}.0.weight", "norm": f"{name}.1"}
        padding = (kernel - stride) // 2 if kind == "deconv" else kernel // 2
        cin = sum(self.channels[i] for i in inputs)
        self.nodes.append(Node(name, kind, tuple(inputs), cin, out, kernel, stride, padding, groups, relu, **names))
        self.channels[name] = out
        return name

    def layer(self, l: dict) -> None:
        inputs = [self.named[n] for n in l["from"]] if "from" in l else [self.last]
        self.last = self.named[l["name"]] = getattr(self, "_" + l["kind"])(l, inputs)

    def _conv(self, l, inputs, kind="conv") -> str:
        n = l["name"]
        if not l.get("norm", True):
            names = {"weight": f"{n}.weight", "bias": f"{n}.bias"}
        elif "norm_name" in l:
            names = {"weight": f"{n}.weight", "norm": l["norm_name"]}
        else:
            names = {}
        return self.conv(
            n, inputs, l["out"], l["kernel"], l.get("stride", 1), l.get("groups", 1), l.get("relu", True), kind, **names
        )

    def _deconv(self, l, inputs) -> str:
        return self._conv(l, inputs, "deconv")

    def _maxpool(self, l, inputs) -> str:
        c = self.channels[inputs[0]]
        self.nodes.append(Node(l["name"], "maxpool", tuple(inputs), c, c, l["kernel"], l["stride"], l["kernel"] // 2))
        self.channels[l["name"]] = c
        return l["name"]

    def _selecsls(self, l, inputs) -> str:
        def groups(n: int) -> int:
            return next((g for above, g in reversed(l.get("groups", [])) if n > above), 1)

        skip = None
        for i, (_, cskip, k, out, stride) in enumerate(l["modules"]):
            m = f"{l['name']}.{i}"
            d1 = self.conv(f"{m}.conv1", inputs, k, 3, stride, groups(k))
            t = self.conv(f"{m}.conv2", [d1], k, 1)
            d2 = self.conv(f"{m}.conv3", [t], k // 2, 3, 1, groups(k // 2))
            t = self.conv(f"{m}.conv4", [d2], k, 1)
            d3 = self.conv(f"{m}.conv5", [t], k // 2, 3, 1, groups(k // 2))
            last = self.conv(f"{m}.conv6", [d1, d2, d3] + ([skip] if cskip else []), out, 1)
            if not cskip:
                skip = last
            inputs = [last]
        return inputs[0]

    def _bottlenecks(self, l, inputs) -> str:
        for i in range(l["blocks"]):
            b, x, stride = f"{l['name']}.{i}", inputs[0], l["stride"] if i == 0 else 1

            def part(j, src, out, kernel, s=1):
                names = {"weight": f"{b}.conv{j}.weight", "norm": f"{b}.bn{j}"}
                return self.conv(f"{b}.conv{j}", [src], out, kernel, s, **names)

            short = x
            if stride != 1 or self.channels[x] != l["out"]:
                short = self.conv(f"{b}.downsample", [x], l["out"], 1, stride, relu=False)
            t = part(1, x, l["width"], 1)
            t = part(2, t, l["width"], 3, stride)
            t = part(3, t, l["out"], 1)
            self.nodes[-1] = Node(**{**self.nodes[-1].__dict__, "residual": short})
            inputs = [t]
        return inputs[0]
