"""What constraints and hands are written in: the contacts' symbols, and named rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Expression = Any  # casadi.SX


@dataclass(frozen=True)
class Row:
    """One scalar constraint ``lower <= expression <= upper``.

    Parameters
    ----------
    name : str
        What the row says, for example ``"table, finger 2"``.
    expression : casadi.SX
        Scalar.
    lower, upper : float
        In the expression's own unit.
    scale : float
        Typical size of the expression, for the solver's scaling.
    """

    name: str
    expression: Expression
    lower: float = -np.inf
    upper: float = np.inf
    scale: float = 1.0


@dataclass(frozen=True)
class Placement:
    """Where the contacts are, as symbols: what constraints are written in.

    Parameters
    ----------
    positions : sequence of k columns
        Contact positions, metres, body frame.
    normals : sequence of k columns
        Unit normals pointing into the body.
    radius : float
        Of the fingertips, metres; 0 for points.
    size : float
        The body's characteristic length, metres.
    """

    positions: Sequence[Expression]
    normals: Sequence[Expression]
    radius: float
    size: float

    @property
    def tips(self) -> list[Expression]:
        """Centres of the fingertips: ``p - radius n``, outside the body."""
        return [p - self.radius * n for p, n in zip(self.positions, self.normals, strict=True)]
