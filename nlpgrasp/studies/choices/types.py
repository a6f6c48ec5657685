"""Choice of contact types per finger, hard or soft (Section 4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from nlpgrasp.common.validation import number
from nlpgrasp.errors import InputError
from nlpgrasp.optimize.options import SolveOptions, check_search
from nlpgrasp.optimize.start.result import StartGrasp
from nlpgrasp.optimize.start.warm_starts import WarmStart
from nlpgrasp.optimize.workbench.placed import Placed
from nlpgrasp.optimize.workbench.workbench import Workbench
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.studies.choices.family import solve_family
from nlpgrasp.studies.choices.menu import Menu, Names, Types
from nlpgrasp.studies.choices.type_choice import TypeAssignment, TypeChoice, Upgrade


def choose_contact_types(
    problem: GraspProblem,
    types: Types | Sequence[Types],
    starts: int = 8,
    seed: int = 0,
    options: SolveOptions | None = None,
    *,
    costs: Mapping[str, float] | None = None,
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

    Returns
    -------
    TypeChoice
        A ranked table; assignments without a grasp come last.

    Raises
    ------
    InputError
        On a menu without a type or with something else than contact models, more than 256 assignments, and costs that
        are missing or below zero.
    """
    menu = Menu.of(problem, types)
    starts, seed, options = check_search(starts, seed, options)
    prices = _prices(menu, costs)
    names, pairs = menu.ordered()
    problems = [menu.problem_with(own) for own in names]
    solved = solve_family(problems, pairs, OtherTypes(menu, names), starts, seed, options)
    found = [
        TypeAssignment(own, solution, sum(prices[name] for name in own), reached)
        for own, (solution, reached) in zip(names, solved, strict=True)
    ]
    # neighbours are ordered from smaller to larger; of equals the later is the richer
    ranked = sorted(range(len(found)), key=lambda i: (-found[i].mu.lower, -i))
    upgrades = tuple(Upgrade(found[a], found[b]) for a, b in pairs)
    return TypeChoice(problem.name, tuple(found[i] for i in ranked), upgrades)


class OtherTypes:
    """Conversion between assignments of contact types: each contact moves to a finger of a dominating type.

    Parameters
    ----------
    menu : Menu
    names : list of tuple of str
        The assignments.
    """

    def __init__(self, menu: Menu, names: list[Names]) -> None:
        self._menu = menu
        self._names = {menu.problem_with(own).models: own for own in names}

    def up(self, found: StartGrasp, small: Workbench, large: Workbench) -> WarmStart | None:
        """Return the grasp with the richer contacts, of at least the same quality."""
        places = self._places(small, large)
        if places is None:
            return None
        back = [places.index(j) for j in range(len(places))]
        return _reordered(found, back)

    def down(self, found: StartGrasp, large: Workbench, small: Workbench) -> WarmStart | None:
        """Return the grasp with the poorer contacts, without a guarantee."""
        places = self._places(small, large)
        return None if places is None else _reordered(found, places)

    def _places(self, small: Workbench, large: Workbench) -> list[int] | None:
        return self._menu.places(self._names[small.problem.models], self._names[large.problem.models])


def _reordered(found: StartGrasp, order: list[int]) -> WarmStart:
    """Return the grasp with its contacts in another order."""
    placed, grasp = found.found.placed, found.found.grasp
    faces = tuple(placed.faces[i] for i in order)
    return WarmStart(Placed(faces, grasp.points[order], placed.hand), grasp.normals[order])


def _prices(menu: Menu, costs: Mapping[str, float] | None) -> dict[str, float]:
    names = list(dict.fromkeys(name for own in menu.each for name in own))
    if costs is None:
        return dict.fromkeys(names, 0.0)
    if not isinstance(costs, Mapping) or any(name not in names for name in costs):
        raise InputError("costs", costs, "costs by type: " + ", ".join(names))
    missing = [name for name in names if name not in costs]
    if missing:
        raise InputError("costs", f"none for {', '.join(missing)}", "a cost for each type")
    return {name: number(f"costs[{name!r}]", costs[name], at_least=0.0) for name in names}
