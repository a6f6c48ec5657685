"""The bound of every leaf, computed again from cells, directions and weights.

For weights w >= 0 of directions y, a grasp of the quality mu has ``mu^p sum w phi_A(y)^p <= sum w phi_G(y)^p``, and
``phi_G(y)^p <= sum of s_i(y)^p`` over its contacts. So mu^p is at most the sum over the cells of
``max over the cell of sum w s^p``, divided by ``sum w phi_A(y)^p``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.tasks import Task
from nlpgrasp.verify.bound.largest import Largest
from nlpgrasp.verify.bound.supports import Budget, Contact
from nlpgrasp.verify.bound.tree import Group

MARGIN = 1e-9  # relative: what rounding may take from a bound, added to every one
MATTERS = 0.5  # of the largest bound of a leaf
ROUNDS, MOST_PARTS = 8, 20_000  # of smaller parts of curved cells, and those of a leaf at most


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
        self._models = [Contact.of(contacts[group.contacts[0]], budget) for group in groups]
        self._groups, self._slots = groups, [i for i, group in enumerate(groups) for _ in group.contacts]

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the bounds that are claimed of leaves and those computed again, (n,) each.

        A leaf far below the largest is claimed to be below a share of that only: it does not matter more closely. Over
        curved cells bounds are computed as closely as it takes to see that they are not above the claimed ones.
        """
        stated = np.array([float(leaf[3]) for leaf in self.leaves])
        claimed = np.maximum(stated, MATTERS * np.max(stated, initial=0.0))
        every = zip(self.leaves, claimed.tolist(), strict=True)
        return claimed, np.array([self._bound(cells, numbers, w, own) for (cells, numbers, w, *_), own in every])

    def _bound(self, cells: Sequence[int], numbers: Sequence[int], weights: Sequence[float], claimed: float) -> float:
        w, twists, whole = self._mixture(numbers, weights)
        slots = list(zip(self._slots, cells, strict=True))
        parts = {
            (i, cell): Largest(self._models[i], self._groups[i].cells[cell], twists, w, self.origin)
            for i, cell in set(slots)
        }
        add = max if self.budget.shared and len(w) == 1 else sum
        asked = (claimed / (1.0 + MARGIN)) ** self.budget.power * whole
        for _ in range(ROUNDS):
            met = add(parts[slot].below for slot in slots)
            done = met > asked or add(parts[slot].above for slot in slots) <= asked  # disproved, or shown
            if done or sum(part.count for part in parts.values()) > MOST_PARTS:
                break
            for part in parts.values():  # half of what there is above the contacts met by their shares, half for each
                part.narrow(0.5 * (asked / met - 1.0) if met > 0.0 else 0.0, 0.5 * (asked - met) / len(slots))
        total = add(parts[slot].above for slot in slots)
        return float((total / whole) ** (1.0 / self.budget.power)) * (1.0 + MARGIN)

    def _mixture(self, numbers: Sequence[int], weights: Sequence[float]) -> tuple[FloatArray, FloatArray, float]:
        """Return weights (j,) and directions (j, d) that are stated, and ``sum w phi_A(y)^p`` of them."""
        w, chosen = array("weights", weights, (len(numbers),)), np.array(numbers, dtype=np.int64)
        if not (np.all(w > 0.0) and len(w) and np.all(chosen >= 0)):
            raise ValueError(f"weights {weights} of directions {numbers}")
        return w, self.twists[chosen], float(w @ self.reach[chosen] ** self.budget.power)
