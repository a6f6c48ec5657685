"""Every method on every body, one cold process after another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks.peers.call import METHODS, called, missing
from benchmarks.peers.cases import CASES
from benchmarks.peers.judge import judged
from benchmarks.peers.results import append, begin

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
    """Write the file of results.

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
    begin(path)
    for method in methods:
        if missing(method):
            say(f"{method}: left out, no {missing(method)} here")
    for body in bodies:
        case, allowed = CASES[body], budget
        say(f"{body}: {case.source}, {case.fingers} fingers")
        for method in methods:
            if missing(method):
                continue
            try:
                found = called(method, case, starts, 1.0 if allowed is None else allowed)
            except RuntimeError as error:
                say(f"  {error}")
                continue
            for answer in found:
                row = judged(case, answer)
                append(path, case, row)
                say(f"  {row.method:20} mu {row.mu:.4f}  epsilon {row.epsilon:.4f}  {row.seconds:6.1f} s  {row.note}")
            if method == "ours" and allowed is None:
                allowed = found[0].seconds
