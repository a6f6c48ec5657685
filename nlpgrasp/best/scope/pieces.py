"""Where one contact, or several alike, may be: cells by number, each cut in two when it is asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from nlpgrasp.best.bound.supports import Supports
from nlpgrasp.best.cells.allowed import Allowed
from nlpgrasp.best.cells.base import Cell, Surface
from nlpgrasp.best.cells.bundle import BundleCell

NONE = -1


class Bundled(IntEnum):
    """Which cells are one to begin with: none, those of each face, or all."""

    NONE = 0
    FACES = 1
    ALL = 2


@dataclass(frozen=True)
class Roots:
    """The cells that contacts begin with.

    Parameters
    ----------
    cells : mapping of Surface to sequence of Cell
        That cover each face, or what of it is enough.
    turned : str, optional
        Where every placement can be turned so that the contact is in them: ``"pole"``, ``"meridian"`` or
        ``"half-plane"``.
    bundled : Bundled
    """

    cells: Mapping[Surface, Sequence[Cell]]
    turned: str | None = None
    bundled: Bundled = Bundled.NONE


class Pieces:
    """Cells of the faces that some contacts may use, numbered in the order in which they are made.

    Parameters
    ----------
    slots : sequence of int
        The contacts.
    roots : Roots
    allowed : Allowed
    supports : Supports
    size : float
        Of the body, metres.

    Attributes
    ----------
    parts : dict
        The numbers of both parts of each cell that was cut so far; ``NONE`` of one that constraints exclude.
    """

    def __init__(self, slots: Sequence[int], roots: Roots, allowed: Allowed, supports: Supports, size: float) -> None:
        self.turned, self.parts = roots.turned, dict[int, tuple[int, ...]]()
        self.slots, self.allowed, self.supports = tuple(slots), allowed, supports
        self.cells: list[Cell] = []
        self.radii: list[float] = []
        self.parents: list[int] = []
        self._children: dict[int, tuple[int, ...]] = {}
        left = [(s, c) for s, cells in roots.cells.items() for c in cells if not allowed.excludes(c)]
        self.roots = tuple(self._add(cell, NONE) for cell in _bundles(left, roots.bundled, size))

    def _add(self, cell: Cell, parent: int) -> int:
        self.cells.append(cell)
        self.radii.append(cell.ball()[1])
        self.parents.append(parent)
        self.supports.add(cell)
        return len(self.cells) - 1

    def children(self, cell: int) -> tuple[int, ...]:
        """Return the numbers of the parts of a cell that are not excluded; its own where it is a point."""
        if cell not in self._children:
            parts = self.cells[cell].split()
            if len(parts) == 1:
                self._children[cell] = (cell,)
            else:
                made = [NONE if self.allowed.excludes(part) else self._add(part, cell) for part in parts]
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


def _bundles(left: Sequence[tuple[Surface, Cell]], bundled: Bundled, size: float) -> list[Cell]:
    """Return the cells with their faces, or bundles of them."""
    if bundled is Bundled.NONE:
        return [cell for _, cell in left]
    together: dict[Surface | None, list[Cell]] = {}
    for surface, cell in left:
        together.setdefault(surface if bundled is Bundled.FACES else None, []).append(cell)
    return [cells[0] if len(cells) == 1 else BundleCell(cells, size) for cells in together.values()]
