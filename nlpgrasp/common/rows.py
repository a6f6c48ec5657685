"""What constraints and hands are written in: the contacts' symbols, and named rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.common.types import Expression

if TYPE_CHECKING:  # certificates reach this file, and no CasADi
    import casadi as ca


# kinds of rows that are told from others
CLEARANCE = "clearance from the body"
ON_FINGERTIP = "on fingertip"  # alone written in one with its link
SELF_COLLISION = "self-collision"
TIPS_APART = "fingertip distance"
ROOM = "room for the fingertip"
EDGE_MARGIN = "edge margin"
UNIT_QUATERNION = "palm quaternion of unit length"

EDGES = f"the {EDGE_MARGIN}"  # what is left out of a bound on a mesh


@dataclass(frozen=True)
class Label:
    """What a row says, and of whom.

    Parameters
    ----------
    kind : str
        What all rows of this sort have in common, for example ``"table"``.
    fingers : tuple of int
        The contacts it is about.
    link : str
        The part of the hand it is about, for example ``"finger/2"`` or ``"palm"``.
    part : str
        What tells it from others of the same kind, fingers and link: a coordinate, a joint, a direction, or
        ``"[3]"`` for an element of an expression.
    """

    kind: str
    fingers: tuple[int, ...] = field(default=(), kw_only=True)
    link: str = field(default="", kw_only=True)
    part: str = field(default="", kw_only=True)

    @property
    def name(self) -> str:
        """The label written out: ``"table, finger 2"``, ``"spread, fingers 0 and 1"``, ``"level[0]"``."""
        first = f"{self.kind} {self.link}" if self.kind == ON_FINGERTIP else self.kind
        link = "" if self.kind == ON_FINGERTIP else self.link
        which = f"finger{'s' * (len(self.fingers) > 1)} {' and '.join(map(str, self.fingers))}" if self.fingers else ""
        if self.part.startswith("["):
            return ", ".join(filter(None, (first, link, which))) + self.part
        return ", ".join(filter(None, (first, link, which, self.part)))

    @property
    def label(self) -> Label:
        """The label alone, without what it is the label of."""
        return Label(self.kind, fingers=self.fingers, link=self.link, part=self.part)


@dataclass(frozen=True)
class Row(Label):
    """One scalar constraint ``lower <= expression <= upper``; all the rest of a label is given by name.

    Parameters
    ----------
    kind : str
        As in ``Label``.
    expression : casadi.SX
        Scalar; in a program also a column, each element within the limits.
    lower, upper : float
        In the expression's own unit.
    scale : float
        Typical size of the expression, for the solver's scaling.
    unit : {"", "m", "m2", "cos"}
        What the expression is: a length, the square of one, the cosine of an angle, or something else.
    fingers, link, part
        As in ``Label``.
    """

    expression: Expression
    lower: float = -np.inf
    upper: float = np.inf
    scale: float = 1.0
    unit: str = ""


@dataclass(frozen=True)
class Clearance(Label):
    """A point that stays a distance away from a body: ``lower <= distance(point)``.

    Kept apart from ``Row`` because the distance to a mesh is a spline, which exists as ``MX`` only.

    Parameters
    ----------
    kind : str
        As in ``Label``.
    distance : casadi.Function
        Point (space,) to signed distance, metres; never more than the true one outside.
    point : casadi.SX
        Column.
    lower : float
        Metres.
    scale : float
        As in ``Row``.
    fingers, link, part
        As in ``Label``.
    """

    distance: ca.Function
    point: Expression
    lower: float
    scale: float = 1.0

    def row(self, expression: Expression) -> Row:
        """Return the same as a row of an expression."""
        return Row(
            self.kind,
            expression,
            self.lower,
            scale=self.scale,
            unit="m",
            fingers=self.fingers,
            link=self.link,
            part=self.part,
        )

    def as_row(self) -> Row | None:
        """Return the same as a row, or None where the distance is not an ``SX`` expression."""
        return self.row(self.distance(self.point)) if self.distance.is_a("SXFunction") else None


@dataclass(frozen=True)
class LinkSphere:
    """A sphere that stands for a part of a hand's link.

    Parameters
    ----------
    link : str
        ``"link/number"``, or the link of a fingertip.
    centre : casadi.SX
        Column, metres, body frame.
    radius : float
        Metres.
    clearance : float
        Least distance to the held body, metres; negative for a fingertip, which touches it: so far it may reach
        into the solver's surface before the answer is put onto the body.
    finger : int, optional
        Whose own sphere it is, of a fingertip: constraints see it as such already.
    """

    link: str
    centre: Expression
    radius: float
    clearance: float = 0.0
    finger: int | None = None

    @property
    def is_tip(self) -> bool:
        """Whether it is a fingertip's own sphere."""
        return self.finger is not None


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
    closing : column, optional
        From one jaw to the other, metres, of a gripper that may be turned about this line.
    hand : mapping, optional
        The hand's variables by the names that the program shows: ``"joints"``, ``"palm position"``; None where only
        contacts are placed.
    """

    positions: Sequence[Expression]
    normals: Sequence[Expression]
    radii: Sequence[float]
    size: float
    spheres: Sequence[LinkSphere] = ()
    palm: PalmPose | None = None
    closing: Expression | None = None
    hand: Mapping[str, Expression] | None = None

    @property
    def links(self) -> list[LinkSphere]:
        """Spheres of the links, those of fingertips left out."""
        return [s for s in self.spheres if not s.is_tip]

    @property
    def tips(self) -> list[Expression]:
        """Centres of the fingertips: ``p - radius n``, outside the body."""
        return [p - r * n for p, n, r in zip(self.positions, self.normals, self.radii, strict=True)]
