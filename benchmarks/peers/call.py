"""One method on one body in a process of its own: ``python -m benchmarks.peers.call METHOD BODY STARTS BUDGET``."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from benchmarks.peers.answer import Answer
from benchmarks.peers.cases import CASES, Case

ROOT = Path(__file__).resolve().parents[2]
METHODS = {
    "ours": "",
    "by_slsqp": "",
    "with_drake": "pydrake",
    "random_search": "",
    "antipodal": "",
}
"""Module of each method, and the package that it needs beside the package's own dependencies."""


def missing(method: str) -> str | None:
    """Return the package that a method needs and that is not there."""
    return METHODS[method] if METHODS[method] and find_spec(METHODS[method]) is None else None


def called(method: str, case: Case, starts: int, budget: float) -> list[Answer]:
    """Return the answers of a cold process that runs one method on one body.

    Raises
    ------
    RuntimeError
        With the last line it wrote, when it fails.
    """
    words = [sys.executable, "-m", "benchmarks.peers.call", method, case.name, str(starts), repr(budget)]
    cold = {**os.environ, "NLPGRASP_CACHE": "off", "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(words, capture_output=True, text=True, cwd=ROOT, env=cold, check=False)
    if done.returncode:
        raise RuntimeError(f"{method} on {case.name}: {(done.stderr.strip().splitlines() or ['no word'])[-1]}")
    said = json.loads(done.stdout.splitlines()[-1])
    return [Answer(a["method"], np.reshape(a["points"], (-1, 3)), tuple(a["faces"]), a["seconds"]) for a in said]


def main(method: str, body: str, starts: int, budget: float) -> None:
    """Write the answers of one method as JSON."""
    found: list[Answer] = import_module(f"benchmarks.peers.{method}").answers(CASES[body], starts, budget)
    said = [{"method": a.method, "points": a.points.tolist(), "faces": a.faces, "seconds": a.seconds} for a in found]
    print(json.dumps(said))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]), float(sys.argv[4]))
