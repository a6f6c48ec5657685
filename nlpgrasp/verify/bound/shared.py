"""The bounds of leaves that name mixtures by number: each mixture is computed over the whole mesh, a part at a time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.tasks import Task
from nlpgrasp.verify.bound.cells.mesh import MeshCell
from nlpgrasp.verify.bound.leaves import MARGIN, Leaves
from nlpgrasp.verify.bound.supports import Budget
from nlpgrasp.verify.bound.tree import Group

PART = 4000  # corners at a time


class SharedLeaves(Leaves):
    """What the bounds of a mesh's leaves are computed from.

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
        super().__init__(data, groups, contacts, task, budget)
        self._mixtures = data["mixtures"]

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the bounds that are stated and those computed again, (n,) each."""
        by_mixture: dict[int, list[int]] = {}
        for i, (_, mixture, _) in enumerate(self.leaves):
            by_mixture.setdefault(int(mixture), []).append(i)
        found = np.empty(len(self.leaves))
        for mixture, own in by_mixture.items():
            found[own] = self._under(mixture, [self.leaves[i][0] for i in own])
        return np.array([float(leaf[2]) for leaf in self.leaves]), found

    def _under(self, mixture: int, nodes: Sequence[Sequence[int]]) -> FloatArray:
        """Return the bounds that a mixture gives for some nodes."""
        if not 0 <= mixture < len(self._mixtures):
            raise ValueError(f"mixture {mixture} of {len(self._mixtures)}")
        w, twists, reach = self._mixture(*self._mixtures[mixture])
        largest: list[dict[int, float]] = []
        for i, group in enumerate(self._groups):
            cells = {cell for node in nodes for slot, cell in zip(self._slots, node, strict=True) if slot == i}
            largest.append(self._largest(i, {c: _mesh_cell(group, c) for c in cells}, twists, w))
        totals = [sum(largest[i][cell] for i, cell in zip(self._slots, node, strict=True)) for node in nodes]
        return np.asarray((np.array(totals) / reach) ** (1.0 / self.budget.power) * (1.0 + MARGIN))

    def _largest(
        self, group: int, cells: dict[int, MeshCell], twists: FloatArray, weights: FloatArray
    ) -> dict[int, float]:
        """Return the largest mixed power over each cell, from those over ranges between all their ends."""
        whole = next(iter(cells.values()))
        ends = np.unique([end for cell in cells.values() for end in (cell.first, cell.last)])
        over = np.full(len(ends) - 1, -np.inf)
        for i, (first, last) in enumerate(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)):
            if any(cell.first <= first and last <= cell.last for cell in cells.values()):
                for low in range(first, last, PART // 3):
                    high = min(last, low + PART // 3)
                    over[i] = max(over[i], self._most(group, whole, (low, high), twists, weights))
        places = {number: np.searchsorted(ends, (cell.first, cell.last)) for number, cell in cells.items()}
        return {number: float(np.max(over[low:high])) for number, (low, high) in places.items()}

    def _most(
        self, group: int, whole: MeshCell, pieces: tuple[int, int], twists: FloatArray, weights: FloatArray
    ) -> float:
        """Return the largest mixed power of a contact at the corners of some pieces."""
        part = MeshCell(whole.data, whole.corners, whole.normals, *pieces).rows()
        powers, _ = self._models[group].powers(part.points, part.normals, twists, self.origin)
        return float(np.max(powers @ weights))


def _mesh_cell(group: Group, number: int) -> MeshCell:
    cell = group.cells[number]
    if not isinstance(cell, MeshCell):
        raise ValueError(f"cell {number} is not of a mesh")
    return cell
