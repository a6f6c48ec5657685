"""Shared types of contact models: component blocks and contact velocities."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nlpgrasp.common.types import Expression
from nlpgrasp.common.validation import FloatArray

Blocks = tuple[tuple[slice, float], ...]
"""Blocks of components, and how far unit normal force lets each go: ``|x_j| <= c_j x_n``."""


class Work(NamedTuple):
    """Work of a contact's unit forces on a twist y, ``z = G_i^T y``, by parts (numbers or symbols).

    Parameters
    ----------
    normal : expression
        ``z_n``.
    tangential, torsion : expression
        ``|z_t|`` and ``|z_torsion|``, at least zero.
    """

    normal: Expression
    tangential: Expression
    torsion: Expression


def upper_triangle(n: int) -> list[tuple[int, int]]:
    """Return the index pairs of a symmetric matrix's upper triangle, row by row."""
    return [(a, b) for a in range(n) for b in range(a, n)]


def circle(count: int, first: float) -> FloatArray:
    """Return evenly spaced unit tangential forces (count, 3), the first at an angle from the first tangent."""
    angles = first + 2.0 * np.pi * np.arange(count) / count
    return np.stack([np.zeros(count), np.cos(angles), np.sin(angles)], axis=1)
