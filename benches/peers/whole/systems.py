"""What takes part: how each is started on a folder of photos or a film, what it needs, and on which terms it is had."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent.parent
OURS = HERE.parent.parent / "target/release/edgecap"
MEDIAPIPE = HERE / ".venv-mediapipe"
APACHE = "Apache-2.0"
# Whatever an engine might start helpers with.
ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}


@dataclass(frozen=True)
class Run:
    """What one process did."""

    cpu_s: float
    networks_s: float | None
    version: str


@dataclass(frozen=True)
class System:
    """One row of the table; `options` and `environment` are ours, `program` is what `program.py` calls a peer."""

    name: str
    licence: str
    options: tuple[str, ...] = ()
    environment: tuple[tuple[str, str], ...] = ()
    program: str = ""
    files: tuple[str, ...] = ()

    def lacks(self, models: Path) -> str:
        """What keeps it from running here, or nothing."""
        if not self.program:
            return "" if OURS.exists() else f"{OURS} is not built"
        # `whole.sh` leaves this where everything was installed.
        if self.program.startswith("mediapipe") and not (MEDIAPIPE / ".complete").exists():
            return f"MediaPipe is not installed in {MEDIAPIPE}"
        absent = [f for f in self.files if not (models / f).exists()]
        return f"{', '.join(absent)} not in {models}" if absent else ""

    def run(self, models: Path, source: Path, out: Path) -> Run:
        """One process from start to end, its children's processor time included."""
        if self.program:
            python = MEDIAPIPE / "bin/python" if self.program.startswith("mediapipe") else sys.executable
            command = [python, HERE / "program.py", self.program, models, source, out]
        else:
            command = [OURS, "infer", "--input", source, "--jsonl", out, "--threads", "1"]
            command += self.options
        environment = {**os.environ, **ONE_THREAD, **dict(self.environment)}
        process = subprocess.Popen(
            list(map(str, command)),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env=environment,
        )
        assert process.stdout is not None
        said = process.stdout.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise RuntimeError(f"{self.name} failed; run it by hand to see why: {' '.join(map(str, command))}")
        cpu_s = used.ru_utime + used.ru_stime
        if not self.program:
            return Run(cpu_s, None, _our_version())
        told = json.loads(said.splitlines()[-1])
        return Run(cpu_s, told["networks_s"], told["version"])


def _our_version() -> str:
    said = subprocess.run([OURS, "--version"], capture_output=True, text=True, check=True).stdout
    return said.split()[1]


MOVENET = ("movenet-multipose.json", "movenet-multipose.bin")
CHAIN = ("yolox_nano.onnx", "tinypose_256x192.onnx")
OUR_LICENCE = "MIT or Apache-2.0; weights academic"
QUALITIES = ("fast", "balanced", "best")
PEERS = [
    System("MoveNet MultiPose Lightning, 256, up to 6", APACHE, program="movenet", files=MOVENET),
    System("YOLOX-nano 416 + PP-TinyPose", APACHE, program="yolox-416", files=CHAIN),
    System("YOLOX-nano 640 + PP-TinyPose", APACHE, program="yolox-640", files=CHAIN),
    System("MediaPipe Pose full, one person", APACHE, program="mediapipe-one"),
    System("MediaPipe Pose full, up to 6", APACHE, program="mediapipe-many"),
]


def ours(inputs: list[str]) -> list[System]:
    """Rows of ours: 'default', a quality, `N-looks` a second, or `WxH` (then for upright photos, too).

    '/direct' or '/portable' after it names the algorithms."""
    rows = []
    for text in inputs:
        kind, _, algorithms = text.partition("/")
        name = f"edgecap {kind.replace('x', '×')}{f', {algorithms}' if algorithms else ''}"
        environment = (("EDGECAP_ALGORITHM", algorithms),) if algorithms else ()
        rows.append(System(name, OUR_LICENCE, options=options_of(kind), environment=environment))
    return rows


def options_of(kind: str) -> tuple[str, ...]:
    """What a row of ours is asked for, without its algorithms."""
    if kind == "default":
        return ()
    if kind.endswith("-looks"):
        return ("--looks", kind.removesuffix("-looks"))
    return ("--quality" if kind in QUALITIES else "--size", kind)
