"""Choice of contact types per finger, hard or soft (Section 4)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement, product
from typing import TypeAlias

import numpy as np

from nlpgrasp.common.formatting import format_lower, format_upper
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import integer, number, prefix_errors
from nlpgrasp.contacts import ContactModel
from nlpgrasp.contacts.cone_inclusion import assign_contacts
from nlpgrasp.errors import InputError
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.constraint_values import ConstraintValues, HandFunctions
from nlpgrasp.optimize.options import SolveOptions, check_solve_arguments
from nlpgrasp.optimize.start_result import StartGrasp
from nlpgrasp.optimize.surface_samples import SurfaceSamples
from nlpgrasp.optimize.warm_starts import WarmStart
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.studies.nested_problems import solve_family
from nlpgrasp.studies.purposes import (
    PurposeComparison,
    best_by_weights,
    check_purposes,
    compare_purposes,
    require_comparison,
)

MOST_ASSIGNMENTS = 256  # most assignments
SAMPLES = 8  # random placements that test whether contacts are interchangeable


Types: TypeAlias = Mapping[str, ContactModel]
Names: TypeAlias = tuple[str, ...]


def choose_contact_types(
    problem: GraspProblem,
    types: Types | Sequence[Types],
    starts: int = 8,
    seed: int = 0,
    options: SolveOptions | None = None,
    *,
    costs: Mapping[str, float] | None = None,
    weights: Mapping[str, float] | None = None,
) -> TypeChoice:
    """Solve a problem with every distinct assignment of contact types, and rank the assignments.

    For interchangeable contacts (the same menu and faces, no constraint or hand that distinguishes them) only the
    number of each type matters: two types for three such contacts make four assignments, not eight. The fingers of a
    hand with a pose are all distinct.

    A contact whose force domain contains another's can exert the other's forces, so that the best grasp with richer
    contacts is never worse. Every assignment has warm starts from the grasps of smaller ones, with their certified
    bounds, and from those of larger ones; so no known grasp contradicts the ranking.

    Parameters
    ----------
    problem : GraspProblem
        Its contacts' faces are used where a type states none; their models are ignored.
    types : mapping of str to ContactModel, or sequence of k mappings
        Allowed types by name, for all contacts or for each.
    starts, seed, options
        As for ``solve``, for each assignment.
    costs : mapping of str to float, optional
        Cost of a contact of each type, at least 0, in any unit; 0 for all when left out.
    weights : mapping of str to float, optional
        Weights, at least 0, of the purposes by which the assignments are compared: ``"mu"``, ``"sensitivity"``,
        ``"manipulability"``, ``"fragility"``, ``"contacts"`` and ``"force"``, as
        ``nlpgrasp.studies.PurposeComparison`` defines them.
        ``"contacts"`` is the assignment's cost; without costs it is the number of contacts, equal for all. The result
        then has ``purposes``, ``front`` and ``best_weighted``. Each assignment's grasp is the one with the largest mu:
        weights choose among the assignments, not among the placements of one assignment.

    Returns
    -------
    TypeChoice
        A ranked table; assignments without a grasp come last.

    Raises
    ------
    InputError
        On a menu without a type or with something else than contact models, more than 256 assignments, and costs that
        are missing or below zero, or zero where weights have ``"contacts"``; on unknown purposes, weights below 0, not
        finite or all 0, manipulability with a hand without joints, and fragility under a budget that depends on the
        posture.
    """
    menu = AllowedTypes.of(problem, types)
    starts, seed, options = check_solve_arguments(starts, seed, options)
    prices = _type_costs(menu, costs)
    names, pairs = menu.ordered_assignments()
    problems = [menu.problem_with(types_of_contacts) for types_of_contacts in names]
    checked_weights = check_purposes(weights, problems)
    if checked_weights and "contacts" in checked_weights and costs is not None:
        for name, price in prices.items():  # ratios of costs need costs above zero
            number(f"costs[{name!r}]", price, above=0.0)
    solved = solve_family(problems, pairs, TypeConversion(menu, names), starts, seed, options)
    assignments = [
        TypeAssignment(types_of_contacts, solution, sum(prices[name] for name in types_of_contacts), reached)
        for types_of_contacts, (solution, reached) in zip(names, solved, strict=True)
    ]
    # neighbours are ordered from smaller to larger; of equals the later is the richer
    ranked = sorted(range(len(assignments)), key=lambda i: (-assignments[i].mu.lower, -i))
    upgrades = tuple(TypeUpgrade(assignments[a], assignments[b]) for a, b in pairs)
    purposes = compare_purposes(
        [str(assignments[i]) for i in ranked],
        [assignments[i].solution for i in ranked],
        [problems[i] for i in ranked],
        [len(problem.models) if costs is None else assignments[i].cost for i in ranked],
        checked_weights,
        options.robust_offset,
    )
    return TypeChoice(problem.name, tuple(assignments[i] for i in ranked), upgrades, purposes)


@dataclass(frozen=True)
class TypeChoice:
    """Ranked assignments of contact types.

    Parameters
    ----------
    name : str
        The problem's.
    assignments : tuple of TypeAssignment
        Largest certified lower bound first; of equals the richer one.
    upgrades : tuple of TypeUpgrade
        Gains between neighbours: no third assignment is between the two.
    purposes : PurposeComparison or None
        Comparison of the assignments, in their order, by the purposes with weights; ``None`` without weights.
    """

    name: str
    assignments: tuple[TypeAssignment, ...]
    upgrades: tuple[TypeUpgrade, ...] = ()
    purposes: PurposeComparison | None = None

    def best(
        self, *, at_most: Mapping[str, int] | None = None, spend: float | None = None, price: float = 0.0
    ) -> TypeAssignment | None:
        """Return the assignment within limits whose mu has the largest lower bound, or ``None``.

        Among equal ones it is the cheapest.

        Parameters
        ----------
        at_most : mapping of str to int, optional
            Largest number of contacts of a type: ``{"soft": 1}`` allows one soft finger.
        spend : float, optional
            Largest total cost.
        price : float
            Price of a unit of cost, in units of mu: the best has the largest ``mu - price * cost``.

        Raises
        ------
        InputError
            On types that no assignment has, and limits below zero.
        """
        names = {name for a in self.assignments for name in a.types}
        limits = at_most or {}
        if not isinstance(limits, Mapping) or any(name not in names for name in limits):
            raise InputError("at_most", at_most, "numbers by type: " + ", ".join(sorted(names)))
        largest_counts = {name: integer(f"at_most[{name!r}]", n, at_least=0) for name, n in limits.items()}
        limit = np.inf if spend is None else number("spend", spend, at_least=0.0)
        cost_price = number("price", price, at_least=0.0)
        candidates = [
            a
            for a in self.assignments
            if a.solution.success and a.cost <= limit and all(a.count(name) <= n for name, n in largest_counts.items())
        ]
        return max(candidates, key=lambda a: (a.mu.lower - cost_price * a.cost, -a.cost), default=None)

    def not_told_apart(self, assignment: TypeAssignment) -> tuple[TypeAssignment, ...]:
        """Return the assignments whose certified intervals overlap that of a given assignment."""
        bounds = assignment.mu
        others = (a for a in self.assignments if a is not assignment)
        return tuple(a for a in others if a.mu.lower <= bounds.upper and bounds.lower <= a.mu.upper)

    @property
    def frontier(self) -> tuple[TypeAssignment, ...]:
        """Pareto frontier of cost and certified lower bound on mu over the assignments."""
        frontier: list[TypeAssignment] = []
        for a in sorted(self.assignments, key=lambda a: (a.cost, -a.mu.lower)):
            if a.solution.success and (not frontier or a.mu.lower > frontier[-1].mu.lower):
                frontier.append(a)
        return tuple(frontier)

    @property
    def front(self) -> tuple[TypeAssignment, ...]:
        """Assignments whose grasps no other one beats for the purposes with weights, largest mu first.

        Raises
        ------
        InputError
            If the study had no weights.
        """
        return tuple(self.assignments[i] for i in require_comparison(self.purposes).front)

    def best_weighted(self, weights: Mapping[str, float] | None = None) -> TypeAssignment | None:
        """Return the assignment with the largest score by weights, or ``None`` if none has a grasp.

        Of equal ones it is the one with the largest mu. ``nlpgrasp.studies.PurposeComparison`` defines the score.

        Parameters
        ----------
        weights : mapping of str to float, optional
            Other weights of purposes that the study measured; those of the study when left out.

        Raises
        ------
        InputError
            If the study had no weights; on purposes that it did not measure and invalid weights.
        """
        best = best_by_weights(self.purposes, weights)
        return None if best is None else self.assignments[best]

    def to_dict(self) -> Json:
        """Return the ranking as JSON data, with ``purposes`` if the study had weights."""
        purposes = {} if self.purposes is None else {"purposes": self.purposes.to_dict()}
        return {
            "name": self.name,
            "assignments": [a.to_dict() for a in self.assignments],
            "upgrades": [u.to_dict() for u in self.upgrades],
            **purposes,
        }

    def __str__(self) -> str:
        width = max(len(str(a)) for a in self.assignments)
        lines = [f"{self.name}: {len(self.assignments)} assignments of contact types, the best known grasp of each"]
        for a in self.assignments:
            bounds = f"{a.solution.label} in {a.mu}" if a.solution.success else "no grasp found"
            overlapping = len(self.not_told_apart(a)) if a.solution.success else 0
            note = f", not told apart from {overlapping} other{'s' * (overlapping > 1)}" if overlapping else ""
            lines.append(f"  {a!s:{width}}  cost {a.cost:g}  {bounds}{note}")
        lines += [f"  {u}" for u in self.upgrades]
        return "\n".join(lines if self.purposes is None else [*lines, str(self.purposes)])


@dataclass(frozen=True)
class TypeAssignment:
    """Assignment of contact types to contacts, with the best known grasp.

    Parameters
    ----------
    types : tuple of k str
        A name of the menu for each contact.
    solution : GraspSolution
        Certified; can be saved and verified on its own.
    cost : float
        The sum of its contacts' costs.
    reached : int
        Number of starts within 2 % of the grasp.
    """

    types: tuple[str, ...]
    solution: GraspSolution
    cost: float = 0.0
    reached: int = 0

    @property
    def mu(self) -> Bounds:
        """Certified bounds on mu of the grasp; [0, 0] without a grasp."""
        return self.solution.mu if self.solution.success else Bounds(0.0, 0.0)

    def count(self, name: str) -> int:
        """Return the number of contacts of a type."""
        return self.types.count(name)

    def to_dict(self) -> Json:
        """Return the assignment as JSON data, without its solution."""
        return {
            "types": list(self.types),
            "status": self.solution.status.name.lower(),
            "mu": self.mu.to_dict(),
            "cost": self.cost,
            "reached": self.reached,
        }

    def __str__(self) -> str:
        return " ".join(self.types)


@dataclass(frozen=True)
class TypeUpgrade:
    """Gain in mu from an assignment to one with dominating types.

    Parameters
    ----------
    before, after : TypeAssignment
        The types of the second dominate those of the first.
    """

    before: TypeAssignment
    after: TypeAssignment

    @property
    def gain(self) -> Bounds:
        """Certified increase of mu, at least 0.

        The first grasp is feasible for the second types.
        """
        low, high = self.before.mu, self.after.mu
        return Bounds(max(least_excess(high, low), 0.0), max(high.upper - low.lower, 0.0))

    @property
    def certain(self) -> bool:
        """Whether the certified intervals are disjoint, so that mu certainly increases."""
        return self.gain.lower > 0.0

    def to_dict(self) -> Json:
        """Return the upgrade as JSON data."""
        return {
            "before": list(self.before.types),
            "after": list(self.after.types),
            "gain": self.gain.to_dict(),
            "certain": self.certain,
        }

    def __str__(self) -> str:
        text = f"{self.before} -> {self.after}"
        if not self.after.solution.success:
            return f"{text}: no grasp found with either"
        if not self.certain:
            return f"{text}: not told apart, at most +{format_upper(self.gain.upper, 4)}"
        return f"{text}: +{format_lower(self.gain.lower, 4)} to +{format_upper(self.gain.upper, 4)}"


def least_excess(high: Bounds, low: Bounds) -> float:
    """Return the least difference between values of a higher and a lower interval."""
    return high.lower - low.upper


@dataclass(frozen=True)
class AllowedTypes:
    """Contact types that each contact may have, by name.

    Parameters
    ----------
    problem : GraspProblem
    menus : tuple of k mappings of str to ContactModel
        Allowed types, with the faces of the problem's own contact where the type states none.
    groups : tuple of k int
        Group of each contact; those of one group are interchangeable.
    """

    problem: GraspProblem
    menus: tuple[Types, ...]
    groups: tuple[int, ...]

    @classmethod
    def of(cls, problem: GraspProblem, types: Types | Sequence[Types]) -> AllowedTypes:
        """Return the allowed types of a problem's contacts, given for all contacts or for each.

        Raises
        ------
        InputError
            On a menu without a type, one that is no contact model, or another number of menus than of contacts.
        """
        if not isinstance(problem, GraspProblem):
            raise InputError("problem", problem, "a GraspProblem")
        k = len(problem.models)
        menus = (types,) * k if isinstance(types, Mapping) else types
        if not isinstance(menus, list | tuple) or not all(isinstance(m, Mapping) for m in menus):
            raise InputError("types", types, "contact models by name, or such a mapping for each contact")
        if len(menus) != k:
            raise InputError("types", f"{len(menus)} menus", f"{k}, one a contact, or one for all")
        names = ["types" if isinstance(types, Mapping) else f"types[{i}]" for i in range(k)]
        pairs = zip(names, menus, problem.models, strict=True)
        type_menus = tuple(_check_types(name, menu, model.faces) for name, menu, model in pairs)
        with prefix_errors("types: "):
            for i, menu in enumerate(type_menus):
                for model in menu.values():
                    models = (*problem.models[:i], model, *problem.models[i + 1 :])
                    replace(problem, contacts=models)
        return cls(problem, type_menus, _interchangeable_contacts(problem, type_menus))

    @property
    def assignments(self) -> list[Names]:
        """Distinct assignments of types to contacts.

        For interchangeable contacts only the number of each type matters.

        Raises
        ------
        InputError
            Where there are more than 256.
        """
        members = {g: [i for i, group in enumerate(self.groups) if group == g] for g in dict.fromkeys(self.groups)}
        choices = [list(combinations_with_replacement(list(self.menus[m[0]]), len(m))) for m in members.values()]
        total = float(np.prod([float(len(c)) for c in choices]))
        if total > MOST_ASSIGNMENTS:
            raise InputError("types", f"{total:.0f} distinct assignments", f"at most {MOST_ASSIGNMENTS}")
        assignments = []
        for chosen in product(*choices):
            names = [""] * len(self.groups)
            for contacts, group_types in zip(members.values(), chosen, strict=True):
                for i, name in zip(contacts, group_types, strict=True):
                    names[i] = name
            assignments.append(tuple(names))
        return assignments

    def models(self, names: Names) -> tuple[ContactModel, ...]:
        """Return the contact models of an assignment."""
        return tuple(menu[name] for menu, name in zip(self.menus, names, strict=True))

    def problem_with(self, names: Names) -> GraspProblem:
        """Return the problem with the contacts of an assignment."""
        changes: Json = {"contacts": self.models(names), "name": f"{self.problem.name[:150]}: {' '.join(names)[:45]}"}
        return replace(self.problem, **changes)

    def match_contacts(self, small: Names, large: Names) -> list[int] | None:
        """Match the contacts of an assignment with contacts of dominating types in a larger one, or return ``None``.

        The result is the index of each contact's match.
        """
        return assign_contacts(self.models(small), self.models(large), self.problem.body.space, self.groups)

    def ordered_assignments(self) -> tuple[list[Names], list[tuple[int, int]]]:
        """Return the assignments from smaller to larger, and the index pairs of neighbours in this partial order.

        One assignment is smaller than another if each of its contacts is dominated by one of the other's.
        """
        names = self.assignments
        is_below = np.array([[a != b and self.match_contacts(a, b) is not None for b in names] for a in names])
        is_later = np.arange(len(names))[:, None] > np.arange(len(names))
        is_below &= ~(is_below & is_below.T & is_later)  # of equal ones the first is the smaller
        order = np.argsort(is_below.sum(axis=0), kind="stable")
        is_below = is_below[np.ix_(order, order)]
        is_between = (is_below.astype(int) @ is_below.astype(int)) > 0
        pairs = [(int(a), int(b)) for a, b in np.argwhere(is_below & ~is_between)]
        return [names[i] for i in order], pairs


def _check_types(name: str, types: Types, faces: Iterable[str] | str | None) -> dict[str, ContactModel]:
    """Return the validated types of a contact.

    Types that state no faces get the faces of the contact.
    """
    if not types:
        raise InputError(name, "no type", "at least one contact model by name")
    for key, model in types.items():
        if not isinstance(key, str) or not key.strip():
            raise InputError(name, key, "names of contact models")
        if not isinstance(model, ContactModel):
            raise InputError(f"{name}[{key!r}]", model, "a contact model such as ng.FrictionContact")
    changes: Json = {"faces": faces}
    return {key: model if model.faces is not None else replace(model, **changes) for key, model in types.items()}


def _interchangeable_contacts(problem: GraspProblem, menus: Sequence[Types]) -> tuple[int, ...]:
    """Return a group index for each contact, equal for interchangeable contacts."""
    budget, hand = problem.budget, problem.hand
    if budget.depends_on_frames or budget.follows_hand or (hand is not None and not hand.follows_contacts):
        return tuple(range(len(menus)))
    constraints, samples, hand_functions = ConstraintValues(problem), SurfaceSamples(problem), HandFunctions(problem)
    rng = np.random.default_rng(0)
    clouds = [samples.cloud(i) for i in range(len(menus))]
    indices_of_contacts = [rng.integers(len(cloud.points), size=SAMPLES) for cloud in clouds]
    points = np.stack([c.points[indices] for c, indices in zip(clouds, indices_of_contacts, strict=True)], axis=1)
    normals = np.stack([c.normals[indices] for c, indices in zip(clouds, indices_of_contacts, strict=True)], axis=1)
    limits = np.array([[c.lower, c.upper, c.scale] for c in constraints.named]).reshape(-1, 3)

    def constraint_values(order: list[int]) -> list[list[tuple[float, ...]]]:
        p, n = points[:, order], normals[:, order]
        values = constraints.values(p, n, hand_functions.start(p, n))
        return [
            sorted(tuple(np.round([v, *limit], 9)) for v, limit in zip(placement, limits, strict=True))
            for placement in values
        ]

    groups = list(range(len(menus)))
    reference = constraint_values(list(range(len(menus))))
    for j in range(len(menus)):
        for i in range(j):
            order = list(range(len(menus)))
            order[i], order[j] = j, i
            if groups[i] == i and menus[i] == menus[j] and constraint_values(order) == reference:
                groups[j] = i
                break
    return tuple(groups)


class TypeConversion:
    """Conversion of grasps between assignments of contact types.

    Each contact moves to a finger of a dominating type, or back.

    Parameters
    ----------
    menu : AllowedTypes
    names : list of tuple of str
        The assignments.
    """

    def __init__(self, menu: AllowedTypes, names: list[Names]) -> None:
        self._menu = menu
        self._names = {menu.problem_with(assignment).models: assignment for assignment in names}

    def extend_grasp(self, start: StartGrasp, small: CompiledProblem, large: CompiledProblem) -> WarmStart | None:
        """Return the grasp with contacts of dominating types, whose quality is at least the same."""
        matching = self._match(small, large)
        if matching is None:
            return None
        order = [matching.index(j) for j in range(len(matching))]
        return _reorder(start, order)

    def reduce_grasp(self, start: StartGrasp, large: CompiledProblem, small: CompiledProblem) -> WarmStart | None:
        """Return the grasp with contacts of dominated types, without a guarantee on its quality."""
        matching = self._match(small, large)
        return None if matching is None else _reorder(start, matching)

    def _match(self, small: CompiledProblem, large: CompiledProblem) -> list[int] | None:
        return self._menu.match_contacts(self._names[small.problem.models], self._names[large.problem.models])


def _reorder(start: StartGrasp, order: list[int]) -> WarmStart:
    """Return the grasp with its contacts in another order."""
    candidate, grasp = start.on_body.candidate, start.on_body.grasp
    faces = tuple(candidate.faces[i] for i in order)
    return WarmStart(GraspCandidate(faces, grasp.points[order], candidate.hand), grasp.normals[order])


def _type_costs(menu: AllowedTypes, costs: Mapping[str, float] | None) -> dict[str, float]:
    """Return the validated cost of each contact type; zero without costs."""
    names = list(dict.fromkeys(name for menu_of_contact in menu.menus for name in menu_of_contact))
    if costs is None:
        return dict.fromkeys(names, 0.0)
    if not isinstance(costs, Mapping) or any(name not in names for name in costs):
        raise InputError("costs", costs, "costs by type: " + ", ".join(names))
    missing = [name for name in names if name not in costs]
    if missing:
        raise InputError("costs", f"none for {', '.join(missing)}", "a cost for each type")
    return {name: number(f"costs[{name!r}]", costs[name], at_least=0.0) for name in names}
