"""One class per peer: a model file and a thread count go in; `run()` does one inference of the picture set by `feed()`."""

from pathlib import Path

import numpy as np


class OpenVino:
    """OpenVINO's CPU plugin, latency mode, one stream. `precision` f32 forbids bf16, all others leave to it what is not
    rounded."""

    def __init__(self, model: Path, threads: int, precision: str):
        import openvino as ov

        core = ov.Core()
        config = {"INFERENCE_NUM_THREADS": threads, "NUM_STREAMS": 1, "PERFORMANCE_HINT": "LATENCY"}
        if precision == "f32":
            config["INFERENCE_PRECISION_HINT"] = "f32"
        compiled = core.compile_model(model, "CPU", config)
        self.request = compiled.create_infer_request()
        self.outputs = [compiled.output(n) for n in ("head2d", "head3d")]
        self.version = ov.__version__.split("-")[0]
        self.note = f"inference precision {compiled.get_property('INFERENCE_PRECISION_HINT').to_string()}"

    def feed(self, picture: np.ndarray) -> None:
        import openvino as ov

        self.picture = np.ascontiguousarray(picture[None])
        self.request.set_input_tensor(ov.Tensor(self.picture, shared_memory=True))

    def run(self) -> None:
        self.request.infer()

    def maps(self) -> list[np.ndarray]:
        return [self.request.get_tensor(o).data[0].copy() for o in self.outputs]


class OnnxRuntime:
    """ONNX Runtime's CPU provider, sequential, all graph optimisations."""

    def __init__(self, model: Path, threads: int, precision: str):
        import onnxruntime as ort

        o = ort.SessionOptions()
        o.intra_op_num_threads, o.inter_op_num_threads = threads, 1
        o.log_severity_level = 3
        self.session = ort.InferenceSession(str(model), o, providers=["CPUExecutionProvider"])
        self.version, self.note = ort.__version__, ""

    def feed(self, picture: np.ndarray) -> None:
        self.input = {"input": np.ascontiguousarray(picture[None])}

    def run(self) -> None:
        self.out = self.session.run(["head2d", "head3d"], self.input)

    def maps(self) -> list[np.ndarray]:
        return [o[0] for o in self.out]


class Ncnn:
    """ncnn on the CPU, its defaults, no 16-bit storage."""

    def __init__(self, model: Path, threads: int, precision: str):
        import ncnn

        self.ncnn = ncnn
        self.net = ncnn.Net()
        opt = self.net.opt
        opt.num_threads = threads
        opt.use_bf16_storage = opt.use_fp16_storage = opt.use_fp16_packed = opt.use_fp16_arithmetic = False
        if self.net.load_param(str(model)) or self.net.load_model(str(model.with_suffix(".bin"))):
            raise SystemExit(f"ncnn does not load {model}")
        self.version, self.note = ncnn.__version__, ""

    def feed(self, picture: np.ndarray) -> None:
        self.picture = np.ascontiguousarray(picture)
        self.mat = self.ncnn.Mat(self.picture)

    def run(self) -> None:
        with self.net.create_extractor() as ex:
            ex.input("input", self.mat)
            self.out = [ex.extract("head2d")[1], ex.extract("head3d")[1]]

    def maps(self) -> list[np.ndarray]:
        return [np.array(o) for o in self.out]


ENGINES = {"openvino": OpenVino, "onnxruntime": OnnxRuntime, "ncnn": Ncnn}
