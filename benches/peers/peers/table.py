"""results.json goes in, Markdown tables come out: `python -m peers.table results.json`."""

import json
import sys

NAMES = {"ours": "**edgecap**", "openvino": "OpenVINO", "onnxruntime": "ONNX Runtime", "ncnn": "ncnn"}
NETWORKS = {"selecsls": "SelecSLS", "resnet50": "ResNet-50"}
UNDISTURBED = 0.9  # share of the cores asked for that an engine must have had


def render(r: dict) -> str:
    """Speed, then agreement, then what it was measured on."""
    parts = [_speed(r), _agreement(r), _conditions(r)]
    return "\n\n".join("\n".join(p) for p in parts if p) + "\n"


def _speed(r: dict) -> list[str]:
    columns = [(n, t) for n in r["networks"] for t in sorted({s["threads"] for s in n["speed"]})]
    if not columns:
        return []
    head = [f"{NETWORKS.get(n['network'], n['network'])}, {t} thread{'s' * (t > 1)}" for n, t in columns]
    lines = _head(["engine", "arithmetic", *head, "memory, MB"])
    rows = dict.fromkeys((s["engine"], s["precision"]) for n in r["networks"] for s in n["speed"])
    for engine, precision in sorted(rows, key=lambda k: (k[1] != "int8", k[1] != "f32", k[0] != "ours")):
        cells, memory, note = [], 0.0, ""
        for n, t in columns:
            s = _find(n["speed"], engine, precision, threads=t)
            memory, note = max(memory, s["peak_mb"] or 0), s["note"]
            times = f"{s['median_ms']:.1f} ms"
            cells.append(times if engine == "ours" else f"{times} ({1 / s['ours_over_theirs']:.2f}×)")
        if precision == "default":
            precision = f"{note.rsplit(' ', 1)[-1]} (its default)"
        lines.append(_row([NAMES[engine], precision, *cells, f"{memory:.0f}"]))
    return lines


def _agreement(r: dict) -> list[str]:
    rows = [(n, a) for n in r["networks"] for a in n["agreement"]]
    if not rows:
        return []
    lines = _head(["network", "engine", "arithmetic", "relative RMS error, 2D head", "3D head", "peaks moved, px, mean (95 %)", "peaks lost"])
    for n, a in rows:
        weights = "" if n["trained"] else " (random weights)"
        moved = f"{a['moved_mean_px']:.2f} ({a['moved_p95_px']:.2f})" if "moved_mean_px" in a else "–"
        lost = f"{a['peaks_lost']} of {a['peaks']}" if "peaks_lost" in a else "–"
        lines.append(_row([NETWORKS.get(n["network"], n["network"]) + weights, NAMES[a["engine"]], a["precision"], f"{a['relative_rms_2d']:.1e}", f"{a['relative_rms_3d']:.1e}", moved, lost]))
    return lines


def _conditions(r: dict) -> list[str]:
    m = r["machine"]
    speed = [s for n in r["networks"] for s in n["speed"]]
    versions = dict.fromkeys(f"{NAMES[s['engine']].strip('*')} {s['version']}" for n in r["networks"] for s in n["speed"])
    kernels = dict.fromkeys(s["note"] for n in r["networks"] for s in n["speed"] if s["engine"] == "ours")
    width, height = r["size"]
    gmac = ", ".join(f"{NETWORKS.get(n['network'], n['network'])} {n['gmac']:.2f} GMAC" for n in r["networks"])
    p = r["pictures"]
    lines = [
        f"Median of {r['rounds'] * r['runs']} runs in {r['rounds']} alternating turns, {width}×{height}, batch 1 ({gmac}); in brackets: how many times"
        " as long as ours in the same arithmetic (bf16 beside our f32). The peers get a ready float tensor, ours bytes.",
    ] if speed else []
    lines += [
        f"Calibration over {p['calibration']} {'photographs' if p['photographs'] else 'made pictures'}, each with its own tool's defaults; agreement over"
        f" {p['agreement']} others, against ONNX Runtime in f32. Memory: peak of the engine's process; the peers' holds Python too.",
        f"{m['cpu']} (family {m['family']}, model {m['model']}), {m['cores']} cores, {' '.join(m['isa'])}; governor {m['governor'] or 'not visible'};"
        f" {'; '.join([*kernels, *versions, r['made']])}.",
    ]
    if r["forced_isa"]:
        lines.append(f"Instruction set capped at {r['forced_isa']} for ours and OpenVINO.")
    return lines + _disturbed(m, speed)


def _disturbed(m: dict, speed: list[dict]) -> list[str]:
    """Whether other programs took processor time: of one thread the engine's own tells, of several the load before."""
    if not speed:
        return []
    alone = [s["cpu_ms"] / s["median_ms"] for s in speed if s["threads"] == 1]
    if alone:
        had, what = min(alone), f"one engine had only {100 * min(alone):.0f} % of a core"
    elif m.get("load") is not None:
        threads = max(s["threads"] for s in speed)
        had = (m["cores"] - m["load"]) / threads
        what = f"load {m['load']:.1f} before the start, {threads} threads on {m['cores']} cores"
    else:
        return ["Whether other programs were running is not known."]
    return [f"**Other programs were running** ({what}): no certificate."] if had < UNDISTURBED else []


def _find(speed: list[dict], engine: str, precision: str, threads: int) -> dict:
    return next(s for s in speed if (s["engine"], s["precision"], s["threads"]) == (engine, precision, threads))


def _row(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _head(names: list[str]) -> list[str]:
    return [_row(names), "|" + "---|" * len(names)]


if __name__ == "__main__":
    with open(sys.argv[1]) as f:
        print(render(json.load(f)), end="")
