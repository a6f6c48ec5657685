"""Interface of a certificate's cells: vertex contacts, curved parts, subdivision and bounding hull."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray

Cut = int | list[list[int]]


@dataclass(frozen=True)
class Rows:
    """Vertex contacts that represent the flat part of a cell.

    Parameters
    ----------
    points, normals : (m, space) array
        Points, metres, and unit inward normals; body frame.
    """

    points: FloatArray
    normals: FloatArray

    @classmethod
    def flat(cls, points: FloatArray, normal: FloatArray) -> Rows:
        """Return vertex contacts with one normal, between which the work is linear."""
        return cls(points, np.tile(normal, (len(points), 1)))

    @classmethod
    def none(cls) -> Rows:
        """Return no vertex contacts, for a cell without a flat part."""
        return cls(np.zeros((0, 3)), np.zeros((0, 3)))


class Sheet(Protocol):
    """A parametrised curved face; its parts have corners (n, c, q)."""

    def start(self) -> FloatArray:
        """Return the initial parts, which together are the cell's part of the face."""

    def contacts(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points, metres, and inward unit normals at coordinates (m, q), (m, 3) each."""

    def bends(self, parts: FloatArray) -> FloatArray:
        """Return coefficients of ``|v|``, ``|tau|`` and, for contacts with a moment about the normal, ``|tau|`` again.

        (n, 2, 3): bounds on the difference of a contact's work in each part from the linear interpolation of the
        corners' work, and from that of any corner.
        """

    def halved(self, parts: FloatArray) -> FloatArray:
        """Return r smaller parts in place of each, (n r, c, q), grouped by the divided part."""


class Cell(Protocol):
    """A piece of a body's face."""

    @property
    def data(self) -> Json:
        """The cell as JSON data."""

    def rows(self) -> Rows:
        """Return the vertex contacts of the cell's flat part."""

    def sheets(self) -> list[Sheet]:
        """Return the curved parts of the cell."""

    def parts(self, cut: Cut) -> tuple[Cell, Cell]:
        """Return the two parts of a cut, which cover the cell; raise ``ValueError`` on an invalid cut."""

    def hull(self) -> tuple[FloatArray, float]:
        """Return points (m, space) and a radius, metres: the cell is within this distance of their convex hull."""

    def anchors(self) -> FloatArray:
        """Return points (m, space) that identify the cell among those of its kind, metres."""


def ball(cell: Cell) -> tuple[FloatArray, float]:
    """Return centre (space,) and radius, metres, of a bounding ball of a cell."""
    points, beyond = cell.hull()
    middle = points.mean(axis=0)
    return middle, beyond + float(np.max(np.linalg.norm(points - middle, axis=1)))


def halves(interval: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the lower and the upper half of an interval (2,)."""
    low, high = interval.tolist()
    return np.array([low, 0.5 * (low + high)]), np.array([0.5 * (low + high), high])


def one_of(cut: Cut, count: int) -> int:
    """Return the number of a cut, validated to be from 0 to below a count."""
    if not isinstance(cut, int) or isinstance(cut, bool) or not 0 <= cut < count:
        raise ValueError(f"cut {cut!r}, expected a number from 0 to {count - 1}")
    return cut


def increasing(name: str, interval: FloatArray, widest: float = np.inf) -> FloatArray:
    """Return an interval (2,); refuse one that is reversed, or too wide for its vertex contacts."""
    if not 0.0 <= interval[1] - interval[0] <= widest:
        raise ValueError(f"{name} from {interval[0]:g} to {interval[1]:g}")
    return interval
