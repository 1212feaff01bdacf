#!/bin/sh
# Builds what is missing (Python environments, release binary), then measures whole programs: `./whole.sh --help`.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
environment() {
    if ! cmp -s "$2" "$1/.complete"; then
        # `set -e` means nothing where the caller asks whether this succeeds.
        "${PYTHON:-python3}" -m venv "$1" &&
            "$1/bin/pip" install --quiet --disable-pip-version-check -r "$2" &&
            cp "$2" "$1/.complete"
    fi
}
environment "$here/.venv" "$here/requirements.txt"
environment "$here/.venv-mediapipe" "$here/requirements-mediapipe.txt" ||
    echo "SKIPPED: MediaPipe cannot be installed" >&2
(cd "$here/../.." && cargo build --quiet --release)
exec "$here/.venv/bin/python" "$here/whole_program.py" "$@"
