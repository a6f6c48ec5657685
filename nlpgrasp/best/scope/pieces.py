"""Where one contact, or several alike, may be: cells by number, each cut in two when it is asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from nlpgrasp.best.bound.supports import Supports
from nlpgrasp.best.cells.allowed import Allowed
from nlpgrasp.best.cells.base import Cell, Surface

NONE = -1


class Pieces:
    """Cells of the faces that some contacts may use, numbered in the order in which they are made.

    Parameters
    ----------
    slots : sequence of int
        The contacts.
    roots : mapping of Surface to sequence of Cell
        Cells that cover each face, or what of it is enough.
    allowed : Allowed
    supports : Supports
    turned : str, optional
        Where every placement can be turned so that the contact is on the roots: ``"pole"``, ``"meridian"`` or
        ``"half-plane"``.

    Attributes
    ----------
    parts : dict
        The numbers of both parts of each cell that was cut so far; ``NONE`` of one that constraints exclude.
    """

    def __init__(
        self,
        slots: Sequence[int],
        roots: Mapping[Surface, Sequence[Cell]],
        allowed: Allowed,
        supports: Supports,
        turned: str | None = None,
    ) -> None:
        self.turned, self.parts = turned, dict[int, tuple[int, ...]]()
        self.slots, self.allowed, self.supports = tuple(slots), allowed, supports
        self.cells: list[Cell] = []
        self.radii: list[float] = []
        self.parents: list[int] = []
        self.surfaces: list[Surface] = []
        self._children: dict[int, tuple[int, ...]] = {}
        self.roots = tuple(
            self._add(cell, NONE, surface)
            for surface, cells in roots.items()
            for cell in cells
            if not allowed.excludes(cell)
        )

    def _add(self, cell: Cell, parent: int, surface: Surface) -> int:
        self.cells.append(cell)
        self.radii.append(cell.ball()[1])
        self.parents.append(parent)
        self.surfaces.append(surface)
        self.supports.add(cell)
        return len(self.cells) - 1

    def children(self, cell: int) -> tuple[int, ...]:
        """Return the numbers of the parts of a cell that are not excluded; its own where it is a point."""
        if cell not in self._children:
            parts = self.cells[cell].split()
            if len(parts) == 1:
                self._children[cell] = (cell,)
            else:
                surface, excluded = self.surfaces[cell], [self.allowed.excludes(part) for part in parts]
                made = [NONE if e else self._add(p, cell, surface) for p, e in zip(parts, excluded, strict=True)]
                self.parts[cell] = tuple(made)
                self._children[cell] = tuple(part for part in made if part != NONE)
        return self._children[cell]

    def like(self, cell: int, points: np.ndarray, candidates: Sequence[int], tolerance: float) -> int:
        """Return which candidate has these anchors, in any order, or ``NONE``."""
        for other in candidates:
            anchors = self.cells[other].anchors()
            if len(anchors) == len(points):
                apart = np.max(np.abs(anchors[:, None] - points[None]), axis=2)
                if np.max(apart.min(axis=0)) <= tolerance and np.max(apart.min(axis=1)) <= tolerance:
                    return other
        return NONE
