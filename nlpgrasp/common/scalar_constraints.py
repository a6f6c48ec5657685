"""Scalar constraints of a symbolic grasp candidate, with labels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.common.types import Expression

if TYPE_CHECKING:  # certificates reach this file, and no CasADi
    import casadi as ca


# kinds of scalar constraints with special treatment
CLEARANCE = "clearance from the body"
ON_FINGERTIP = "on fingertip"  # the only kind shown together with its link
TIPS_APART = "fingertip distance"
FINGERTIP_CLEARANCE = "room for the fingertip"
EDGE_MARGIN = "edge margin"
UNIT_QUATERNION = "palm quaternion of unit length"
CLOSED_LINKAGE = "closed linkage"

EDGES = f"the {EDGE_MARGIN}"  # omitted from global bounds on a mesh


@dataclass(frozen=True)
class Label:
    """Label of a scalar constraint: kind, contacts, link and part.

    Parameters
    ----------
    kind : str
        Kind of constraint, for example ``"table"``.
    fingers : tuple of int
        Indices of the contacts involved.
    link : str
        Part of the hand involved, for example ``"finger/2"`` or ``"palm"``.
    part : str
        Distinguishes constraints of the same kind, fingers and link: a coordinate, a joint, a direction, or ``"[3]"``
        for an element of an expression.
    """

    kind: str
    fingers: tuple[int, ...] = field(default=(), kw_only=True)
    link: str = field(default="", kw_only=True)
    part: str = field(default="", kw_only=True)

    @property
    def name(self) -> str:
        """Label as text: ``"table, finger 2"``, ``"spread, fingers 0 and 1"``, ``"level[0]"``."""
        first = f"{self.kind} {self.link}" if self.kind == ON_FINGERTIP else self.kind
        link = "" if self.kind == ON_FINGERTIP else self.link
        fingers = (
            f"finger{'s' * (len(self.fingers) > 1)} {' and '.join(map(str, self.fingers))}" if self.fingers else ""
        )
        if self.part.startswith("["):
            return ", ".join(filter(None, (first, link, fingers))) + self.part
        return ", ".join(filter(None, (first, link, fingers, self.part)))

    @property
    def label(self) -> Label:
        """The label alone, as a plain ``Label`` without the expression and limits of a constraint."""
        return Label(self.kind, fingers=self.fingers, link=self.link, part=self.part)


@dataclass(frozen=True)
class ScalarConstraint(Label):
    """Labelled scalar constraint ``lower <= expression <= upper``.

    Parameters
    ----------
    kind : str
        As in ``Label``.
    expression : casadi.SX
        Scalar; in an NLP also a column, each element within the limits.
    lower, upper : float
        In the expression's own unit.
    scale : float
        Typical size of the expression, for the solver's scaling.
    unit : {"", "m", "m2", "cos"}
        Unit of the expression: a length, a squared length, the cosine of an angle, or other.
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
    """Labelled clearance constraint ``lower <= distance(point)`` of a point from a body.

    Kept apart from ``ScalarConstraint`` because the distance to a mesh is a spline, which exists as ``MX`` only.

    Parameters
    ----------
    kind : str
        As in ``Label``.
    distance : casadi.Function
        Signed distance of a point (space,), metres; outside never more than the true one.
    point : casadi.SX
        Column.
    lower : float
        Metres.
    scale : float
        As in ``ScalarConstraint``.
    fingers, link, part
        As in ``Label``.
    """

    distance: ca.Function
    point: Expression
    lower: float
    scale: float = 1.0

    def row(self, expression: Expression) -> ScalarConstraint:
        """Return the clearance as a scalar constraint on a given distance expression."""
        return ScalarConstraint(
            self.kind,
            expression,
            self.lower,
            scale=self.scale,
            unit="m",
            fingers=self.fingers,
            link=self.link,
            part=self.part,
        )

    def as_row(self) -> ScalarConstraint | None:
        """Return the clearance as a scalar constraint, or None if its distance is no ``SX`` function."""
        return self.row(self.distance(self.point)) if self.distance.is_a("SXFunction") else None


@dataclass(frozen=True)
class LinkSphere:
    """Ball of a hand's link, which constraints on links keep away from something.

    Links themselves have other shapes: constraints are evaluated for a ball anywhere, which tells the distance that
    they keep (``nlpgrasp.motion.distance_fields``).

    Parameters
    ----------
    link : str
    centre : casadi.SX
        Column, metres, body frame.
    radius : float
        Metres.
    """

    link: str
    centre: Expression
    radius: float


@dataclass(frozen=True)
class PalmPose:
    """Symbolic pose of the palm.

    Parameters
    ----------
    position : casadi.SX
        Origin of the palm's frame, metres, body frame.
    rotation : casadi.SX
        (3, 3), axes of the palm's frame as columns, body frame.
    approach : casadi.SX
        Unit approach direction, in which the palm faces, body frame.
    """

    position: Expression
    rotation: Expression
    approach: Expression


@dataclass(frozen=True)
class SymbolicCandidate:
    """Symbolic grasp candidate: expressions of contacts and hand, for use in constraints.

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
    links : sequence of LinkSphere
        Balls of links; none in a program, where links are linearised clearances.
    palm : PalmPose, optional
        Of a hand with a palm.
    closing : column, optional
        Vector from one jaw to the other, metres, of a gripper that is free to turn about it.
    hand : mapping, optional
        The hand's variables by displayed names: ``"joints"``, ``"palm position"``; None if there are only contacts.
    """

    positions: Sequence[Expression]
    normals: Sequence[Expression]
    radii: Sequence[float]
    size: float
    links: Sequence[LinkSphere] = ()
    palm: PalmPose | None = None
    closing: Expression | None = None
    hand: Mapping[str, Expression] | None = None

    @property
    def tips(self) -> list[Expression]:
        """Centres of the fingertips, ``p - radius n``."""
        return [p - r * n for p, n, r in zip(self.positions, self.normals, self.radii, strict=True)]
