"""Ranking of contact-type assignments by certified quality and cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.shown.numbers import at_least, at_most
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import integer, number
from nlpgrasp.errors import InputError
from nlpgrasp.quality import Bounds
from nlpgrasp.solution.solution import GraspSolution


@dataclass(frozen=True)
class TypeAssignment:
    """An assignment of contact types, with the best known grasp.

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
        """Certified quality of the grasp; [0, 0] without one."""
        return self.solution.mu if self.solution.success else Bounds(0.0, 0.0)

    def count(self, name: str) -> int:
        """Return the number of contacts of a type."""
        return self.types.count(name)

    def to_dict(self) -> Json:
        """Return the assignment as JSON data, without the solution itself."""
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
class Upgrade:
    """Gain of an assignment over the next smaller one.

    Parameters
    ----------
    before, after : TypeAssignment
        The types of the second dominate those of the first.
    """

    before: TypeAssignment
    after: TypeAssignment

    @property
    def gain(self) -> Bounds:
        """Certified rise of mu between the grasps; at least 0, as the first grasp is feasible for the second types."""
        low, high = self.before.mu, self.after.mu
        return Bounds(max(low_end(high, low), 0.0), max(high.upper - low.lower, 0.0))

    @property
    def certain(self) -> bool:
        """Whether the intervals are disjoint, so that the rise is certain."""
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
            return f"{text}: not told apart, at most +{at_most(self.gain.upper, 4)}"
        return f"{text}: +{at_least(self.gain.lower, 4)} to +{at_most(self.gain.upper, 4)}"


def low_end(high: Bounds, low: Bounds) -> float:
    """Return the least excess of the first interval over the second."""
    return high.lower - low.upper


@dataclass(frozen=True)
class TypeChoice:
    """Ranked assignments of contact types.

    Parameters
    ----------
    name : str
        The problem's.
    assignments : tuple of TypeAssignment
        Largest certified lower bound first; of equals the richer one.
    upgrades : tuple of Upgrade
        Gains between neighbours: no third assignment is between the two.
    """

    name: str
    assignments: tuple[TypeAssignment, ...]
    upgrades: tuple[Upgrade, ...] = ()

    def best(
        self, *, at_most: Mapping[str, int] | None = None, spend: float | None = None, price: float = 0.0
    ) -> TypeAssignment | None:
        """Return the best assignment within limits, mu at its lower bound; the cheapest among equals; None without any.

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
        most = {name: integer(f"at_most[{name!r}]", n, at_least=0) for name, n in limits.items()}
        limit = np.inf if spend is None else number("spend", spend, at_least=0.0)
        each = number("price", price, at_least=0.0)
        within = [
            a
            for a in self.assignments
            if a.solution.success and a.cost <= limit and all(a.count(name) <= n for name, n in most.items())
        ]
        return max(within, key=lambda a: (a.mu.lower - each * a.cost, -a.cost), default=None)

    def not_told_apart(self, assignment: TypeAssignment) -> tuple[TypeAssignment, ...]:
        """Return the other assignments whose certified intervals overlap this one's."""
        one = assignment.mu
        others = (a for a in self.assignments if a is not assignment)
        return tuple(a for a in others if a.mu.lower <= one.upper and one.lower <= a.mu.upper)

    @property
    def frontier(self) -> tuple[TypeAssignment, ...]:
        """Pareto frontier: assignments whose mu, at its lower bound, no other one of at most their cost reaches."""
        found: list[TypeAssignment] = []
        for a in sorted(self.assignments, key=lambda a: (a.cost, -a.mu.lower)):
            if a.solution.success and (not found or a.mu.lower > found[-1].mu.lower):
                found.append(a)
        return tuple(found)

    def to_dict(self) -> Json:
        """Return the ranking as JSON data."""
        return {
            "name": self.name,
            "assignments": [a.to_dict() for a in self.assignments],
            "upgrades": [u.to_dict() for u in self.upgrades],
        }

    def __str__(self) -> str:
        width = max(len(str(a)) for a in self.assignments)
        lines = [f"{self.name}: {len(self.assignments)} assignments of contact types, the best known grasp of each"]
        for a in self.assignments:
            bounds = f"{a.solution.label} in {a.mu}" if a.solution.success else "no grasp found"
            same = len(self.not_told_apart(a)) if a.solution.success else 0
            note = f", not told apart from {same} other{'s' * (same > 1)}" if same else ""
            lines.append(f"  {a!s:{width}}  cost {a.cost:g}  {bounds}{note}")
        return "\n".join([*lines, *(f"  {u}" for u in self.upgrades)])
