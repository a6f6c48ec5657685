"""Run of the study: every method on every body, each in a new process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks.peers.call import METHODS, missing_package, run_method
from benchmarks.peers.cases import CASES
from benchmarks.peers.judge import evaluate
from benchmarks.peers.results import append, write_header

STARTS = 2


def run(
    path: Path,
    bodies: Sequence[str] = tuple(CASES),
    methods: Sequence[str] = tuple(METHODS),
    *,
    starts: int = STARTS,
    budget: float | None = None,
    say: Callable[[str], None] = print,
) -> None:
    """Run methods on bodies, and write the results file.

    Parameters
    ----------
    path : Path
    bodies, methods : sequence of str
        Names of ``CASES`` and ``METHODS``, ours first: its CPU time is the random search's budget.
    starts : int
        Of every method that has starts.
    budget : float, optional
        Seconds of CPU time of the random search; those of our call when left out.
    say : callable
        Takes a line for each result.
    """
    write_header(path)
    for method in methods:
        if missing_package(method):
            say(f"{method}: left out, no {missing_package(method)} here")
    for body in bodies:
        case, allowed = CASES[body], budget
        say(f"{body}: {case.source}, {case.fingers} fingers")
        for method in methods:
            if missing_package(method):
                continue
            try:
                answers = run_method(method, case, starts, 1.0 if allowed is None else allowed)
            except RuntimeError as error:
                say(f"  {error}")
                continue
            for answer in answers:
                row = evaluate(case, answer)
                append(path, case, row)
                say(f"  {row.method:20} mu {row.mu:.4f}  epsilon {row.epsilon:.4f}  {row.seconds:6.1f} s  {row.note}")
            if method == "ours" and allowed is None:
                allowed = answers[0].seconds
