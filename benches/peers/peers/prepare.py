"""Weights and pictures go in, every engine's model files come out, made once and kept in a cache folder."""

import hashlib
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import ncnn_model, network, onnx_model, pictures, quantise, weights

SEED = 1


@dataclass(frozen=True)
class Job:
    """What to prepare one network from."""

    toml: Path
    weights: Path | None
    calibration: np.ndarray  # bytes, [n, height, width, 3]
    ours: Path  # the `peer_ours` binary
    requirements: Path
    reduce_range: bool
    cache: Path


@dataclass(frozen=True)
class Models:
    """Files of one network."""

    net: network.Network
    weights: Path
    trained: bool
    onnx: Path
    onnx_int8: Path
    openvino_int8: Path
    ncnn: Path
    ours_int8: Path


def prepare(job: Job, say) -> Models:
    """Makes whatever is not there yet; a change of anything that goes in makes it anew."""
    net = network.load(job.toml)
    _, height, width, _ = job.calibration.shape
    source = [job.toml.read_bytes(), job.weights.read_bytes() if job.weights else str(SEED).encode()]
    source += [job.requirements.read_bytes(), str((height, width)).encode(), _own_code()]
    folder = job.cache / f"{net.name}-{_digest(*source)}"
    int8 = folder / f"int8-{_digest(job.calibration.tobytes(), str(job.reduce_range).encode())}"
    ours = int8 / f"ours-{_digest(job.ours.read_bytes())}"
    ours.mkdir(parents=True, exist_ok=True)

    stored = job.weights or folder / "random.safetensors"
    if not job.weights:

        def random(to: Path) -> None:
            contract = subprocess.run([job.ours, "contract", net.name], check=True, capture_output=True, text=True)
            weights.random(net, SEED, contract.stdout.strip(), to)

        _once(stored, random)
    m = Models(
        net=net,
        weights=stored,
        trained=job.weights is not None,
        onnx=folder / "f32.onnx",
        onnx_int8=int8 / "onnxruntime.onnx",
        openvino_int8=int8 / "openvino.xml",
        ncnn=folder / "f32.param",
        ours_int8=ours / "model.ecm",
    )
    if not (m.onnx.exists() and m.ncnn.exists()):
        say(f"{net.name}: ONNX and ncnn files")
        folded = weights.folded(net, stored)
        _once(m.onnx, lambda to: onnx_model.write(net, folded, height, width, to))
        _once(m.ncnn, lambda to: ncnn_model.write(net, folded, to, m.ncnn.with_suffix(".bin")))
    planes = None
    makers = [
        (m.openvino_int8, "OpenVINO", lambda to: quantise.openvino(m.onnx, to, planes)),
        (m.onnx_int8, "ONNX Runtime", lambda to: quantise.onnxruntime(m.onnx, to, planes, job.reduce_range)),
        (m.ours_int8, "ours", lambda to: _quantise_ours(job, m, to)),
    ]
    for path, who, make in makers:
        if not path.exists():
            say(f"{net.name}: int8 for {who} over {len(job.calibration)} pictures")
            planes = pictures.planes(job.calibration) if planes is None else planes
            _once(path, make)
    return m


def _quantise_ours(job: Job, m: Models, to: Path) -> None:
    _, height, width, _ = job.calibration.shape
    raw = to.parent / "calibration.u8"
    job.calibration.tofile(raw)
    try:
        subprocess.run([job.ours, "quantise", m.weights, m.net.name, raw, str(height), str(width), to], check=True)
    finally:
        raw.unlink()


def _once(path: Path, make) -> None:
    """Runs `make` on a path that is taken only when it is whole; OpenVINO's `.bin` travels with its `.xml`."""
    if path.exists():
        return
    part = path.with_name(f"part-{path.name}")
    make(part)
    if part.suffix == ".xml":
        part.with_suffix(".bin").rename(path.with_suffix(".bin"))
    part.rename(path)


def _own_code() -> bytes:
    """The writers of the files: a change in them makes the files anew."""
    here = Path(__file__).parent
    names = ("network.py", "weights.py", "onnx_model.py", "ncnn_model.py", "quantise.py")
    return b"".join((here / n).read_bytes() for n in names)


def _digest(*parts: bytes) -> str:
    h = hashlib.blake2b(digest_size=8)
    for p in parts:
        h.update(len(p).to_bytes(8, "little") + p)
    return h.hexdigest()
