"""Choice of the number of contacts for a task (Section 4): quality against number of contacts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import TypeAlias

import numpy as np

from nlpgrasp.common.formatting import format_headroom, format_upper
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import integer, number
from nlpgrasp.contacts import ContactModel, contact_from_dict
from nlpgrasp.contacts.cone_inclusion import assign_contacts
from nlpgrasp.errors import InputError
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.options import SolveOptions, check_solve_arguments
from nlpgrasp.optimize.start_result import StartGrasp
from nlpgrasp.optimize.warm_starts import WarmStart, best_feasible, complete_contacts
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.studies.nested_problems import is_same_body, solve_family
from nlpgrasp.studies.purposes import (
    PurposeComparison,
    best_by_weights,
    check_purposes,
    compare_purposes,
    require_comparison,
)

SUBSETS = 256  # most subsets of contacts to keep


Penalty: TypeAlias = float | Sequence[float] | Mapping[str, float] | Callable[[tuple[ContactModel, ...], float], float]
"""What contacts cost, in units of mu: each the same; of the first, second, ... contact; by the contact's kind; or any
function of the contact models and mu."""


def how_many_contacts(
    problem_with: Callable[[int], GraspProblem],
    counts: Iterable[int],
    starts: int = 8,
    seed: int = 0,
    options: SolveOptions | None = None,
    *,
    possible: Mapping[int, float] | None = None,
    weights: Mapping[str, float] | None = None,
) -> ContactCurve:
    """Solve a problem with different numbers of contacts, and return the quality for each number.

    The grasps of each problem are warm starts for the others.

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
    weights : mapping of str to float, optional
        Weights, at least 0, of the purposes by which the grasps are compared: ``"mu"``, ``"sensitivity"``,
        ``"manipulability"``, ``"fragility"``, ``"contacts"`` and ``"force"``, as
        ``nlpgrasp.studies.PurposeComparison`` defines them.
        The curve then has ``purposes``, ``front`` and ``best_weighted``. Each number's grasp is the one with the
        largest mu: weights choose among the numbers, not among the placements of one number.

    Raises
    ------
    InputError
        Without counts, on problems with another number of contacts, different tasks, or invalid bounds; on unknown
        purposes, weights below 0, not finite or all 0, manipulability with a hand without joints, and fragility under a
        budget that depends on the posture.
    """
    if not callable(problem_with):
        raise InputError("problem_with", problem_with, "a function of the number of contacts")
    if not isinstance(counts, Iterable):
        raise InputError("counts", counts, "numbers of contacts")
    contact_counts = sorted({integer("counts", k, at_least=1) for k in counts})
    if not contact_counts:
        raise InputError("counts", "no numbers of contacts", "at least one")
    starts, seed, options = check_solve_arguments(starts, seed, options)
    bounds = _check_bounds(possible)
    problems = [problem_with(k) for k in contact_counts]
    for k, problem in zip(contact_counts, problems, strict=True):
        _check_problem(k, problem, problems[0])
    checked_weights = check_purposes(weights, problems)
    successive = [(i, i + 1) for i in range(len(problems) - 1)]  # exchange warm starts
    family = solve_family(problems, successive, NumberConversion(), starts, seed, options)
    solutions = tuple((k, solution) for k, (solution, _) in zip(contact_counts, family, strict=True))
    starts_near_best = {k: near_best for k, (_, near_best) in zip(contact_counts, family, strict=True)}
    purposes = compare_purposes(
        [f"{k} contacts" for k in contact_counts],
        [solution for _, solution in solutions],
        problems,
        contact_counts,
        checked_weights,
        options.robust_offset,
    )
    return ContactCurve(solutions, starts_near_best, bounds, purposes)


@dataclass(frozen=True)
class ContactCurve:
    """Certified quality against number of contacts.

    Parameters
    ----------
    solutions : tuple of (int, GraspSolution)
        By number of contacts, increasing.
    reached : mapping of int to int
        Number of starts within 2 % of the grasp, by number of contacts, warm starts from other numbers included: with
        1, a better grasp may well have been missed.
    possible : mapping of int to float
        Proved upper bounds on mu by number of contacts, beside those that the solutions state.
    purposes : PurposeComparison or None
        Comparison of the solutions, in their order, by the purposes with weights; ``None`` without weights.
    """

    solutions: tuple[tuple[int, GraspSolution], ...]
    reached: Mapping[int, int] = field(default_factory=dict)
    possible: Mapping[int, float] = field(default_factory=dict)
    purposes: PurposeComparison | None = None

    @property
    def best_known(self) -> dict[int, float]:
        """Largest certified lower bound on mu with at most k contacts, by k.

        An added contact can be left without force, so at least this is possible with more contacts, if the constraints
        allow them.
        """
        bounds = np.maximum.accumulate([solution.mu.lower for _, solution in self.solutions])
        return {k: float(bound) for (k, _), bound in zip(self.solutions, bounds, strict=True)}

    @property
    def shortfall(self) -> dict[int, float]:
        """Fraction by which each grasp's lower bound on mu is below ``best_known``, by number of contacts."""
        best_known = self.best_known
        return {
            k: 1.0 - solution.mu.lower / best_known[k] if best_known[k] > 0.0 else 0.0 for k, solution in self.solutions
        }

    @property
    def best_possible(self) -> dict[int, float]:
        """Proved upper bound on mu with k contacts, by k; inf without a bound."""
        return {k: min(solution.best_possible, self.possible.get(k, np.inf)) for k, solution in self.solutions}

    def gap(self, contacts: int) -> float:
        """Return the relative optimality gap of the grasp with a number of contacts; inf without a bound.

        Raises
        ------
        InputError
            On a number of contacts that was not solved.
        """
        solution = self._at(contacts)
        bound = self.best_possible[contacts]
        return max(0.0, float(bound / solution.mu.lower - 1.0)) if solution.mu.lower > 0.0 else np.inf

    def fewest(self, force: float) -> int | None:
        """Return the least number of contacts whose grasp exerts the whole task within a force limit, or ``None``.

        Parameters
        ----------
        force : float
            In units of the force budget: the grasp with so many contacts has ``1 / mu.lower`` at most this.
        """
        held = zip(self.solutions, self._hold_with(force), strict=True)
        return next((k for (k, _), is_enough in held if is_enough), None)

    def fewest_possible(self, force: float) -> int | None:
        """Return the least number of contacts whose upper bound on mu admits the task within a force limit, or None.

        The smaller numbers are proved insufficient. If it equals ``fewest(force)``, that answer is proved optimal among
        the numbers solved.

        Parameters
        ----------
        force : float
            In units of the force budget.
        """
        limit = number("force", force, above=0.0)
        upper_bounds = self.best_possible  # by increasing number of contacts
        return next((k for k, upper_bound in upper_bounds.items() if upper_bound * limit >= 1.0), None)

    def best(self, penalty: Penalty) -> int:
        """Return the number of contacts with the largest lower bound on mu minus penalty.

        Of equal ones it is the least.

        Parameters
        ----------
        penalty : float, sequence, mapping or callable
            In units of mu. A number is the price of each contact. A sequence holds those of the first, second, ...
            contact. A mapping holds them by the contacts' kind, ``{"friction": 0.05, "soft": 0.1}``. A callable takes
            the contact models (their number is its ``len``) and mu, and returns what they cost together: any number.

        Raises
        ------
        InputError
            On prices below zero, missing ones, and functions that return no finite number.
        """
        return max(self.solutions, key=lambda pair: (self._penalised_interval(pair[1], penalty)[0], -pair[0]))[0]

    @property
    def front(self) -> tuple[int, ...]:
        """Numbers of contacts whose grasps no other one beats for the purposes with weights, increasing.

        Raises
        ------
        InputError
            If the study had no weights.
        """
        return tuple(self.solutions[i][0] for i in require_comparison(self.purposes).front)

    def best_weighted(self, weights: Mapping[str, float] | None = None, force: float | None = None) -> int | None:
        """Return the number of contacts with the largest score by weights, or ``None`` if no number has a grasp.

        Of equal ones it is the least. ``nlpgrasp.studies.PurposeComparison`` defines the score.

        Parameters
        ----------
        weights : mapping of str to float, optional
            Other weights of purposes that the study measured; those of the study when left out.
        force : float, optional
            Only among grasps that exert the whole task within this limit, in units of the force budget.

        Raises
        ------
        InputError
            If the study had no weights; on purposes that it did not measure and invalid weights.
        """
        comparison = require_comparison(self.purposes)
        if force is not None:
            held = zip(comparison.values, self._hold_with(force), strict=True)
            comparison = replace(comparison, values=tuple(value if is_enough else None for value, is_enough in held))
        best = best_by_weights(comparison, weights)
        return None if best is None else self.solutions[best][0]

    def _hold_with(self, force: float) -> list[bool]:
        """Return for each number whether its grasp exerts the whole task within a force limit."""
        limit = number("force", force, above=0.0)
        return [solution.mu.lower * limit >= 1.0 for _, solution in self.solutions]

    def penalised_quality(self, penalty: Penalty) -> dict[int, Bounds]:
        """Return bounds on mu minus penalty for each number of contacts.

        A penalty that is a function of mu is evaluated at the two bounds on mu alone.
        """
        intervals = {k: sorted(self._penalised_interval(solution, penalty)) for k, solution in self.solutions}
        return {k: Bounds(low, high) for k, (low, high) in intervals.items()}

    def worth(self, penalty: Penalty) -> dict[int, Bounds]:
        """Return ``penalised_quality(penalty)`` under its former name, which the next release drops."""
        return self.penalised_quality(penalty)

    def _penalised_interval(self, solution: GraspSolution, penalty: Penalty) -> tuple[float, float]:
        low, high = solution.mu.lower, solution.mu.upper if np.isfinite(solution.mu.upper) else solution.mu.lower
        contacts = _contact_models(solution)
        return low - cost_of(contacts, low, penalty), high - cost_of(contacts, high, penalty)

    def _at(self, contacts: int) -> GraspSolution:
        for k, solution in self.solutions:
            if k == contacts:
                return solution
        raise InputError("contacts", contacts, "one of " + ", ".join(str(k) for k, _ in self.solutions))

    def to_dict(self) -> Json:
        """Return the curve as JSON data, one row per number of contacts; with ``purposes`` if the study had weights."""
        shortfall, bounds = self.shortfall, self.best_possible
        purposes = {} if self.purposes is None else {"purposes": self.purposes.to_dict()}
        return {
            "curve": [
                {
                    "contacts": k,
                    "status": solution.status.name.lower(),
                    "mu": solution.mu.to_dict() if np.isfinite(solution.mu.upper) else None,
                    "kind": solution.kind,
                    "best_known": self.best_known[k],
                    "shortfall": shortfall[k],
                    "reached": self.reached.get(k),
                    "possible": _finite(bounds[k]),
                    "gap": _finite(self.gap(k)),
                }
                for k, solution in self.solutions
            ],
            **purposes,
        }

    def __str__(self) -> str:
        shortfall = self.shortfall
        lines = []
        for k, solution in self.solutions:
            bounds = f"{solution.label} in {solution.mu}" if solution.success else solution.status.name.lower()
            if k in self.reached:
                bounds += f", met by {self.reached[k]} of {len(solution.starts)} starts"
            if shortfall[k] > 0.0:
                bounds += f", {shortfall[k]:.1%} below the best known with fewer contacts"
            if np.isfinite(self.gap(k)):
                bounds += f", {format_headroom(self.gap(k), 2)}"
            elif np.isfinite(self.best_possible[k]):
                bounds += f", at most {format_upper(self.best_possible[k], 4)} possible"
            lines.append(f"{k:3d} contacts: {bounds}")
        return "\n".join(lines if self.purposes is None else [*lines, str(self.purposes)])


def cost_of(contacts: tuple[ContactModel, ...], mu: float, penalty: Penalty) -> float:
    """Return the penalty of contacts at a given mu, in units of mu.

    See ``ContactCurve.best``.
    """
    if callable(penalty):
        value = penalty(contacts, mu)
        return number("penalty", value)
    if isinstance(penalty, Mapping):
        labels = [model.kind for model in contacts]
        missing = sorted({label for label in labels if label not in penalty})
        if missing:
            raise InputError("penalty", f"none for {', '.join(missing)}", "a price for each kind of contact")
        return sum(number(f"penalty[{label!r}]", penalty[label], at_least=0.0) for label in labels)
    if isinstance(penalty, list | tuple):
        if len(penalty) < len(contacts):
            raise InputError("penalty", f"{len(penalty)} prices", f"{len(contacts)}, one a contact")
        return sum(number(f"penalty[{i}]", penalty[i], at_least=0.0) for i in range(len(contacts)))
    return number("penalty", penalty, at_least=0.0) * len(contacts)


def _finite(value: float) -> float | None:
    """Return a number for JSON, or ``None`` if it is not finite."""
    return value if np.isfinite(value) else None


def _contact_models(solution: GraspSolution) -> tuple[ContactModel, ...]:
    """Return the contact models of a solution's problem."""
    return tuple(contact_from_dict(data) for data in solution.problem["contacts"])


def _check_problem(k: int, problem: GraspProblem, reference: GraspProblem) -> None:
    """Raise if a problem has another number of contacts than requested, or another task than the reference."""
    if not isinstance(problem, GraspProblem) or len(problem.models) != k:
        raise InputError("problem_with", problem, f"a GraspProblem with {k} contacts")
    is_same = np.array_equal(problem.origin, reference.origin) and problem.budget == reference.budget
    if not is_same or problem.task.to_dict() != reference.task.to_dict():
        raise InputError(
            "problem_with", f"another task, torque origin or budget with {k} contacts", "the same task for all"
        )


def _check_bounds(possible: Mapping[int, float] | None) -> dict[int, float]:
    """Return validated upper bounds by number of contacts."""
    if possible is None:
        return {}
    if not isinstance(possible, Mapping):
        raise InputError("possible", possible, "bounds by the number of contacts")
    return {
        integer("possible", k, at_least=1): number(f"possible[{k}]", bound, at_least=0.0)
        for k, bound in possible.items()
    }


class NumberConversion:
    """Conversion of grasps between problems of one body with fewer and more contacts.

    There is none for a hand with a pose.
    """

    def extend_grasp(self, start: StartGrasp, small: CompiledProblem, large: CompiledProblem) -> WarmStart | None:
        """Return the grasp with contacts added, the best of some random ones that keep the constraints."""
        if not self._fits(small, large):
            return None
        return complete_contacts(large, start.on_body.grasp, start.on_body.candidate.faces)

    def reduce_grasp(self, start: StartGrasp, large: CompiledProblem, small: CompiledProblem) -> WarmStart | None:
        """Return the grasp with the best subset of its contacts that keeps the constraints."""
        grasp, subsets = start.on_body.grasp, _contact_subsets(large, small) if self._fits(small, large) else []
        if not subsets:
            return None
        indices = np.array(subsets)
        faces = np.array(start.on_body.candidate.faces, dtype=object)[indices]
        candidate = best_feasible(small, grasp.points[indices], grasp.normals[indices], faces)
        return None if candidate is None else WarmStart(candidate)

    def _fits(self, small: CompiledProblem, large: CompiledProblem) -> bool:
        follow = small.follows_contacts and large.follows_contacts
        return follow and is_same_body(small.problem.body, large.problem.body)


def _contact_subsets(large: CompiledProblem, small: CompiledProblem) -> list[Sequence[int]]:
    """Return the ordered subsets of a larger problem's contacts that may replace the contacts of a smaller one."""
    small_models, large_models, space = small.problem.models, large.problem.models, small.problem.body.space
    subsets: list[Sequence[int]] = []
    for subset in combinations(range(len(large_models)), len(small_models)):
        assignment = assign_contacts(small_models, [large_models[j] for j in subset], space)
        if assignment is not None and len(subsets) < SUBSETS:
            subsets.append([subset[p] for p in assignment])
    return subsets
