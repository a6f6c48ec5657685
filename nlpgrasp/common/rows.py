"""What constraints and hands are written in: the contacts' symbols, and named rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from nlpgrasp.common.types import Expression, Json

if TYPE_CHECKING:  # certificates reach this file, and no CasADi
    import casadi as ca


@runtime_checkable
class Solid(Protocol):
    """What constraints know of a body."""

    @property
    def space(self) -> int:
        """2 or 3."""

    @property
    def distance_function(self) -> ca.Function:
        """A ``casadi.Function`` from a point to the signed distance, metres."""

    def to_dict(self) -> Json:
        """Return the body as JSON data."""


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
    unit : {"", "m", "m2", "cos"}
        What the expression is: a length, the square of one, the cosine of an angle, or something else.
    """

    name: str
    expression: Expression
    lower: float = -np.inf
    upper: float = np.inf
    scale: float = 1.0
    unit: str = ""


@dataclass(frozen=True)
class Clearance:
    """A point that stays a distance away from a body: ``lower <= distance(point)``.

    Kept apart from ``Row`` because the distance to a mesh is a spline, which exists as ``MX`` only.

    Parameters
    ----------
    name : str
    distance : casadi.Function
        Point (space,) to signed distance, metres; never more than the true one outside.
    point : casadi.SX
        Column.
    lower : float
        Metres.
    scale : float
        As in ``Row``.
    """

    name: str
    distance: ca.Function
    point: Expression
    lower: float
    scale: float = 1.0

    def as_row(self) -> Row | None:
        """Return the same as a row, or None where the distance is no ``SX`` expression."""
        if not self.distance.is_a("SXFunction"):
            return None
        return Row(self.name, self.distance(self.point), self.lower, scale=self.scale, unit="m")


@dataclass(frozen=True)
class LinkSphere:
    """A sphere that stands for a part of a hand's link.

    Parameters
    ----------
    name : str
        ``"link/number"``.
    centre : casadi.SX
        Column, metres, body frame.
    radius : float
        Metres.
    clearance : float
        Least distance to the held body, metres; negative for a fingertip, which touches it: so far it may reach
        into the solver's surface before the answer is put onto the body.
    is_tip : bool
        Whether it is a fingertip's own sphere, which constraints see as a fingertip already.
    """

    name: str
    centre: Expression
    radius: float
    clearance: float = 0.0
    is_tip: bool = False


@dataclass(frozen=True)
class PalmPose:
    """Where the palm is, as symbols.

    Parameters
    ----------
    position : casadi.SX
        Origin of the palm's frame, metres, body frame.
    rotation : casadi.SX
        (3, 3), axes of the palm's frame as columns, body frame.
    approach : casadi.SX
        Unit direction in which the palm faces, body frame.
    """

    position: Expression
    rotation: Expression
    approach: Expression


@dataclass(frozen=True)
class Placement:
    """Where the contacts are, as symbols: what constraints are written in.

    Parameters
    ----------
    positions : sequence of k columns
        Contact positions, metres, body frame.
    normals : sequence of k columns
        Unit normals pointing into the body.
    radii : sequence of k floats
        Of the fingertips, metres; 0 for points.
    size : float
        The body's characteristic length, metres.
    spheres : sequence of LinkSphere
        What else there is of the hand.
    palm : PalmPose, optional
        Where the hand has one.
    """

    positions: Sequence[Expression]
    normals: Sequence[Expression]
    radii: Sequence[float]
    size: float
    spheres: Sequence[LinkSphere] = ()
    palm: PalmPose | None = None

    @property
    def links(self) -> list[LinkSphere]:
        """The spheres that are no fingertips."""
        return [s for s in self.spheres if not s.is_tip]

    @property
    def tips(self) -> list[Expression]:
        """Centres of the fingertips: ``p - radius n``, outside the body."""
        return [p - r * n for p, n, r in zip(self.positions, self.normals, self.radii, strict=True)]
