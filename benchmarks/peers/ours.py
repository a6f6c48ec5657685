"""Grasps by ``ng.solve``: one whole call with certificate and, on exact bodies, a global bound."""

from __future__ import annotations

import nlpgrasp as ng
from benchmarks.peers.answer import Answer, cpu_seconds, no_answer
from benchmarks.peers.cases import Case

NAME = "nlpgrasp"


def answers(case: Case, starts: int, budget: float) -> list[Answer]:
    """Return the grasp of ``ng.solve``.

    ``budget`` is not used.
    """
    del budget
    solution = ng.solve(case.problem, starts=starts, options=ng.SolveOptions(workers=1))
    if solution.grasp is None:
        return [no_answer(NAME)]
    return [Answer(NAME, solution.grasp.points, tuple(solution.faces), cpu_seconds())]
