"""Menu of contact types per finger, and the distinct assignments."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement, product
from typing import TypeAlias

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import within
from nlpgrasp.contacts import ContactModel
from nlpgrasp.contacts.cones.wider import placed_in
from nlpgrasp.errors import InputError
from nlpgrasp.optimize.workbench.hand_points import HandPoints
from nlpgrasp.optimize.workbench.row_values import RowValues
from nlpgrasp.optimize.workbench.surface_samples import SurfaceSamples
from nlpgrasp.problem.problem import GraspProblem

MOST = 256  # most assignments
DRAWN = 8  # random placements that test whether contacts are interchangeable
Types: TypeAlias = Mapping[str, ContactModel]
Names: TypeAlias = tuple[str, ...]


@dataclass(frozen=True)
class Menu:
    """Allowed contact types of each contact, by name.

    Parameters
    ----------
    problem : GraspProblem
    each : tuple of k mappings of str to ContactModel
        Allowed types, with the faces of the problem's own contact where the type states none.
    groups : tuple of k int
        Group of each contact; those of one group are interchangeable.
    """

    problem: GraspProblem
    each: tuple[Types, ...]
    groups: tuple[int, ...]

    @classmethod
    def of(cls, problem: GraspProblem, types: Types | Sequence[Types]) -> Menu:
        """Return the menu of a problem's contacts: one for all, or one per contact.

        Raises
        ------
        InputError
            On a menu without a type, one that is no contact model, or another number of menus than of contacts.
        """
        if not isinstance(problem, GraspProblem):
            raise InputError("problem", problem, "a GraspProblem")
        k = len(problem.models)
        given = (types,) * k if isinstance(types, Mapping) else types
        if not isinstance(given, list | tuple) or not all(isinstance(m, Mapping) for m in given):
            raise InputError("types", types, "contact models by name, or such a mapping for each contact")
        if len(given) != k:
            raise InputError("types", f"{len(given)} menus", f"{k}, one a contact, or one for all")
        names = ["types" if isinstance(types, Mapping) else f"types[{i}]" for i in range(k)]
        pairs = zip(names, given, problem.models, strict=True)
        each = tuple(_checked(name, own, model.faces) for name, own, model in pairs)
        with within("types: "):
            for i, own in enumerate(each):
                for model in own.values():
                    models = (*problem.models[:i], model, *problem.models[i + 1 :])
                    replace(problem, contacts=models)
        return cls(problem, each, _groups(problem, each))

    @property
    def assignments(self) -> list[Names]:
        """The distinct assignments of types to contacts; for interchangeable contacts only the counts matter.

        Raises
        ------
        InputError
            Where there are more than 256.
        """
        members = {g: [i for i, own in enumerate(self.groups) if own == g] for g in dict.fromkeys(self.groups)}
        ways = [list(combinations_with_replacement(list(self.each[m[0]]), len(m))) for m in members.values()]
        total = float(np.prod([float(len(w)) for w in ways]))
        if total > MOST:
            raise InputError("types", f"{total:.0f} distinct assignments", f"at most {MOST}")
        found = []
        for chosen in product(*ways):
            names = [""] * len(self.groups)
            for places, own in zip(members.values(), chosen, strict=True):
                for i, name in zip(places, own, strict=True):
                    names[i] = name
            found.append(tuple(names))
        return found

    def models(self, names: Names) -> tuple[ContactModel, ...]:
        """Return the contact models of an assignment."""
        return tuple(own[name] for own, name in zip(self.each, names, strict=True))

    def problem_with(self, names: Names) -> GraspProblem:
        """Return the problem with the contacts of an assignment."""
        changes: Json = {"contacts": self.models(names), "name": f"{self.problem.name[:150]}: {' '.join(names)[:45]}"}
        return replace(self.problem, **changes)

    def places(self, small: Names, large: Names) -> list[int] | None:
        """Return an injective map of contacts to larger ones whose types dominate theirs, or None."""
        return placed_in(self.models(small), self.models(large), self.problem.body.space, self.groups)

    def ordered(self) -> tuple[list[Names], list[tuple[int, int]]]:
        """Return the assignments in an order from smaller to larger, and the pairs of neighbours.

        One assignment is smaller than another if each of its contacts is dominated by one of the other's.
        """
        names = self.assignments
        below = np.array([[a != b and self.places(a, b) is not None for b in names] for a in names])
        below &= ~(below & below.T & (np.arange(len(names))[:, None] > np.arange(len(names))))  # equal: the first
        order = np.argsort(below.sum(axis=0), kind="stable")
        below = below[np.ix_(order, order)]
        between = (below.astype(int) @ below.astype(int)) > 0
        pairs = [(int(a), int(b)) for a, b in np.argwhere(below & ~between)]
        return [names[i] for i in order], pairs


def _checked(name: str, types: Types, faces: Iterable[str] | str | None) -> dict[str, ContactModel]:
    if not types:
        raise InputError(name, "no type", "at least one contact model by name")
    for key, model in types.items():
        if not isinstance(key, str) or not key.strip():
            raise InputError(name, key, "names of contact models")
        if not isinstance(model, ContactModel):
            raise InputError(f"{name}[{key!r}]", model, "a contact model such as ng.FrictionContact")
    changes: Json = {"faces": faces}
    return {key: model if model.faces is not None else replace(model, **changes) for key, model in types.items()}


def _groups(problem: GraspProblem, each: Sequence[Types]) -> tuple[int, ...]:
    """Return a group number for each contact, equal for interchangeable contacts."""
    budget, hand = problem.budget, problem.hand
    if budget.depends_on_frames or budget.follows_hand or (hand is not None and not hand.follows_contacts):
        return tuple(range(len(each)))
    rows, samples, hand_points = RowValues(problem), SurfaceSamples(problem), HandPoints(problem)
    rng = np.random.default_rng(0)
    clouds = [samples.cloud(i) for i in range(len(each))]
    drawn = [rng.integers(len(cloud.points), size=DRAWN) for cloud in clouds]
    points = np.stack([c.points[where] for c, where in zip(clouds, drawn, strict=True)], axis=1)
    normals = np.stack([c.normals[where] for c, where in zip(clouds, drawn, strict=True)], axis=1)
    limits = np.array([[row.lower, row.upper, row.scale] for row in rows.named]).reshape(-1, 3)

    def stated(order: list[int]) -> list[list[tuple[float, ...]]]:
        p, n = points[:, order], normals[:, order]
        values = rows.values(p, n, hand_points.start(p, n))
        return [sorted(tuple(np.round([v, *limit], 9)) for v, limit in zip(row, limits, strict=True)) for row in values]

    same = list(range(len(each)))
    before = stated(list(range(len(each))))
    for j in range(len(each)):
        for i in range(j):
            order = list(range(len(each)))
            order[i], order[j] = j, i
            if same[i] == i and each[i] == each[j] and stated(order) == before:
                same[j] = i
                break
    return tuple(same)
