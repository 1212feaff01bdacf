"""What packed data is made of, and under which terms: a folder whose every ingredient may be used commercially says so in `open.json`.

`train.py --open` takes nothing else, so that nobody spoils an open model by mistake. Who packs decides: a packer marks a folder only
where it knows the terms of all that went in, and takes the mark away where it packs anything else.
"""

from __future__ import annotations

import json
import pathlib

FILE = "open.json"
# `trained_on` of exported open weights begins with this.
OPEN = "Open data only: "
DEPTH = {"depth of people by BlazePose": "Apache-2.0"}
RENDERED = {"scenes of `edgecap synth`": "procedural, this project's own"}
BODY = {"MakeHuman's base mesh, targets, rig": "CC0"}
MOCAP = {
    "CMU Graphics Lab Motion Capture Database": "free for all uses but resale of the motion itself",
    "DeepMimic's clips": "MIT",
}


def mark(folder: pathlib.Path, ingredients: dict[str, str]) -> None:
    """Say that all in `folder` is open: every ingredient with its terms."""
    (folder / FILE).write_text(json.dumps(ingredients, indent=1) + "\n")


def unmark(folder: pathlib.Path) -> None:
    (folder / FILE).unlink(missing_ok=True)


def ingredients(folder: pathlib.Path) -> dict[str, str]:
    """What an open folder is made of. One that is not marked ends the program."""
    path = folder / FILE
    if not path.exists():
        raise SystemExit(f"expected data marked as open, found no {FILE} in {folder}: pack it again with --open, or train without --open")
    return json.loads(path.read_text())


def is_open(folder: pathlib.Path) -> bool:
    return (folder / FILE).exists()


def require_open_weights(path: pathlib.Path) -> None:
    """Weights to start from or to learn from must be open themselves. Others end the program."""
    import weights  # needs PyTorch, which packers do without

    said = ""
    if path.suffix == ".safetensors":
        contract = weights.read(path)[1].get("contract")
        said = json.loads(contract).get("trained_on", "") if contract else ""
    if not said.startswith(OPEN):
        raise SystemExit(f"expected weights trained on open data, found {path}, trained on {said or 'who knows what'}: start from none")
