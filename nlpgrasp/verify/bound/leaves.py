"""Recomputation of a certificate's leaf bounds from cells and dual weights of directions.

For weights w >= 0 of directions y, a grasp of the quality mu has ``mu^p sum w phi_A(y)^p <= sum w phi_G(y)^p``, and
``phi_G(y)^p <= sum of s_i(y)^p`` over its contacts. So mu^p is at most the sum over the contacts' cells of
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

MARGIN = 1e-9  # relative guard against rounding, added to every bound
MATTERS = 0.5  # share of the largest leaf bound below which leaves are not resolved further
ROUNDS, MOST_PARTS = 8, 20_000  # subdivision rounds of curved cells, and most parts of a leaf
PART = 4000  # mesh corners in a batch


class Leaves:
    """The leaves of a certificate, with the data of their bounds.

    Parameters
    ----------
    data : mapping
        ``origin``, ``directions``; ``mixtures``: numbers of directions and their dual weights; ``leaves``: cells by
        slot, the number of a mixture, and the stated bound.
    groups : sequence of Group
    contacts : sequence of mapping
        Contacts of the problem, by number.
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
        """Return the claimed and the recomputed bounds of the leaves, (n,) each.

        The claim of a leaf far below the largest is raised to a share of that, which suffices. Over curved cells,
        bounds are refined only until they are not above the claimed ones.
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
        """Return the bounds of nodes by one set of dual weights, refined until they meet the claims."""
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
        """Return the dual weights (j,) and directions (j, d) of a mixture, and their ``sum w phi_A(y)^p``."""
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
        """Return the largest weighted power over each cell, by group number and cell number."""
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
    """The weighted power ``sum of w s^p`` of one contact, s its support along each direction.

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
        """Return the largest weighted power over vertex contacts; 0 without any."""
        if not len(rows.points):
            return 0.0
        return float(np.max(self.contact.powers(rows.points, rows.normals, self.twists, self.origin)[0] @ self.weights))


class Largest:
    """Lower and upper bounds on the largest weighted power of a contact in a cell.

    Parameters
    ----------
    mixed : Mixed
    below : float
        The largest over the vertex contacts of the cell.
    sheets : sequence of Sheet
        Curved parts of the cell.

    Attributes
    ----------
    below, above : float
        Largest value over evaluated contacts, and an upper bound for all contacts.
    """

    def __init__(self, mixed: Mixed, below: float, sheets: Sequence[Sheet]) -> None:
        self._mixed, self.below = mixed, below
        self._parts: list[tuple[Sheet, FloatArray, FloatArray]] = []
        for sheet in sheets:
            parts = sheet.start()
            self._parts.append((sheet, parts, self._bounds(sheet, parts)))

    @property
    def above(self) -> float:
        """Upper bound over all contacts of the cell."""
        return max([self.below, *(float(np.max(bounds)) for _, _, bounds in self._parts)])

    @property
    def count(self) -> int:
        """Number of parts."""
        return sum(len(bounds) for _, _, bounds in self._parts)

    def narrow(self, enough: float, room: float) -> None:
        """Subdivide the parts whose upper bound exceeds the lower one by too much.

        Parameters
        ----------
        enough, room : float
            Allowed relative and absolute excess.
        """
        for i, (sheet, parts, bounds) in enumerate(self._parts):
            large = bounds > (1.0 + enough) * self.below + room
            if np.any(large):
                small = sheet.halved(parts[large])
                new = np.concatenate([bounds[~large], self._bounds(sheet, small)])
                self._parts[i] = (sheet, np.concatenate([parts[~large], small]), new)

    def _bounds(self, sheet: Sheet, parts: FloatArray) -> FloatArray:
        """Return an upper bound for the contacts in each part (n, c, q), (n,)."""
        n, c, q = parts.shape
        contact, twists, weights = self._mixed.contact, self._mixed.twists, self._mixed.weights
        points, normals = sheet.contacts(parts.reshape(n * c, q))
        powers, speeds = contact.powers(points, normals, twists, self._mixed.origin)
        self.below = max(self.below, float(np.max(powers @ weights)))
        bends = np.repeat(sheet.bends(parts), c, axis=0)
        above = contact.above(powers, speeds, bends, twists) @ weights
        return np.asarray(np.max(above.reshape(n, c), axis=1))


def _total(largest: Sequence[Largest], asked: float, add: Callable[[Iterable[float]], float]) -> float:
    """Return an upper bound for a node's contacts together, refined until the requested bound is shown or disproved.

    Parameters
    ----------
    largest : sequence of Largest
        Bounds of each contact's cell.
    asked : float
        The requested bound.
    add : callable
        Aggregation over contacts: sum or maximum.
    """
    once = list(dict.fromkeys(largest))
    for _ in range(ROUNDS):
        met = add(part.below for part in largest)
        done = met > asked or add(part.above for part in largest) <= asked  # disproved, or shown
        if done or sum(part.count for part in once) > MOST_PARTS:
            break
        for part in once:  # half of the slack by shares, half equally
            part.narrow(0.5 * (asked / met - 1.0) if met > 0.0 else 0.0, 0.5 * (asked - met) / len(largest))
    return add(part.above for part in largest)


def _over_mesh(cells: dict[int, MeshCell], mixed: Mixed) -> dict[int, float]:
    """Return the largest weighted power over cells of one mesh, from disjoint ranges of its pieces."""
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
