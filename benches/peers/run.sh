#!/bin/sh
# Builds what is missing (Python environment, release binary), then measures: `./run.sh --help`.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
venv="$here/.venv"
stamp="$venv/.complete"
if ! cmp -s "$here/requirements.txt" "$stamp"; then
    "${PYTHON:-python3}" -m venv "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check -r "$here/requirements.txt"
    cp "$here/requirements.txt" "$stamp"
fi
(cd "$here/../.." && cargo build --quiet --release --example peer_ours)
exec "$venv/bin/python" "$here/compare.py" "$@"
