"""A network and its folded weights go in, an ONNX file comes out: f32, NCHW, batch 1, picture already x/255 - 0.5."""

from pathlib import Path

import onnx
from onnx import TensorProto, helper, numpy_helper

from .network import Network

OPSET = 17


def write(net: Network, weights: dict, height: int, width: int, path: Path) -> None:
    """Writes the model; outputs carry the network's output names."""
    nodes, init = [], []
    names = {node: output for output, node in net.outputs.items()}
    value = lambda n: names.get(n, n)
    for n in net.nodes:
        src = value(n.inputs[0])
        if len(n.inputs) > 1:
            src = f"{n.name}.concat"
            nodes.append(helper.make_node("Concat", [value(i) for i in n.inputs], [src], name=src, axis=1))
        shape = {"kernel_shape": [n.kernel] * 2, "strides": [n.stride] * 2, "pads": [n.padding] * 4}
        if n.kind == "maxpool":
            nodes.append(helper.make_node("MaxPool", [src], [value(n.name)], name=n.name, **shape))
            continue
        w, b = weights[n.name]
        init += [numpy_helper.from_array(w, f"{n.name}.w"), numpy_helper.from_array(b, f"{n.name}.b")]
        steps = ["conv"] + ["add"] * (n.residual is not None) + ["relu"] * n.relu
        outs = [f"{n.name}.{s}" for s in steps[:-1]] + [value(n.name)]
        op = "ConvTranspose" if n.kind == "deconv" else "Conv"
        nodes.append(
            helper.make_node(op, [src, f"{n.name}.w", f"{n.name}.b"], [outs[0]], name=n.name, group=n.groups, **shape)
        )
        for step, a, b in zip(steps[1:], outs, outs[1:]):
            args = [a, value(n.residual)] if step == "add" else [a]
            nodes.append(helper.make_node({"add": "Add", "relu": "Relu"}[step], args, [b], name=b + "." + step))
    sizes = net.sizes(height, width)
    info = lambda name, shape: helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)
    graph = helper.make_graph(
        nodes,
        net.name,
        [info("input", [1, net.channels["input"], height, width])],
        [info(o, [1, net.channels[n], *sizes[n]]) for o, n in net.outputs.items()],
        init,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=8)
    onnx.checker.check_model(model, full_check=True)
    onnx.save(model, path)
