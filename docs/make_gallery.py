"""Solve every script of ``problems/`` and write ``gallery.md`` with its picture, certified value and run time.

Run by ``make gallery``, from the checkout's root; needs Debian's chromium (``make browser``).
"""

from __future__ import annotations

import ast
import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from make_picture import photographed

import nlpgrasp as ng
from nlpgrasp.report import write_report

DOCS = Path(__file__).resolve().parent
PROBLEMS = DOCS.parent / "problems"
WIDTH, HEIGHT = 960, 540
HEAD = """# Gallery

Every script of `problems/`, solved as it is (8 starts, seed 0) by `make gallery` on {cores} cores ({machine}, Python
{python}); seconds are wall time of `nlpgrasp solve`, with the start of the interpreter. The interval is certified for
the grasp in the picture, which is the best of the starts: a local optimum. Blue discs are contacts, blue balls
fingertips, orange arrows the finger forces for the task's hardest wrench; below each picture stands what that takes.
"""


def solved(script: Path, folder: Path) -> tuple[ng.GraspSolution, float]:
    """Return what a script's problem is solved to, and the seconds it took."""
    out = folder / f"{script.stem}.json"
    begun = time.perf_counter()
    command = [sys.executable, "-m", "nlpgrasp", "solve", str(script), "--out", str(out), "--json"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)  # noqa: S603
    return ng.GraspSolution.load(out), time.perf_counter() - begun


def caption(solution: ng.GraspSolution) -> str:
    """Return what the task takes, in newtons."""
    if solution.needed is None:
        return ""
    total, most = solution.needed.total, solution.needed.size.max()
    return f"*The task's hardest wrench takes {total:.3g} N of finger force, {most:.3g} N of it at one finger.*"


def entry(script: Path, solution: ng.GraspSolution, seconds: float, folder: Path) -> str:
    """Return a script's part of the page, and write its picture."""
    picture = DOCS / "pictures" / "gallery" / f"{script.stem}.png"
    photographed(write_report({script.stem: solution}, folder / "page.html"), picture, WIDTH, HEIGHT)
    text = (ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or "").strip().splitlines()
    label = "mu-tilde" if solution.kind == "mu_tilde" else "mu"
    contacts = len(solution.grasp) if solution.grasp is not None else 0
    return "\n".join(
        [
            f"## {script.stem.replace('_', ' ').capitalize()}",
            "",
            *text,
            "",
            f"`problems/{script.name}`: {contacts} contacts, {label} certified in **{solution.mu}**, {seconds:.0f} s.",
            "",
            f"![{solution.name}: the grasp found](pictures/gallery/{picture.name})",
            "",
            caption(solution),
            "",
        ]
    )


def main() -> None:
    """Write the page."""
    head = HEAD.format(cores=os.cpu_count(), machine=platform.machine(), python=platform.python_version())
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        parts = [entry(script, *solved(script, place), place) for script in sorted(PROBLEMS.glob("*.py"))]
    (DOCS / "gallery.md").write_text("\n".join([head, *parts]), encoding="utf-8")


if __name__ == "__main__":
    main()
