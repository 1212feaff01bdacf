"""Who made the Open Images photos that an open model learnt from: python attribution.py attribution.txt CSV [CSV ...] AUTHORS.tsv.

`attribution.txt` is what `everyday.py --open` wrote; the CSV files are Open Images' own lists of images with author, title and licence
(`train-images-boxable-with-rotation.csv` and its like, or `image_ids_and_rotation.csv` of all of them). AUTHORS.tsv gets a line a photo:
id, title, author, licence, page. Photos that no list names, or names under another licence than CC BY, are printed, and the program ends
with 1: leave them out (`everyday.py --without FILE` takes their ids, one a line) and train again.
"""

from __future__ import annotations

import csv
import pathlib
import sys

FREE = "creativecommons.org/licenses/by/"
COLUMNS = ("ImageID", "Title", "Author", "License", "OriginalLandingURL")


def authors(wanted: set[str], lists: list[pathlib.Path]) -> dict[str, list[str]]:
    """Id -> the columns above, of the photos that the lists name."""
    found = {}
    for path in lists:
        with open(path, newline="", encoding="utf-8") as f:
            rows = csv.DictReader(f)
            missing = [c for c in COLUMNS if c not in (rows.fieldnames or [])]
            if missing:
                raise SystemExit(f"expected a list of Open Images with {', '.join(COLUMNS)}, found none of {', '.join(missing)} in {path}")
            found |= {r["ImageID"]: [" ".join(r[c].split()) for c in COLUMNS] for r in rows if r["ImageID"] in wanted}
    return found


def main(argv: list[str]) -> int:
    if len(argv) < 3:
        raise SystemExit(__doc__)
    used, *lists, out = map(pathlib.Path, argv)
    wanted = {name for source, name in (line.partition("\t")[0].split(maxsplit=1) for line in used.read_text(encoding="utf-8").splitlines()) if source == "openimages"}
    found = authors(wanted, lists)
    out.write_text("".join("\t".join(found[k]) + "\n" for k in sorted(found)), encoding="utf-8")
    doubtful = sorted(wanted - set(found)) + sorted(k for k, row in found.items() if FREE not in row[3])
    print(f"{len(found)} of {len(wanted)} photos named, {len(doubtful)} in no list or under another licence", *doubtful, sep="\n")
    return 1 if doubtful else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
