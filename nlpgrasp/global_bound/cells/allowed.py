"""Allowed regions of single contacts: faces and cells clipped by constraints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.cells.base import Cell, Surface
from nlpgrasp.global_bound.cells.polygon import FlatFace, clipped

THIN = 1e-9  # relative to a face: thinner pieces are dropped


@dataclass(frozen=True)
class HalfSpaces:
    """Intersection of half-spaces ``A (p - radius n) <= b``, n the inward normal.

    Parameters
    ----------
    A : (m, space) array
        Unit rows.
    b : (m,) array
        Metres, body frame.
    radius : float
        Of a fingertip that it is about, metres; 0 for the contact point.
    """

    A: FloatArray
    b: FloatArray
    radius: float = 0.0

    def at(self, normal: FloatArray) -> FloatArray:
        """Return the offsets (m,) that hold for the contact point where the inward normal is this one."""
        return np.asarray(self.b + self.radius * self.A @ normal)

    def excess(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return how far each point is beyond each half-space, (k, m), metres."""
        return np.asarray((points - self.radius * normals) @ self.A.T - self.b)


@dataclass(frozen=True)
class Distance:
    """Least distance of a fingertip's centre from another body.

    Parameters
    ----------
    distance : callable
        Points (m, space) to exact distances (m,), metres.
    least, radius : float
        Metres: of the centre from the body, and of the fingertip.
    """

    distance: Callable[[FloatArray], FloatArray]
    least: float
    radius: float


@dataclass(frozen=True)
class Allowed:
    """Allowed region of one contact.

    Parameters
    ----------
    inside : tuple of HalfSpaces
        All of which hold.
    outside : tuple of HalfSpaces
        Open polytopes that the contact point is in none of.
    away : tuple of Distance
    """

    inside: tuple[HalfSpaces, ...] = ()
    outside: tuple[HalfSpaces, ...] = ()
    away: tuple[Distance, ...] = ()

    def __add__(self, other: Allowed) -> Allowed:
        """Return the intersection of both regions."""
        return Allowed(self.inside + other.inside, self.outside + other.outside, self.away + other.away)

    @property
    def limited(self) -> bool:
        """Whether there is any restriction."""
        return bool(self.inside or self.outside or self.away)

    def left_of(self, surface: Surface) -> Surface | None:
        """Return the face, a flat one clipped by half-spaces; None where nothing is left."""
        if not isinstance(surface, FlatFace):
            return surface
        size = max(float(np.max(np.ptp(piece, axis=0))) for piece in surface.pieces)
        pieces = list(surface.pieces)
        for limits in self.inside:
            for row, offset in zip(limits.A, limits.at(surface.normal), strict=True):
                pieces = [clipped(piece, row, float(offset)) for piece in pieces if len(piece)]
        for limits in self.outside:
            pieces = [part for piece in pieces for part in _without(piece, limits)]
        pieces = [piece for piece in pieces if len(piece) >= 2 and np.max(np.ptp(piece, axis=0)) > THIN * size]
        return FlatFace(surface.name, pieces, surface.normal) if pieces else None

    def excludes(self, cell: Cell) -> bool:
        """Return whether a cell certainly contains no allowed point."""
        centre, radius = cell.ball()
        for limits in self.inside:
            if np.any(limits.A @ centre - limits.b > radius + limits.radius):
                return True
        if any(np.all(limits.A @ centre - limits.b < -radius) for limits in self.outside):
            return True
        reach = [(d.distance(centre[None])[0] + radius + d.radius, d.least) for d in self.away]
        return any(most < least for most, least in reach)

    def same_after(self, rotation: FloatArray, translation: FloatArray, tolerance: float) -> bool:
        """Return whether the region is known to be invariant under a rigid motion or reflection."""
        if self.outside or self.away:
            return False
        if not self.inside:
            return True
        rows = np.concatenate([np.column_stack([h.A, h.b, np.full(len(h.b), h.radius)]) for h in self.inside])
        space = len(translation)
        images = rows.copy()
        images[:, :space] = rows[:, :space] @ rotation.T
        images[:, space] += images[:, :space] @ translation
        apart = np.max(np.abs(images[:, None] - rows[None]), axis=2)
        return bool(np.max(apart.min(axis=1)) <= tolerance)

    def each(self, points: FloatArray, normals: FloatArray, slack: float = 0.0) -> NDArray[np.bool_]:
        """Return the mask of allowed points (m, space), up to a slack in metres."""
        kept = np.ones(len(points), dtype=bool)
        for limits in self.inside:
            kept &= np.all(limits.excess(points, normals) <= slack, axis=1)
        for limits in self.outside:
            kept &= np.any(limits.excess(points, normals) >= -slack, axis=1)
        for d in self.away:
            kept &= d.distance(points - d.radius * normals) >= d.least - slack
        return kept


def _without(piece: FloatArray, hole: HalfSpaces) -> list[FloatArray]:
    """Return convex pieces that cover a convex piece outside of an open polytope."""
    result = []
    for row, offset in zip(hole.A, hole.b, strict=True):
        if len(piece) < 2:
            break
        beyond = clipped(piece, -row, -float(offset))
        if len(beyond) >= 2:
            result.append(beyond)
        piece = clipped(piece, row, float(offset))
    return result
