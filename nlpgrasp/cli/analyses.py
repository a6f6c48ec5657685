"""Analyses that ``nlpgrasp solve`` adds to a grasp, each shown and written as it completes."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import typer

import nlpgrasp as ng
from nlpgrasp.cli.progress import emit
from nlpgrasp.errors import InputError

if TYPE_CHECKING:
    from nlpgrasp.hands.base import Hand


def asked_analyses(words: str | None, quick: bool, hand: Hand | None) -> tuple[str, ...]:
    """Return the names behind ``--with``: those of all analyses where it is left out, none with ``--quick``.

    Raises
    ------
    InputError
        On a name that is no analysis, on phases of no hand, and on both options.
    """
    if quick and words is not None:
        raise InputError("--quick", f"--with {words} beside it", "one of the two")
    from nlpgrasp.analysis.analyse import all_analyses, check_hand
    from nlpgrasp.optimize.options import check_analyses

    if words is None:
        return () if quick else all_analyses(hand)
    names = check_analyses("--with", [name.strip() for name in words.split(",")])
    check_hand("--with", names, hand)
    return names


def add_analyses(solution: ng.GraspSolution, names: tuple[str, ...], file: Path, as_json: bool) -> ng.GraspSolution:
    """Return a solution with analyses, each told as it comes; the file holds them too.

    Parameters
    ----------
    solution : GraspSolution
        As ``file`` holds it.
    names : tuple of str
    file : Path
    as_json : bool
        Tell one JSON object a line.
    """
    from nlpgrasp.analysis.analyse import one_by_one

    begun, known = time.monotonic(), str(solution).splitlines()
    analysed = solution
    for name, analysed in one_by_one(solution, names, solution.known_problem):
        if as_json:
            emit({"event": "analysis", "name": name, "seconds": time.monotonic() - begun})
        else:
            lines = str(analysed).splitlines()
            typer.echo("".join(f"{line}\n" for line in lines if line not in known), nl=False)
            known = lines
        begun = time.monotonic()
    if names:
        analysed.save(file)
    return analysed
