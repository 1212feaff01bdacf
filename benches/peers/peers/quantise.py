"""An f32 ONNX file and calibration pictures go in, each peer's own int8 model comes out, made with its own tool's defaults."""

import logging
from pathlib import Path

import numpy as np


def openvino(source: Path, target: Path, pictures: np.ndarray) -> None:
    """NNCF post-training quantisation, defaults; writes OpenVINO IR."""
    import nncf
    import openvino as ov

    logging.getLogger("nncf").setLevel(logging.ERROR)
    dataset = nncf.Dataset([p[None] for p in pictures])
    model = nncf.quantize(ov.Core().read_model(source), dataset, subset_size=len(pictures))
    ov.save_model(model, target, compress_to_fp16=False)


def onnxruntime(source: Path, target: Path, pictures: np.ndarray, reduce_range: bool) -> None:
    """Static QDQ, u8 activations and i8 weights per channel; 7-bit weights where the CPU's int8 products would saturate."""
    import onnx
    from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static

    class Reader(CalibrationDataReader):
        def __init__(self):
            self.left = iter(pictures)

        def get_next(self):
            p = next(self.left, None)
            return None if p is None else {"input": p[None]}

    logging.getLogger().setLevel(logging.ERROR)
    # The CPU provider has no int8 transposed convolution, and the tool fails on grouped ones: they stay f32.
    transposed = [n.name for n in onnx.load(source).graph.node if n.op_type == "ConvTranspose"]
    quantize_static(
        source,
        target,
        Reader(),
        quant_format=QuantFormat.QDQ,
        activation_type=QuantType.QUInt8,
        weight_type=QuantType.QInt8,
        per_channel=True,
        reduce_range=reduce_range,
        nodes_to_exclude=transposed,
    )
