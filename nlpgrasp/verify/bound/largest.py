"""The largest mixed support over one cell, known as closely as a bound needs it."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.verify.bound.cells.cell import Cell, Sheet
from nlpgrasp.verify.bound.supports import Contact


class Largest:
    """The largest ``sum of w s^p`` of a contact anywhere in a cell, between two numbers.

    Parameters
    ----------
    contact : Contact
    cell : Cell
    twists : (j, d) array
    weights : (j,) array
    origin : (space,) array
        Torque origin, metres.

    Attributes
    ----------
    below, above : float
        The largest of contacts met, and what none exceeds.
    """

    def __init__(
        self, contact: Contact, cell: Cell, twists: FloatArray, weights: FloatArray, origin: FloatArray
    ) -> None:
        self._contact, self._twists, self._weights, self._origin = contact, twists, weights, origin
        rows = cell.rows()
        self.below = 0.0
        if len(rows.points):
            flat = contact.powers(rows.points, rows.normals, twists, origin)[0] @ weights
            self.below = float(np.max(flat))
        self._parts: list[tuple[Sheet, FloatArray, FloatArray]] = []
        for sheet in cell.sheets():
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
        points, normals = sheet.contacts(parts.reshape(n * c, q))
        powers, speeds = self._contact.powers(points, normals, self._twists, self._origin)
        self.below = max(self.below, float(np.max(powers @ self._weights)))
        bends = np.repeat(sheet.bends(parts), c, axis=0)
        above = self._contact.above(powers, speeds, bends, self._twists) @ self._weights
        return np.asarray(np.max(above.reshape(n, c), axis=1))
