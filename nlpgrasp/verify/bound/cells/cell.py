"""Interface of a certificate's cells: contacts that stand for one, its parts, and where it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray

Cut = int | list[list[int]]


@dataclass(frozen=True)
class Rows:
    """Contacts that stand for the flat part of a cell.

    Parameters
    ----------
    points, normals : (m, space) array
        Metres, and unit, into the body; body frame.
    """

    points: FloatArray
    normals: FloatArray

    @classmethod
    def flat(cls, points: FloatArray, normal: FloatArray) -> Rows:
        """Return rows of one normal, between which the work is linear."""
        return cls(points, np.tile(normal, (len(points), 1)))

    @classmethod
    def none(cls) -> Rows:
        """Return no rows: of a cell that is curved all over."""
        return cls(np.zeros((0, 3)), np.zeros((0, 3)))


class Sheet(Protocol):
    """A curved face in coordinates; its parts have corners (n, c, q)."""

    def start(self) -> FloatArray:
        """Return parts that together are the cell's share of the face."""

    def contacts(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points, metres, and inward unit normals at coordinates (m, q), (m, 3) each."""

    def bends(self, parts: FloatArray) -> FloatArray:
        """Return weights of ``|v|``, ``|tau|`` and, for contacts with a moment about the normal, ``|tau|`` again.

        (n, 2, 3): how far the work of a contact in each part may be off a linear interpolation of its corners', and
        off any corner's.
        """

    def halved(self, parts: FloatArray) -> FloatArray:
        """Return r smaller parts in place of each, (n r, c, q), all of one part after another."""


class Cell(Protocol):
    """A piece of a face."""

    @property
    def data(self) -> Json:
        """The cell as JSON data."""

    def rows(self) -> Rows:
        """Return the contacts that stand for what is flat of the cell."""

    def sheets(self) -> list[Sheet]:
        """Return what is curved of the cell."""

    def parts(self, cut: Cut) -> tuple[Cell, Cell]:
        """Return the two parts that a cut leaves, which cover the cell; raise ``ValueError`` on another cut."""

    def hull(self) -> tuple[FloatArray, float]:
        """Return points (m, space) and a radius: the cell is within the radius of their convex hull, metres."""

    def anchors(self) -> FloatArray:
        """Return points (m, space) that tell the cell from all others of its kind, metres."""


def ball(cell: Cell) -> tuple[FloatArray, float]:
    """Return centre (space,) and radius, metres, of a ball around a cell."""
    points, beyond = cell.hull()
    middle = points.mean(axis=0)
    return middle, beyond + float(np.max(np.linalg.norm(points - middle, axis=1)))


def halves(interval: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the lower and the upper half of an interval (2,)."""
    low, high = interval.tolist()
    return np.array([low, 0.5 * (low + high)]), np.array([0.5 * (low + high), high])


def one_of(cut: Cut, count: int) -> int:
    """Return the number that a cut states, from 0 to below a count."""
    if not isinstance(cut, int) or isinstance(cut, bool) or not 0 <= cut < count:
        raise ValueError(f"cut {cut!r}, expected a number from 0 to {count - 1}")
    return cut


def increasing(name: str, interval: FloatArray, widest: float = np.inf) -> FloatArray:
    """Return an interval (2,); refuse one that is reversed, or too wide for the rows that stand for it."""
    if not 0.0 <= interval[1] - interval[0] <= widest:
        raise ValueError(f"{name} from {interval[0]:g} to {interval[1]:g}")
    return interval
