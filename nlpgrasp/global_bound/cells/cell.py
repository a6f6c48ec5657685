"""Interfaces of cells, of faces made of cells, and of the small parts of curved cells."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray

IntArray = NDArray[np.int64]


class CurvedFace(Protocol):
    """Interface of a curved face whose parts have corners (c, q): c coordinates of q numbers."""

    def contacts(self, coordinates: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points, metres, and inward unit normals at coordinates (m, q), (m, 3) each."""

    def bends(self, parts: FloatArray) -> FloatArray:
        """Return two sets of weights for each part (n, c, q), (n, 2, 3).

        Weights are of ``|v|``, ``|tau|`` and, for a contact with a moment about its normal, of ``|tau|`` once more;
        ``v = f + tau x (p - o)`` is the twist's velocity at any corner. With the first set, the most that the work z of
        a contact in the part is off a linear interpolation of its corners'; with the second, the most that it differs
        from a corner's.
        """

    def subdivide(self, parts: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
        """Return smaller parts that together are each part (n, c, q): their corners (n, v, q), and which, (r, c)."""


@dataclass(frozen=True)
class SmallCurvedParts:
    """Small parts of a cell on a curved face.

    Parameters
    ----------
    patches : CurvedFace
        Of the face.
    parts : (n, c, q) array
        Coordinates of each part's corners; together they are the cell.
    rows : (n, c) array of int
        Which of the cell's rows is at each corner.
    """

    patches: CurvedFace
    parts: FloatArray
    rows: NDArray[np.int64]


@dataclass(frozen=True)
class RepresentativeContacts:
    """Representative contacts of a cell: bounds on all of them bound the cell.

    Parameters
    ----------
    points, normals : (m, space) array
        Metres, and unit, into the body; body frame.
    curved : tuple of SmallCurvedParts
        What lies between those rows that are on curved faces: small parts with the rows at their corners.
    """

    points: FloatArray
    normals: FloatArray
    curved: tuple[SmallCurvedParts, ...] = ()


Cut = int | list[list[int]]
"""Which side, interval or direction a cell is cut across; of a union its parts, as numbers of members."""


class SurfaceCell(ABC):
    """Interface of a cell: a piece of a face.

    A convex function of the work z of a contact anywhere in the cell is at most its largest value over the rows plus,
    where the cell is curved, what its parts' bends allow for (docs/how_close.md).
    """

    kind: ClassVar[str]

    @abstractmethod
    def rows(self) -> RepresentativeContacts:
        """Return the representative contacts of the cell."""

    @abstractmethod
    def split(self) -> tuple[SurfaceCell, ...]:
        """Return two cells that cover this one; itself alone where it is a point."""

    @abstractmethod
    def cut(self) -> Cut:
        """Return how ``split`` divides the cell, for a certificate; the meaning depends on the kind of cell."""

    @abstractmethod
    def ball(self) -> tuple[FloatArray, float]:
        """Return centre (space,) and radius, metres, of a ball around the cell."""

    @abstractmethod
    def anchors(self) -> FloatArray:
        """Return points (m, space), metres, that identify the cell among all others of the body."""

    @abstractmethod
    def to_dict(self) -> Json:
        """Return ``kind`` and the numbers that determine the rows."""

    def whole_data(self) -> Json:
        """Return the data of a cell of which no part is needed."""
        return self.to_dict()


class CellFace(ABC):
    """Interface of a body's face as a union of cells.

    Parameters
    ----------
    name : str
        Of the body's face.
    """

    def __init__(self, name: str) -> None:
        self.name = name

    @abstractmethod
    def cells(self) -> Sequence[SurfaceCell]:
        """Return cells that cover the face."""
