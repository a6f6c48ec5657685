"""The bound of every leaf, computed again from cells, directions and weights.

For weights w >= 0 of directions y, a grasp of the quality mu has ``mu^p sum w phi_A(y)^p <= sum w phi_G(y)^p``, and
``phi_G(y)^p <= sum of s_i(y)^p`` over its contacts. So mu^p is at most the sum over the cells of
``max over rows of sum w s^p``, divided by ``sum w phi_A(y)^p``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.tasks import Task
from nlpgrasp.verify.bound.cells.cell import Rows
from nlpgrasp.verify.bound.supports import Budget, Contact
from nlpgrasp.verify.bound.tree import Group

MARGIN = 1e-9  # relative: what rounding may take from a bound, added to every one


class Leaves:
    """What the bounds of leaves are computed from.

    Parameters
    ----------
    data : mapping
        ``origin``, ``directions``, ``leaves``: cells by slot, numbers of directions, weights, and the bound stated.
    groups : sequence of Group
    contacts : sequence of mapping
        The problem's, by number.
    task : Task
    budget : Budget
    """

    def __init__(
        self, data: Json, groups: Sequence[Group], contacts: Sequence[Json], task: Task, budget: Budget
    ) -> None:
        self.leaves, self.budget = data["leaves"], budget
        self.twists = array("directions", data["directions"], (None, task.dimension))
        self.reach = task.support(self.twists)[0]
        self.origin = array("origin", data["origin"], (2 if task.dimension == 3 else 3,))
        models = [Contact.of(contacts[group.contacts[0]], budget) for group in groups]
        self._slots = [(i, group) for i, group in enumerate(groups) for _ in group.contacts]
        self._models, self._rows = models, dict[tuple[int, int], Rows]()

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the bounds that are stated and those computed again, (n,) each."""
        stated = [float(leaf[3]) for leaf in self.leaves]
        return np.array(stated), np.array([self._bound(*leaf[:3]) for leaf in self.leaves])

    def _bound(self, cells: Sequence[int], numbers: Sequence[int], weights: Sequence[float]) -> float:
        w, chosen = array("weights", weights, (len(numbers),)), np.array(numbers, dtype=np.int64)
        if not (np.all(w > 0.0) and len(w) and np.all(chosen >= 0)):
            raise ValueError(f"weights {weights} of directions {numbers}")
        reach, twists, p = self.reach[chosen], self.twists[chosen], self.budget.power
        parts: dict[tuple[int, int], float] = {}
        for (i, group), cell in zip(self._slots, cells, strict=True):
            if (i, cell) not in parts:
                powers = self._models[i].powers(self._of(i, group, cell), twists, self.origin)
                parts[i, cell] = float(np.max(powers @ w))
        every = [parts[i, cell] for (i, _), cell in zip(self._slots, cells, strict=True)]
        whole = float(w @ reach**p)
        total = max(every) if self.budget.shared and len(w) == 1 else sum(every)
        return float((total / whole) ** (1.0 / p)) * (1.0 + MARGIN)

    def _of(self, number: int, group: Group, cell: int) -> Rows:
        if (number, cell) not in self._rows:
            self._rows[number, cell] = group.cells[cell].rows()
        return self._rows[number, cell]
