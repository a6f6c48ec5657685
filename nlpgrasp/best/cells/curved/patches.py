"""Small parts of a curved face, in coordinates of its own: what a contact does between their corners."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray


class Patches(Protocol):
    """A curved face whose parts have corners (c, q): c coordinates of q numbers."""

    def contacts(self, coordinates: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points, metres, and inward unit normals at coordinates (m, q), (m, 3) each."""

    def bends(self, parts: FloatArray) -> FloatArray:
        """Return two sets of weights for each part (n, c, q), (n, 2, 3).

        Weights are of ``|v|``, ``|tau|`` and, for a contact with a moment about its normal, of ``|tau|`` once more;
        ``v = f + tau x (p - o)`` is the twist's velocity at any corner. With the first set, the most that the work z of
        a contact in the part is off a linear interpolation of its corners'; with the second, the most that it differs
        from a corner's.
        """

    def finer(self, parts: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
        """Return smaller parts that together are each part (n, c, q): their corners (n, v, q), and which, (r, c)."""


@dataclass(frozen=True)
class Curved:
    """The small parts of a cell on a curved face.

    Parameters
    ----------
    patches : Patches
        Of the face.
    parts : (n, c, q) array
        Coordinates of each part's corners; together they are the cell.
    rows : (n, c) array of int
        Which of the cell's rows is at each corner.
    """

    patches: Patches
    parts: FloatArray
    rows: NDArray[np.int64]
