"""Facts about this machine that decide what a figure means."""

import os
from pathlib import Path

FLAGS = ("avx2", "avx_vnni", "avx512bw", "avx512_vnni", "avx512_bf16", "amx_int8", "asimd", "asimddp", "i8mm")


def facts() -> dict:
    """CPU, cores, instruction sets, governor, load of the last minute: processes that wanted a core, the mean."""
    cpuinfo = Path("/proc/cpuinfo").read_text()
    fields: dict[str, str] = {}
    for line in cpuinfo.splitlines():
        key, _, value = line.partition(":")
        fields.setdefault(key.strip(), value.strip())
    have = set((fields.get("flags") or fields.get("Features") or "").split())
    governor = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
    return {
        "cpu": fields.get("model name") or fields.get("Model") or fields.get("CPU part", "unknown"),
        "family": fields.get("cpu family"),
        "model": fields.get("model"),
        "cores": len(os.sched_getaffinity(0)),
        "isa": [f for f in FLAGS if f in have],
        "governor": governor.read_text().strip() if governor.exists() else None,
        "load": os.getloadavg()[0],
    }
