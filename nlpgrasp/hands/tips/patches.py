"""Triangulated patches: domes, tubes and rectangles."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.shown.drawing import Triangles
from nlpgrasp.common.spatial import tangents
from nlpgrasp.common.validation import FloatArray

FINE = 28  # sides of a round patch in pictures
DOT = 2e-3  # metres: radius of the ball drawn for a patch of unknown shape


def dome(facing: FloatArray, angle: float, sides: int) -> Triangles:
    """Return the part of the unit sphere within an angle of a direction.

    Parameters
    ----------
    facing : (3,) array
        Unit.
    angle : float
        Radians, up to pi: the whole sphere.
    sides : int
        Sides of each ring of triangles.
    """
    rings = max(2, round(sides * angle / (2.0 * np.pi)))
    polar, turn = np.linspace(0.0, angle, rings + 1), 2.0 * np.pi * np.arange(sides) / sides
    first, second = tangents(facing[None])[0]
    around = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    points = np.cos(polar)[:, None, None] * facing + np.sin(polar)[:, None, None] * around
    return Triangles(points.reshape(-1, 3), _woven(rings, sides))


def tube(radius: float, start: FloatArray, end: FloatArray, sides: int) -> Triangles:
    """Return the side of a cylinder between two points (3,) of its axis."""
    steps = max(2, sides // 4)
    along = (end - start) / np.linalg.norm(end - start)
    first, second = tangents(along[None])[0]
    turn = 2.0 * np.pi * np.arange(sides) / sides
    around = radius * (np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second)
    axis = start + np.linspace(1.0, 0.0, steps + 1)[:, None] * (end - start)  # the far end first: outward triangles
    return Triangles((axis[:, None] + around).reshape(-1, 3), _woven(steps, sides))


def rectangle(extents: FloatArray, frame: FloatArray, steps: int) -> Triangles:
    """Return a rectangle of full lengths (2,) in the xy plane of a frame (4, 4), facing along z."""
    share = np.linspace(-0.5, 0.5, steps + 1)
    x, y = np.meshgrid(share * extents[0], share * extents[1], indexing="ij")
    flat = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    corner = (np.arange(steps)[:, None] * (steps + 1) + np.arange(steps)).ravel()
    a, b, c, d = corner, corner + steps + 1, corner + steps + 2, corner + 1
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return Triangles(flat @ frame[:3, :3].T + frame[:3, 3], faces)


def _woven(rings: int, sides: int) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    """Return the triangles between consecutive closed rings of points."""
    row, column = (i.ravel() for i in np.meshgrid(np.arange(rings), np.arange(sides), indexing="ij"))
    a, b = row * sides + column, row * sides + (column + 1) % sides
    c, d = a + sides, b + sides
    return np.concatenate([np.column_stack([a, c, d]), np.column_stack([a, d, b])]).astype(np.int64)
