"""A network in OpenVINO on one thread, in the arithmetic that it takes by itself; counts its processor time."""

import time
from pathlib import Path

import numpy as np
import openvino


class Network:
    """`shape` fixes the input's size."""

    def __init__(self, file: Path, shape: list[int] | None = None):
        core = openvino.Core()
        model = core.read_model(file)
        if shape:
            model.reshape(shape)
        self.compiled = core.compile_model(model, "CPU", {"INFERENCE_NUM_THREADS": 1, "NUM_STREAMS": 1})
        self.request = self.compiled.create_infer_request()
        self.cpu_s = 0.0

    def run(self, picture: np.ndarray) -> np.ndarray:
        """The first output; the next run overwrites it."""
        start = time.process_time()
        self.request.infer([picture], share_inputs=True)
        self.cpu_s += time.process_time() - start
        return self.request.get_output_tensor(0).data
