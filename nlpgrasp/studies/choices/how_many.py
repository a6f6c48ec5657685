"""How many contacts a task needs (Section 4)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from nlpgrasp.common.validation import integer, number
from nlpgrasp.errors import InputError
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.studies.choices.curve import ContactCurve
from nlpgrasp.studies.choices.family import solve_family
from nlpgrasp.studies.choices.more_contacts import OtherNumber


def how_many_contacts(
    problem_with: Callable[[int], GraspProblem],
    counts: Iterable[int],
    starts: int = 8,
    seed: int = 0,
    options: SolveOptions | None = None,
    *,
    possible: Mapping[int, float] | None = None,
) -> ContactCurve:
    """Solve a problem with different numbers of contacts, each with the grasps of the others.

    An added contact can be left without force: where x is within the force budget, so is (x, 0), of the L2 norm, of
    each normal force, of each force, and of their sum. So mu can only rise with a contact that is added anywhere, and
    so does what is certified here: each grasp with one more contact, where the constraints have room for it, is a start
    for the next number, with the certified bound of the smaller one. Downwards each grasp less a contact is one too.
    Beside its own starts each number begins from the best of thousands of random placements, screened by ``ng.screen``.
    Under joint torques, and with a hand that has a pose of its own, each number is solved by itself. Every solution
    states a bound over all placements, so that the curve says of each number how much better it could be at most.

    Parameters
    ----------
    problem_with : callable
        The problem with a number of contacts; the task is the same for all.
    counts : iterable of int
        Numbers of contacts to try.
    starts, seed, options
        As of ``solve``.
    possible : mapping of int to float, optional
        Proved upper bounds on mu by the number of contacts that are tighter than those the solutions state; such as
        ``ng.best_possible(problem_with(k)).upper`` of a longer search.

    Raises
    ------
    InputError
        On no counts, problems with another number of contacts, tasks that differ, or bounds that are no numbers.
    """
    if not callable(problem_with):
        raise InputError("problem_with", problem_with, "a function of the number of contacts")
    if not isinstance(counts, Iterable):
        raise InputError("counts", counts, "numbers of contacts")
    numbers = sorted({integer("counts", k, at_least=1) for k in counts})
    if not numbers:
        raise InputError("counts", "no numbers of contacts", "at least one")
    starts, seed = integer("starts", starts, at_least=1), integer("seed", seed, at_least=0)
    options = SolveOptions() if options is None else options
    if not isinstance(options, SolveOptions):
        raise InputError("options", options, "a SolveOptions")
    bounds = _possible(possible)
    problems = [problem_with(k) for k in numbers]
    for k, problem in zip(numbers, problems, strict=True):
        _check(k, problem, problems[0])
    pairs = [(i, i + 1) for i in range(len(problems) - 1)]
    found = dict(zip(numbers, solve_family(problems, pairs, OtherNumber(), starts, seed, options), strict=True))
    solutions = tuple((k, solution) for k, (solution, _) in found.items())
    return ContactCurve(solutions, {k: reached for k, (_, reached) in found.items()}, bounds)


def _check(k: int, problem: GraspProblem, first: GraspProblem) -> None:
    """Refuse a problem with another number of contacts than asked for, or with another task."""
    if not isinstance(problem, GraspProblem) or len(problem.models) != k:
        raise InputError("problem_with", problem, f"a GraspProblem with {k} contacts")
    same = np.array_equal(problem.origin, first.origin) and problem.budget == first.budget
    if not same or problem.task.to_dict() != first.task.to_dict():
        raise InputError(
            "problem_with", f"another task, torque origin or budget with {k} contacts", "the same task for all"
        )


def _possible(given: Mapping[int, float] | None) -> dict[int, float]:
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise InputError("possible", given, "bounds by the number of contacts")
    return {
        integer("possible", k, at_least=1): number(f"possible[{k}]", bound, at_least=0.0) for k, bound in given.items()
    }
