"""Averaged weights -> OUT/stage1.safetensors and OUT/stage2.safetensors, with the contract in their metadata.

    python export.py OUT [--pack PACK] [--f32] [--only stage1|stage2] [--no-encodings]

Matrices are written as fp16 unless --f32 is given (half the size, under 16 MiB); vectors (batch norm, biases) stay fp32.  Given a pack,
the greatest activations after every ReLU are measured for the int8 engine.  The runtime refuses keys it does not know: a new key in
the contract needs a new reader first.
"""

from __future__ import annotations

import argparse
import json
import pathlib
import sys

import torch
from torch import Tensor, nn

import evaluate
import quant
import terms
import weights
from letterbox import letterbox
from model import MODULES, SelecSLSNet, Stage2, channel_mask
from real import decode_all, load_photos, load_set
from skeleton import BONES_AT, CANONICAL_STATURE_M, JOINTS14, JOINTS21, LIMBS, PARENTS21, STRIDE, VIEW_ALIGNED

TRAINED_ON = (
    "Leeds Sports Pose (train) and LSP-Extended, INRIA negatives, synthetic people (CC0 MakeHuman assets, `edgecap synth`) "
    "posed by CMU and DeepMimic motion; photos of everyday life in which teachers labelled everybody (model card); where the pack holds a teacher's answers, depth, missing and mended joints of real photos by BlazePose"
)

TRAINED_ON_STAGE2 = (
    "motion of CMU and DeepMimic, and where the pack holds it of Human3.6M (research) and Bandai Namco Research (CC BY-NC 4.0), on MakeHuman's body "
    "(CC0); poses of `edgecap synth`; where mistakes of Stage I were given, what it says of Leeds Sports Pose and of scenes of `edgecap synth`"
)
OPEN_STAGE1 = (
    terms.OPEN + "photos of Open Images (CC BY 2.0), OpenStax's books (CC BY 4.0), public sites (CC0, CC BY) and free-exercise-db (public domain), "
    "named in attribution.txt, labelled by YOLOX, PP-TinyPose and MoveNet, with depth by BlazePose where depth.npz lay beside them (all "
    "Apache-2.0), scenes of `edgecap synth`; from random weights (train.py --open)"
)
OPEN_STAGE2 = (
    terms.OPEN + "CMU and DeepMimic motion on MakeHuman's body (CC0), poses of `edgecap synth`, where mistakes were given what open weights say of "
    "its scenes; from random weights (stage2.py --open)"
)


def slim(sd: dict[str, Tensor], f32: bool) -> dict[str, Tensor]:
    return {
        k: (v.half() if v.ndim > 1 and not f32 else v.float())
        for k, v in sd.items()
        if v.is_floating_point() and not k.endswith(".amax")
    }


def contract(step: int, images: int, quantised: bool, trained_on: str = TRAINED_ON) -> dict[str, object]:
    """What both stages say."""
    frame = "x right, y down, z forward, metres, relative to the pelvis, person rescaled to canonical_stature_m"
    if VIEW_ALIGNED:
        frame += "; view-aligned: turn by the least rotation that takes +z to the viewing ray through the neck to get camera axes"
    return dict(
        step=step,
        images=images,
        quantised=quantised,
        joints=JOINTS14,
        joints3d=JOINTS21,
        parents3d=PARENTS21,
        canonical_stature_m=CANONICAL_STATURE_M,
        frame3d=frame,
        trained_on=trained_on,
    )


@torch.no_grad()
def activation_max(net: SelecSLSNet, pack: pathlib.Path, count: int = 24) -> dict[str, float]:
    """Mean over pictures of the greatest activation of every ReLU: single outliers do not move it.  Training photos only."""
    seen: dict[str, list[float]] = {}

    def hook(name: str):  # noqa: ANN202
        def note(_m: nn.Module, _i: object, y: Tensor) -> None:
            seen.setdefault(name, []).append(float(y.amax()))

        return note

    handles = [m.register_forward_hook(hook(n)) for n, m in net.named_modules() if isinstance(m, nn.ReLU)]
    frames = [letterbox(im)[0] for im in decode_all(load_set(pack, "lsp_train", count).files)]
    frames += [letterbox(im.permute(1, 2, 0).numpy())[0] for im in load_photos(pack, torch.device("cpu"), count // 3)]
    for x in frames:
        net(evaluate.as_input(x))
    for h in handles:
        h.remove()
    return {k: sum(v) / len(v) for k, v in seen.items()}


def export_stage1(net: SelecSLSNet, meta: dict, path: pathlib.Path, pack: pathlib.Path | None, f32: bool, encodings: bool) -> None:
    is_open = meta.get("open", False)
    if is_open and pack is not None:
        raise SystemExit("expected no --pack for an open model: its ranges would be of LSP's photos; calibrate with `edgecap model import --calibrate`")
    info = contract(meta["step"], meta["images"], meta["quant"], OPEN_STAGE1 if is_open else TRAINED_ON) | dict(
        input=dict(layout="NCHW", colour="RGB", formula="x/255-0.5", size_multiple=16, reference_size=[512, 320]),
        stride=STRIDE,
        cell_centre="px = 8*c + 3.5 (pixel centres are integers)",
        limbs=LIMBS,
        modules=MODULES,
        groups3x3="2 if out > 96, 4 if out > 192 (core)",
        batchnorm_eps=1e-5,
        outputs=dict(
            head2d="0..13 heatmaps (peak 1), then 13 x (dx, dy): unit vector child -> parent",
            head3d="21 x (x, y, z): joint minus its parent, read at the joints in bones_at",
        ),
        bones_at=BONES_AT,
        encodings_trained=encodings,
    )
    if meta["quant"]:
        info |= dict(activation_max=quant.ranges(net), activation_bits=7)
    elif pack is not None:
        info |= dict(activation_max=activation_max(net, pack), activation_bits=7)
    weights.write(path, slim(net.state_dict(), f32), {"format": "pt", "contract": json.dumps(info)})
    print(f"{path.name} {path.stat().st_size / 2**20:.2f} MiB, {sum(v.numel() for v in net.parameters())} parameters")


def export_stage2(s2: Stage2, saved: dict, path: pathlib.Path, f32: bool) -> None:
    sd = {k: v.clone() for k, v in s2.state_dict().items()}
    # Channels without supervision carry noise: their columns are set to zero, so raw 63-vectors may be fed at run time.
    sd["fc1.0.weight"].view(len(sd["fc1.0.weight"]), len(JOINTS14), -1)[..., 3:] *= channel_mask()
    info = contract(saved["step"], saved.get("people", 0), False, OPEN_STAGE2 if saved.get("open") else TRAINED_ON_STAGE2) | dict(
        input="14 x (u, v, confidence, 63 encodings), joint after joint; all zero where a joint is not seen. "
        "(u, v): pixels relative to the neck, divided by the RMS distance of the seen joints from it",
        output="21 x (x, y, z) metres",
        batchnorm_eps=1e-5,
        report=saved["report"],
    )
    weights.write(path, slim(sd, f32), {"format": "pt", "contract": json.dumps(info)})
    print(f"{path.name} {path.stat().st_size / 2**20:.2f} MiB")


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("out", type=pathlib.Path)
    ap.add_argument("--pack", type=pathlib.Path, help="measure activation ranges on its training photos")
    ap.add_argument("--f32", action="store_true")
    ap.add_argument("--only", choices=["stage1", "stage2"])
    ap.add_argument("--no-encodings", action="store_true", help="say that the 3D head was not trained")
    a = ap.parse_args(argv)
    cpu = torch.device("cpu")
    if a.only != "stage2":
        net, _, meta = evaluate.load(a.out, cpu)
        export_stage1(net, meta, a.out / "stage1.safetensors", a.pack, a.f32, not a.no_encodings)
    if a.only != "stage1" and (a.out / "stage2.pt").exists():
        saved = torch.load(a.out / "stage2.pt", map_location=cpu, weights_only=True)
        s2 = Stage2()
        s2.load_state_dict(saved["net"])
        export_stage2(s2.eval(), saved, a.out / "stage2.safetensors", a.f32)


if __name__ == "__main__":
    main(sys.argv[1:])
