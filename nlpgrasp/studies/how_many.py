"""How many contacts a task needs (Section 4)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import integer, number
from nlpgrasp.errors import InputError
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.solve import solve


@dataclass(frozen=True)
class ContactCurve:
    """The certified quality against the number of contacts.

    Parameters
    ----------
    solutions : tuple of (int, GraspSolution)
        By number of contacts, increasing.
    """

    solutions: tuple[tuple[int, GraspSolution], ...]

    def fewest(self, force: float) -> int | None:
        """Return the least number of contacts whose force resists the whole task, or None where none does.

        Parameters
        ----------
        force : float
            In units of the force budget: the grasp found with so many contacts has ``1 / mu.lower`` at most this.
        """
        limit = number("force", force, above=0.0)
        return next((k for k, found in self.solutions if found.mu.lower * limit >= 1.0), None)

    def best(self, penalty: float) -> int:
        """Return the number of contacts with the largest ``mu - penalty * contacts``, mu at its lower bound."""
        cost = number("penalty", penalty, at_least=0.0)
        return max(self.solutions, key=lambda pair: (pair[1].mu.lower - cost * pair[0], -pair[0]))[0]

    def __str__(self) -> str:
        lines = []
        for k, found in self.solutions:
            bounds = f"{found.label} in {found.mu}" if found.success else found.status.name.lower()
            lines.append(f"{k:3d} contacts: {bounds}")
        return "\n".join(lines)


def how_many_contacts(
    problem_with: Callable[[int], GraspProblem],
    counts: Iterable[int],
    starts: int = 8,
    seed: int = 0,
    options: SolveOptions | None = None,
) -> ContactCurve:
    """Solve a problem with different numbers of contacts.

    Parameters
    ----------
    problem_with : callable
        The problem with a number of contacts; the task is the same for all.
    counts : iterable of int
    starts, seed, options
        As of ``solve``.

    Raises
    ------
    InputError
        On no counts, problems with another number of contacts, or tasks that differ.
    """
    if not callable(problem_with):
        raise InputError("problem_with", problem_with, "a function of the number of contacts")
    if not isinstance(counts, Iterable):
        raise InputError("counts", counts, "numbers of contacts")
    numbers = sorted({integer("counts", k, at_least=1) for k in counts})
    if not numbers:
        raise InputError("counts", "no numbers of contacts", "at least one")
    problems = [problem_with(k) for k in numbers]
    for k, problem in zip(numbers, problems, strict=True):
        if not isinstance(problem, GraspProblem) or len(problem.models) != k:
            raise InputError("problem_with", problem, f"a GraspProblem with {k} contacts")
        same = np.array_equal(problem.origin, problems[0].origin) and problem.budget == problems[0].budget
        if not same or problem.task.to_dict() != problems[0].task.to_dict():
            raise InputError(
                "problem_with", f"another task, torque origin or budget with {k} contacts", "the same task for all"
            )
    return ContactCurve(tuple((k, solve(p, starts, seed, options)) for k, p in zip(numbers, problems, strict=True)))
