"""Run of one method on one body: ``python -m benchmarks.peers.call METHOD BODY STARTS BUDGET``."""

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


def missing_package(method: str) -> str | None:
    """Return the name of a package that a method needs and that is not installed, or ``None``."""
    return METHODS[method] if METHODS[method] and find_spec(METHODS[method]) is None else None


def run_method(method: str, case: Case, starts: int, budget: float) -> list[Answer]:
    """Run one method on one body in a new process, and return its answers.

    Raises
    ------
    RuntimeError
        With the last line it wrote, when it fails.
    """
    arguments = [sys.executable, "-m", "benchmarks.peers.call", method, case.name, str(starts), repr(budget)]
    cold = {**os.environ, "NLPGRASP_CACHE": "off", "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    completed = subprocess.run(arguments, capture_output=True, text=True, cwd=ROOT, env=cold, check=False)
    if completed.returncode:
        raise RuntimeError(f"{method} on {case.name}: {(completed.stderr.strip().splitlines() or ['no word'])[-1]}")
    data = json.loads(completed.stdout.splitlines()[-1])
    return [Answer(a["method"], np.reshape(a["points"], (-1, 3)), tuple(a["faces"]), a["seconds"]) for a in data]


def main(method: str, body: str, starts: int, budget: float) -> None:
    """Run one method on one body, and print its answers as JSON."""
    results: list[Answer] = import_module(f"benchmarks.peers.{method}").answers(CASES[body], starts, budget)
    data = [{"method": a.method, "points": a.points.tolist(), "faces": a.faces, "seconds": a.seconds} for a in results]
    print(json.dumps(data))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]), float(sys.argv[4]))
