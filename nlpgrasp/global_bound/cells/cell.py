"""Interfaces of surface cells, of faces made of cells, and of curved surfaces."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, IntArray


class CurvedSurface(Protocol):
    """Interface of a curved surface with q coordinates, divided into small parts with c corners."""

    def contacts(self, coordinates: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points, metres, and inward unit normals at coordinates (m, q), (m, 3) each."""

    def deviations(self, parts: FloatArray) -> FloatArray:
        """Return coefficients (n, 2, 3) that bound how far a contact's work inside a part is from that at corners.

        Parts are (n, c, q), the coefficients k, and the work z. ``k[:, 0]`` bounds the deviation from a linear
        interpolation between the corners, ``k[:, 1]`` that from any corner: by ``k_0 |v| + k_1 |tau|`` in the force
        part of z and by ``k_2 |tau|`` in its moment part ``R^T tau``, where ``v = f + tau x (p - o)`` is the twist's
        velocity at any corner.
        """

    def subdivide(self, parts: FloatArray) -> tuple[FloatArray, IntArray]:
        """Subdivide parts (n, c, q); return vertices (n, v, q), and r smaller parts as vertex indices (r, c)."""


@dataclass(frozen=True)
class CurvedParts:
    """Small parts of a cell on a curved surface, with representative contacts at their corners.

    Parameters
    ----------
    surface : CurvedSurface
    parts : (n, c, q) array
        Coordinates of each part's corners; together the parts cover the cell.
    rows : (n, c) array of int
        Index of the representative contact at each corner.
    """

    surface: CurvedSurface
    parts: FloatArray
    rows: IntArray

    @cached_property
    def deviations(self) -> FloatArray:
        """Deviation coefficients of each part, (n, 2, 3); see ``CurvedSurface.deviations``."""
        return self.surface.deviations(self.parts)

    @cached_property
    def max_deviations(self) -> FloatArray:
        """Largest deviation coefficients over all parts, (2, 3)."""
        return np.asarray(np.max(self.deviations, axis=0))


@dataclass(frozen=True)
class RepresentativeContacts:
    """Finitely many contacts (called rows) whose supports bound the support on a whole cell.

    Parameters
    ----------
    points, normals : (m, space) array
        Metres, and unit, into the body; body frame.
    curved : tuple of CurvedParts
        Parts of curved faces between the representative contacts.
    """

    points: FloatArray
    normals: FloatArray
    curved: tuple[CurvedParts, ...] = ()


Cut = int | list[list[int]]
"""Index of the side, interval or direction that a cell is cut across; of a union both parts, as lists of members."""


class SurfaceCell(ABC):
    """Interface of a surface cell: a piece of a face.

    A convex function of the work z of a contact anywhere in the cell is at most its largest value over the rows plus,
    where the cell is curved, an excess bounded by the deviations of its parts (docs/how_close.md).
    """

    kind: ClassVar[str]

    @abstractmethod
    def representative_contacts(self) -> RepresentativeContacts:
        """Return the representative contacts of the cell."""

    @abstractmethod
    def split(self) -> tuple[SurfaceCell, ...]:
        """Return two cells that cover this one; a cell that cannot be split returns itself alone."""

    @abstractmethod
    def cut(self) -> Cut:
        """Return how ``split`` cuts the cell, as data for a certificate.

        The meaning of the data depends on the kind of cell.
        """

    @abstractmethod
    def ball(self) -> tuple[FloatArray, float]:
        """Return centre (space,) and radius, metres, of a ball that contains the cell."""

    @abstractmethod
    def anchors(self) -> FloatArray:
        """Return points (m, space), metres, that identify the cell among all others of the body."""

    @abstractmethod
    def to_dict(self) -> Json:
        """Return the cell as JSON data: kind, and the geometry that determines its representative contacts."""

    def unsplit_data(self) -> Json:
        """Return the shorter JSON data that suffice for a cell that was not split."""
        return self.to_dict()


class CellFace(ABC):
    """Interface of a body's face as a union of surface cells.

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
