"""Bounds of a certificate's leaves, computed again from cells and mixtures of directions.

For weights w >= 0 of directions y, a grasp of the quality mu has ``mu^p sum w phi_A(y)^p <= sum w phi_G(y)^p``, and
``phi_G(y)^p <= sum of s_i(y)^p`` over its contacts. So mu^p is at most the sum over the cells of
``max over the cell of sum w s^p``, divided by ``sum w phi_A(y)^p``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.tasks import Task
from nlpgrasp.verify.bound.cells.cell import Rows, Sheet
from nlpgrasp.verify.bound.cells.mesh import MeshCell
from nlpgrasp.verify.bound.node_cover import Group
from nlpgrasp.verify.bound.supports import Budget, Contact

MARGIN = 1e-9  # relative: what rounding may take from a bound, added to every one
MATTERS = 0.5  # of the largest bound of a leaf
ROUNDS, MOST_PARTS = 8, 20_000  # of smaller parts of curved cells, and those of a leaf at most
PART = 4000  # corners of a mesh at a time


class Leaves:
    """The leaves of a certificate, with what their bounds are computed from.

    Parameters
    ----------
    data : mapping
        ``origin``, ``directions``; ``mixtures``: numbers of directions and their weights; ``leaves``: cells by slot,
        the number of a mixture, and the bound stated.
    groups : sequence of Group
    contacts : sequence of mapping
        The problem's, by number.
    task : Task
    budget : Budget
    """

    def __init__(
        self, data: Json, groups: Sequence[Group], contacts: Sequence[Json], task: Task, budget: Budget
    ) -> None:
        self.leaves, self.budget, self._mixtures = data["leaves"], budget, data["mixtures"]
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
        stated = np.array([float(bound) for _, _, bound in self.leaves])
        claimed = np.maximum(stated, MATTERS * np.max(stated, initial=0.0))
        by_mixture: dict[int, list[int]] = {}
        for i, (_, mixture, _) in enumerate(self.leaves):
            by_mixture.setdefault(int(mixture), []).append(i)
        found = np.empty(len(self.leaves))
        for mixture, own in by_mixture.items():
            found[own] = self._under(mixture, [self.leaves[i][0] for i in own], claimed[own].tolist())
        return claimed, found

    def _under(self, mixture: int, nodes: Sequence[Sequence[int]], claimed: Sequence[float]) -> list[float]:
        """Return the bounds that a mixture gives for nodes, as closely as is claimed."""
        w, twists, whole = self._mixture(mixture)
        add = max if self.budget.shared and len(w) == 1 else sum
        slots = [list(zip(self._slots, node, strict=True)) for node in nodes]
        largest = self._largest({slot for own in slots for slot in own}, twists, w)
        found = []
        for own, claim in zip(slots, claimed, strict=True):
            asked = (claim / (1.0 + MARGIN)) ** self.budget.power * whole
            total = _total([largest[slot] for slot in own], asked, add)
            found.append(float((total / whole) ** (1.0 / self.budget.power)) * (1.0 + MARGIN))
        return found

    def _mixture(self, number: int) -> tuple[FloatArray, FloatArray, float]:
        """Return the weights (j,) and directions (j, d) of a mixture, and ``sum w phi_A(y)^p`` of them."""
        if not 0 <= number < len(self._mixtures):
            raise ValueError(f"mixture {number} of {len(self._mixtures)}")
        numbers, weights = self._mixtures[number]
        w, chosen = array("weights", weights, (len(numbers),)), np.array(numbers, dtype=np.int64)
        if not (np.all(w > 0.0) and len(w) and np.all(chosen >= 0)):
            raise ValueError(f"weights {weights} of directions {numbers}")
        return w, self.twists[chosen], float(w @ self.reach[chosen] ** self.budget.power)

    def _largest(
        self, cells: set[tuple[int, int]], twists: FloatArray, weights: FloatArray
    ) -> dict[tuple[int, int], Largest]:
        """Return the largest mixed power over cells, each by the number of its group and its own."""
        found: dict[tuple[int, int], Largest] = {}
        for i, (group, contact) in enumerate(zip(self._groups, self._models, strict=True)):
            own = {number: group.cells[number] for where, number in cells if where == i}
            mix = Mixed(contact, twists, weights, self.origin)
            known = _over_mesh({n: cell for n, cell in own.items() if isinstance(cell, MeshCell)}, mix)
            for number, cell in own.items():
                below = known[number] if number in known else mix.most(cell.rows())
                found[i, number] = Largest(mix, below, cell.sheets())
        return found


@dataclass(frozen=True)
class Mixed:
    """The mixed powers ``sum of w s^p`` of one contact.

    Parameters
    ----------
    contact : Contact
    twists : (j, d) array
    weights : (j,) array
    origin : (space,) array
        Torque origin, metres.
    """

    contact: Contact
    twists: FloatArray
    weights: FloatArray
    origin: FloatArray

    def most(self, rows: Rows) -> float:
        """Return the largest over rows; 0 where there are none."""
        if not len(rows.points):
            return 0.0
        return float(np.max(self.contact.powers(rows.points, rows.normals, self.twists, self.origin)[0] @ self.weights))


class Largest:
    """The largest mixed power of a contact anywhere in a cell, between two numbers.

    Parameters
    ----------
    mixed : Mixed
    below : float
        The largest over the rows of the cell.
    sheets : sequence of Sheet
        What is curved of it.

    Attributes
    ----------
    below, above : float
        The largest of contacts met, and what none exceeds.
    """

    def __init__(self, mixed: Mixed, below: float, sheets: Sequence[Sheet]) -> None:
        self._mixed, self.below = mixed, below
        self._parts: list[tuple[Sheet, FloatArray, FloatArray]] = []
        for sheet in sheets:
            parts = sheet.start()
            self._parts.append((sheet, parts, self._bounds(sheet, parts)))

    @property
    def above(self) -> float:
        """What no contact of the cell exceeds."""
        return max([self.below, *(float(np.max(bounds)) for _, _, bounds in self._parts)])

    @property
    def count(self) -> int:
        """How many parts there are."""
        return sum(len(bounds) for _, _, bounds in self._parts)

    def narrow(self, enough: float, room: float) -> None:
        """Look at smaller parts in place of those that might exceed the largest met by too much.

        Parameters
        ----------
        enough, room : float
            Good enough is this relative share more, and this much.
        """
        for i, (sheet, parts, bounds) in enumerate(self._parts):
            large = bounds > (1.0 + enough) * self.below + room
            if np.any(large):
                small = sheet.halved(parts[large])
                new = np.concatenate([bounds[~large], self._bounds(sheet, small)])
                self._parts[i] = (sheet, np.concatenate([parts[~large], small]), new)

    def _bounds(self, sheet: Sheet, parts: FloatArray) -> FloatArray:
        """Return what no contact in each part (n, c, q) exceeds, (n,)."""
        n, c, q = parts.shape
        contact, twists, weights = self._mixed.contact, self._mixed.twists, self._mixed.weights
        points, normals = sheet.contacts(parts.reshape(n * c, q))
        powers, speeds = contact.powers(points, normals, twists, self._mixed.origin)
        self.below = max(self.below, float(np.max(powers @ weights)))
        bends = np.repeat(sheet.bends(parts), c, axis=0)
        above = contact.above(powers, speeds, bends, twists) @ weights
        return np.asarray(np.max(above.reshape(n, c), axis=1))


def _total(largest: Sequence[Largest], asked: float, add: Callable[[Iterable[float]], float]) -> float:
    """Return what no contacts of one node exceed together, as closely as it takes to see whether that is what is asked.

    Parameters
    ----------
    largest : sequence of Largest
        Of each contact's cell.
    asked : float
    add : callable
        How contacts add up.
    """
    once = list(dict.fromkeys(largest))
    for _ in range(ROUNDS):
        met = add(part.below for part in largest)
        done = met > asked or add(part.above for part in largest) <= asked  # disproved, or shown
        if done or sum(part.count for part in once) > MOST_PARTS:
            break
        for part in once:  # half of what there is above the contacts met by their shares, half for each
            part.narrow(0.5 * (asked / met - 1.0) if met > 0.0 else 0.0, 0.5 * (asked - met) / len(largest))
    return add(part.above for part in largest)


def _over_mesh(cells: dict[int, MeshCell], mixed: Mixed) -> dict[int, float]:
    """Return the largest mixed power over cells of one mesh, from those over ranges between all their ends."""
    if not cells:
        return {}
    whole = next(iter(cells.values()))
    ends = np.unique([end for cell in cells.values() for end in (cell.first, cell.last)])
    over = np.full(len(ends) - 1, -np.inf)
    for i, (first, last) in enumerate(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)):
        if any(cell.first <= first and last <= cell.last for cell in cells.values()):
            for low in range(first, last, PART // 3):
                part = MeshCell(whole.data, whole.corners, whole.normals, low, min(last, low + PART // 3))
                over[i] = max(over[i], mixed.most(part.rows()))
    places = {number: np.searchsorted(ends, (cell.first, cell.last)) for number, cell in cells.items()}
    return {number: float(np.max(over[low:high])) for number, (low, high) in places.items()}
