"""Number of contacts that a task needs (Section 4)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import combinations

import numpy as np

from nlpgrasp.common.validation import integer, number
from nlpgrasp.contacts.cones.wider import placed_in
from nlpgrasp.errors import InputError
from nlpgrasp.optimize.options import SolveOptions, check_search
from nlpgrasp.optimize.start.result import StartGrasp
from nlpgrasp.optimize.start.warm_starts import WarmStart, best_allowed, with_more_contacts
from nlpgrasp.optimize.workbench.workbench import Workbench
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.studies.choices.curve import ContactCurve
from nlpgrasp.studies.choices.family import same_body, solve_family

SUBSETS = 256  # most subsets of contacts to keep


def how_many_contacts(
    problem_with: Callable[[int], GraspProblem],
    counts: Iterable[int],
    starts: int = 8,
    seed: int = 0,
    options: SolveOptions | None = None,
    *,
    possible: Mapping[int, float] | None = None,
) -> ContactCurve:
    """Solve a problem with different numbers of contacts, with each other's grasps as warm starts.

    An added contact can be left without force: where x is within the force budget, so is (x, 0), for the L2 norm, for
    each normal force, for each force, and for their sum. So mu can only rise with an added contact, and so do the
    certified bounds: each grasp with one more contact, if the constraints allow it, is a warm start for the next
    number, with the certified bound of the smaller one. In the other direction, each grasp less a contact is a warm
    start too. Beside its own starts, each number begins from the best of thousands of random placements, screened by
    ``ng.screen``. Under joint torques, and with a hand that has a pose, each number is solved alone. Every solution
    states a global bound, so that the curve shows the largest possible improvement for each number.

    Parameters
    ----------
    problem_with : callable
        Function of the number of contacts that returns the problem; the task is the same for all.
    counts : iterable of int
        Numbers of contacts to try.
    starts, seed, options
        As for ``solve``.
    possible : mapping of int to float, optional
        Proved upper bounds on mu by the number of contacts that are tighter than those the solutions state; such as
        ``ng.best_possible(problem_with(k)).upper`` of a longer search.

    Raises
    ------
    InputError
        Without counts, on problems with another number of contacts, different tasks, or invalid bounds.
    """
    if not callable(problem_with):
        raise InputError("problem_with", problem_with, "a function of the number of contacts")
    if not isinstance(counts, Iterable):
        raise InputError("counts", counts, "numbers of contacts")
    numbers = sorted({integer("counts", k, at_least=1) for k in counts})
    if not numbers:
        raise InputError("counts", "no numbers of contacts", "at least one")
    starts, seed, options = check_search(starts, seed, options)
    bounds = _possible(possible)
    problems = [problem_with(k) for k in numbers]
    for k, problem in zip(numbers, problems, strict=True):
        _check(k, problem, problems[0])
    pairs = [(i, i + 1) for i in range(len(problems) - 1)]
    found = dict(zip(numbers, solve_family(problems, pairs, OtherNumber(), starts, seed, options), strict=True))
    solutions = tuple((k, solution) for k, (solution, _) in found.items())
    return ContactCurve(solutions, {k: reached for k, (_, reached) in found.items()}, bounds)


def _check(k: int, problem: GraspProblem, first: GraspProblem) -> None:
    """Refuse a problem with another number of contacts than requested, or with another task."""
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


class OtherNumber:
    """Conversion between problems of one body with fewer and more contacts, without posed hands."""

    def up(self, found: StartGrasp, small: Workbench, large: Workbench) -> WarmStart | None:
        """Return the grasp with the best of some random added contacts that keep the constraints, if any."""
        if not self._suits(small, large):
            return None
        return with_more_contacts(large, found.found.grasp, found.found.placed.faces)

    def down(self, found: StartGrasp, large: Workbench, small: Workbench) -> WarmStart | None:
        """Return the grasp with the best subset of contacts that keeps the constraints, if any."""
        grasp, kept = found.found.grasp, _choices(large, small) if self._suits(small, large) else []
        if not kept:
            return None
        chosen = np.array(kept)
        faces = np.array(found.found.placed.faces, dtype=object)[chosen]
        placed = best_allowed(small, grasp.points[chosen], grasp.normals[chosen], faces)
        return None if placed is None else WarmStart(placed)

    def _suits(self, small: Workbench, large: Workbench) -> bool:
        follow = small.follows_contacts and large.follows_contacts
        return follow and same_body(small.problem.body, large.problem.body)


def _choices(large: Workbench, small: Workbench) -> list[Sequence[int]]:
    """Return the ordered subsets of the larger problem's contacts that may replace those of the smaller."""
    mine, theirs, space = small.problem.models, large.problem.models, small.problem.body.space
    found: list[Sequence[int]] = []
    for subset in combinations(range(len(theirs)), len(mine)):
        places = placed_in(mine, [theirs[j] for j in subset], space)
        if places is not None and len(found) < SUBSETS:
            found.append([subset[p] for p in places])
    return found
