"""Training data in parts small enough to be carried to another machine, and back together there.

    python carry.py pack PARTS --everyday FOLDER --scenes FOLDER ... [--pack PACK] [--lent] [--parts 2] [--side 576] [--quality 60]
    python carry.py unpack PARTS OUT      # as many of the parts as are there

Photos are shrunk to `--side` and compressed once more, scenes compressed for the first time: a third of the bytes. Every part holds its share of
the photos, of every folder of scenes and of a pack's pictures to train on, with what teacher.py knows of these, so that training can begin on the
first one.
"""

from __future__ import annotations

import argparse
import pathlib
import shutil
import sys
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import cv2
import numpy as np

import depth
import terms
from pool import FIELDS, clear
from real import TAUGHT, TEACHER

PER_PHOTO = ("size", "weight", "stretched", "source")
PER_PERSON = ("joints", "state", "box")
PER_IMAGE = ("size", "set", "joints", "names")  # of a pack


def compressed(image: np.ndarray, quality: int) -> bytes:
    """BGR [h, w, 3] -> a WebP file."""
    return cv2.imencode(".webp", image, [cv2.IMWRITE_WEBP_QUALITY, quality])[1].tobytes()


def photos(folder: pathlib.Path, out: pathlib.Path, which: np.ndarray, side: int, quality: int) -> None:
    z = np.load(folder / "people.npz")
    files = np.memmap(folder / "pictures.bin", np.uint8, "r")
    offset, start, size = [0], [0], []
    joints, state, box = [], [], []
    rel3d, lifted = depth.read(folder, len(z["state"]))
    rows = np.concatenate([np.arange(z["start"][i], z["start"][i + 1]) for i in which])
    out.mkdir(parents=True)
    with open(out / "pictures.bin", "wb") as f:
        for i in which:
            image = cv2.imdecode(files[z["offset"][i] : z["offset"][i + 1]], cv2.IMREAD_COLOR)
            h, w = image.shape[:2]
            s = min(1.0, side / max(h, w))
            if s < 1:
                image = cv2.resize(image, (round(w * s), round(h * s)), interpolation=cv2.INTER_AREA)
            data = compressed(image, quality)
            f.write(data)
            offset.append(offset[-1] + len(data))
            scale = np.array([image.shape[1] / w, image.shape[0] / h], np.float32)
            own = slice(z["start"][i], z["start"][i + 1])
            size.append((image.shape[1], image.shape[0]))
            joints.append((z["joints"][own] + 0.5) * scale - 0.5)
            box.append(z["box"][own] * np.tile(scale, 2))
            state.append(z["state"][own])
            start.append(start[-1] + len(state[-1]))
    rest = {k: z[k][which] for k in PER_PHOTO if k != "size"}
    people = dict(joints=np.concatenate(joints).astype(np.float32), state=np.concatenate(state), box=np.concatenate(box).astype(np.float32))
    np.savez_compressed(out / "people.npz", offset=np.array(offset), start=np.array(start), size=np.array(size, np.int32), sources=z["sources"], **rest, **people)
    if (folder / depth.FILE).exists():
        depth.write(out, rel3d[rows], lifted[rows])
    said([folder], out)


def said(folders: list[pathlib.Path], out: pathlib.Path) -> None:
    """What is open altogether stays so, and nothing else: `out` may have held other data."""
    if all(map(terms.is_open, folders)):
        terms.mark(out, {k: v for f in folders for k, v in terms.ingredients(f).items()})
    else:
        terms.unmark(out)


def scenes(folder: pathlib.Path, out: pathlib.Path, part: int, parts: int, quality: int) -> None:
    which = np.arange(part, int((folder / "filled").read_text()), parts)
    data = {k: np.load(folder / f"{k}.npy", mmap_mode="r") for k in FIELDS}
    files = [compressed(np.ascontiguousarray(data["image"][i].transpose(1, 2, 0)[..., ::-1]), quality) for i in which]
    out.mkdir(parents=True)
    (out / "pictures.bin").write_bytes(b"".join(files))
    rest = {k: data[k][which] for k in FIELDS if k != "image"}
    np.savez_compressed(out / "truth.npz", offset=np.cumsum([0, *map(len, files)]), **rest)
    said([folder], out)


def images(pack: pathlib.Path, out: pathlib.Path, part: int, parts: int, quality: int) -> None:
    """Pictures of pack.py to train on, and their rows of teacher.npz."""
    z = np.load(pack / "images.npz")
    raw, names = np.memmap(pack / "images.bin", np.uint8, "r"), z["set_names"]
    which = np.concatenate([np.nonzero(z["set"] == k)[0][part::parts] for k, name in enumerate(names) if not name.endswith("test")])
    files = [compressed(cv2.imdecode(raw[z["offset"][i] : z["offset"][i + 1]], cv2.IMREAD_COLOR), quality) for i in which]
    out.mkdir(parents=True)
    (out / "images.bin").write_bytes(b"".join(files))
    rest = {k: z[k][which] for k in PER_IMAGE}
    np.savez_compressed(out / "images.npz", offset=np.cumsum([0, *map(len, files)]), set_names=names, **rest)
    if (pack / TEACHER).exists():
        told, ends = np.load(pack / TEACHER), np.cumsum(taught(z))
        if len(told["ok"]) != ends[-1]:
            raise SystemExit(f"expected {ends[-1]} rows in {pack / TEACHER}, found {len(told['ok'])}: run teacher.py on this pack again")
        rows = np.concatenate([of_set[part::parts] for of_set in np.split(np.arange(ends[-1]), ends[:-1])])
        np.savez_compressed(out / TEACHER, **{k: told[k][rows] for k in told})


def taught(z: Mapping[str, np.ndarray]) -> list[int]:
    """How many pictures of an images.npz are of each set that teacher.npz has rows of, which hold one set after the other."""
    sets = z["set_names"][z["set"]]
    return [int((sets == name).sum()) for name in TAUGHT]


def unpack_images(parts: list[pathlib.Path], out: pathlib.Path) -> None:
    out.mkdir(parents=True, exist_ok=True)
    z = [np.load(p / "images.npz") for p in parts]
    (out / "images.bin").write_bytes(b"".join((p / "images.bin").read_bytes() for p in parts))
    offset = np.cumsum([0, *np.concatenate([np.diff(p["offset"]) for p in z])]).astype(np.int64)
    np.savez(out / "images.npz", offset=offset, set_names=z[0]["set_names"], **{k: np.concatenate([p[k] for p in z]) for k in PER_IMAGE})
    (out / TEACHER).unlink(missing_ok=True)
    if all((p / TEACHER).exists() for p in parts):
        told = [dict(np.load(p / TEACHER)) for p in parts]
        # first all parts' rows of one set, then of the next
        cut = [np.cumsum(taught(p))[:-1] for p in z]
        joined = {k: [np.split(t[k], c) for t, c in zip(told, cut)] for k in told[0]}
        np.savez_compressed(out / TEACHER, **{k: np.concatenate([part[s] for s in range(len(TAUGHT)) for part in v]) for k, v in joined.items()})


def pictures(folder: pathlib.Path, offset: np.ndarray) -> list[np.ndarray]:
    """uint8 [3, h, w] RGB of each."""
    raw = np.memmap(folder / "pictures.bin", np.uint8, "r")
    with ThreadPoolExecutor() as threads:
        return list(threads.map(lambda a, b: cv2.imdecode(raw[a:b], cv2.IMREAD_COLOR)[..., ::-1].transpose(2, 0, 1), offset, offset[1:]))


def unpack_photos(parts: list[pathlib.Path], out: pathlib.Path) -> None:
    out.mkdir(parents=True, exist_ok=True)
    z = [np.load(p / "people.npz") for p in parts]
    # What lay here describes other pictures.
    for name in ("people.npz", depth.FILE):
        (out / name).unlink(missing_ok=True)
    terms.unmark(out)
    with open(out / "pictures.bin", "wb") as f:
        for p in parts:
            f.write((p / "pictures.bin").read_bytes())

    def ends(key: str) -> np.ndarray:
        return np.cumsum([0, *np.concatenate([np.diff(p[key]) for p in z])]).astype(np.int64)

    rest = {k: np.concatenate([p[k] for p in z]) for k in (*PER_PHOTO, *PER_PERSON)}
    np.savez(out / "people.npz", offset=ends("offset"), start=ends("start"), sources=z[0]["sources"], **rest)
    if any((p / depth.FILE).exists() for p in parts):
        depth.write(out, *map(np.concatenate, zip(*(depth.read(p, len(t["state"])) for p, t in zip(parts, z)))))
    said(parts, out)


def unpack_scenes(parts: list[pathlib.Path], out: pathlib.Path) -> None:
    z = [np.load(p / "truth.npz") for p in parts]
    images = np.stack([i for p, t in zip(parts, z) for i in pictures(p, t["offset"])])
    clear(out)
    for k in FIELDS:
        np.save(out / f"{k}.npy", images if k == "image" else np.concatenate([t[k] for t in z]))
    (out / "filled").write_text(str(len(images)))
    said(parts, out)


def main(argv: list[str]) -> None:
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    sub = ap.add_subparsers(dest="what", required=True)
    p = sub.add_parser("pack")
    p.add_argument("parts_folder", type=pathlib.Path)
    p.add_argument("--everyday", type=pathlib.Path, required=True)
    p.add_argument("--scenes", type=pathlib.Path, nargs="+", required=True)
    p.add_argument("--pack", type=pathlib.Path, help="folder of pack.py")
    p.add_argument("--parts", type=int, default=2)
    p.add_argument("--lent", action="store_true", help="photos in which somebody lends depth alone, for train.py --head3d")
    p.add_argument("--side", type=int, default=576)
    p.add_argument("--quality", type=int, default=60)
    u = sub.add_parser("unpack")
    u.add_argument("parts_folder", type=pathlib.Path)
    u.add_argument("out", type=pathlib.Path)
    a = ap.parse_args(argv)
    if a.what == "unpack":
        parts = sorted(a.parts_folder.glob("part*"))
        if not parts:
            raise SystemExit(f"expected folders part0, part1, ... in {a.parts_folder}, found none: run carry.py pack")
        unpack_photos([p / "everyday" for p in parts], a.out / "everyday")
        if (parts[0] / "pack").exists():
            unpack_images([p / "pack" for p in parts], a.out / "pack")
        names = sorted(d.name for d in (parts[0] / "scenes").iterdir())
        # a folder a process: what is decoded is copied by one thread alone, and a GPU waits for all of them
        with ProcessPoolExecutor() as processes:
            done = [processes.submit(unpack_scenes, [p / "scenes" / name for p in parts], a.out / "scenes" / name) for name in names]
            for each in done:
                each.result()
        return
    z = np.load(a.everyday / "people.npz")
    carried = np.arange(len(z["size"]))
    if a.lent:
        lifted = depth.read(a.everyday, len(z["state"]))[1]
        carried = np.unique(np.repeat(carried, np.diff(z["start"]))[lifted])
    for part in range(a.parts):
        out = a.parts_folder / f"part{part}"
        shutil.rmtree(out, ignore_errors=True)
        photos(a.everyday, out / "everyday", carried[part :: a.parts], a.side, a.quality)
        if a.pack:
            images(a.pack, out / "pack", part, a.parts, a.quality)
        for folder in a.scenes:
            scenes(folder, out / "scenes" / folder.name, part, a.parts, a.quality)
        print(f"{out}: {sum(f.stat().st_size for f in out.rglob('*') if f.is_file()) / 2**20:.1f} MiB")


if __name__ == "__main__":
    main(sys.argv[1:])
