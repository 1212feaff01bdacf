"""A worker process: `worker.py` for the peers, the `peer_ours` example for ours. See `worker.py` for what they say."""

import json
import os
import subprocess


class Worker:
    """One engine with one model and one number of threads; use in a `with`."""

    def __init__(self, command: list, environment: dict[str, str]):
        self.process = subprocess.Popen(
            [str(c) for c in command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, **environment},
        )
        try:
            self.ready = self._hear()["ready"]
        except Exception:
            self.__exit__()
            raise

    def run(self, count: int) -> dict:
        """Times `count` inferences."""
        return self._ask(run=count)

    def maps(self, pictures, to) -> None:
        """Writes the maps of pictures in a file of bytes to a file of floats."""
        self._ask(maps=str(pictures), to=str(to))

    def _ask(self, **what) -> dict:
        self.process.stdin.write(json.dumps(what) + "\n")
        self.process.stdin.flush()
        return self._hear()

    def _hear(self) -> dict:
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"worker ended without an answer: {' '.join(map(str, self.process.args))}; its own message is above")
        return json.loads(line)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.stdin.close()
        self.process.stdout.close()
        self.process.wait()
