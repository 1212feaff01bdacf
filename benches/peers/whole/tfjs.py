"""A TensorFlow.js graph model goes in, a frozen TensorFlow graph that OpenVINO reads comes out."""

import base64
import copy
import json
import math
from pathlib import Path

import numpy as np
from google.protobuf import json_format
from tensorboard.compat.proto.graph_pb2 import GraphDef

# TensorFlow.js fuses these; what they are made of.
FUSED = {"_FusedConv2D": "Conv2D", "FusedDepthwiseConv2dNative": "DepthwiseConv2dNative"}
# Attributes that only the fused operations have.
OF_FUSED = ("fused_ops", "num_args", "epsilon", "leakyrelu_alpha", "TArgs", "num_host_args", "host_args")


def convert(model: Path, to: Path) -> None:
    """`model` is model.json beside its weights; `to` is written as .pb."""
    described = json.loads(model.read_text())
    graph = GraphDef()
    nodes = [part for node in described["modelTopology"]["node"] for part in _unfused(node)]
    json_format.ParseDict({"node": nodes}, graph, ignore_unknown_fields=True)
    values = _weights(model, described["weightsManifest"])
    for node in graph.node:
        if node.op == "Const" and node.name in values:
            value = values[node.name]
            tensor = node.attr["value"].tensor
            tensor.tensor_content = value.tobytes()
            tensor.dtype = node.attr["dtype"].type
            del tensor.tensor_shape.dim[:]
            for size in value.shape:
                tensor.tensor_shape.dim.add(size=size)
    to.write_bytes(graph.SerializeToString())


def _unfused(node: dict) -> list[dict]:
    """The convolution, then what was fused to it; the last has the name that others refer to."""
    if node["op"] not in FUSED:
        return [node]
    kind = node["attr"]["T"]
    after = [_text(s) for s in node["attr"]["fused_ops"]["list"]["s"]]
    conv = copy.deepcopy(node)
    conv.update(op=FUSED[node["op"]], input=node["input"][:2], name=f"{node['name']}/conv")
    for name in OF_FUSED:
        conv["attr"].pop(name, None)
    parts = [conv]
    for i, op in enumerate(after):
        inputs = [parts[-1]["name"]] + ([node["input"][2]] if op == "BiasAdd" else [])
        name = node["name"] if i + 1 == len(after) else f"{node['name']}/{op}"
        parts.append({"name": name, "op": op, "input": inputs, "attr": {"T": kind}})
    return parts


def _text(encoded: str) -> str:
    """Bytes in JSON are base64."""
    return base64.b64decode(encoded).decode()


def _weights(model: Path, manifest: list[dict]) -> dict[str, np.ndarray]:
    values = {}
    for group in manifest:
        raw, at = b"".join((model.parent / p).read_bytes() for p in group["paths"]), 0
        for w in group["weights"]:
            stored = np.dtype(w.get("quantization", w)["dtype"])
            count = math.prod(w["shape"])
            value = np.frombuffer(raw, stored, count, at).astype(w["dtype"]).reshape(w["shape"])
            at += count * stored.itemsize
            values[w["name"]] = value
    return values
