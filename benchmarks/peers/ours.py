"""The package: one whole call with its certificate and, on exact bodies, its bound; no extras, which no other has."""

from __future__ import annotations

import nlpgrasp as ng
from benchmarks.peers.answer import Answer, cpu_seconds, nothing
from benchmarks.peers.cases import Case

NAME = "nlpgrasp"


def answers(case: Case, starts: int, budget: float) -> list[Answer]:
    """Return the grasp of ``ng.solve``; ``budget`` is for others."""
    del budget
    solution = ng.solve(case.problem, starts=starts, options=ng.SolveOptions(workers=1))
    if solution.grasp is None:
        return [nothing(NAME)]
    return [Answer(NAME, solution.grasp.points, tuple(solution.faces), cpu_seconds())]
