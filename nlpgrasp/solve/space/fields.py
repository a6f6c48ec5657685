"""Distances to what a hand must stay away from, each a function of a point."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count

import casadi as ca
import numpy as np

from nlpgrasp.bodies import Body
from nlpgrasp.common.rows import Clearance, LinkSphere, PalmPose, Placement, Row
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.constraints import PlacementConstraint

PROBE = "probe"
Distance = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Field:
    """The distance to one thing, less the clearance that it asks for.

    Parameters
    ----------
    name : str
    distance : callable
        Points (m, space) to distances (m,), metres; never more than the true ones outside. A ball of radius r about a
        point is free where the distance is r or more.
    """

    name: str
    distance: Distance


def fields_of(body: Body, constraints: Sequence[PlacementConstraint], contacts: int) -> list[Field]:
    """Return the body's distance, then that of each constraint that keeps links away from something.

    A constraint is asked about a link of no size, a probe: of such a ball's centre its rows are distances, and a ball
    of radius r keeps them where they are r or more. Constraints without rows about links, such as ``Spread``, are
    about grasps; they say nothing of a hand on its way.
    """
    fields = [Field("the body", body.signed_distance)]
    names = count(1)
    for constraint in constraints:
        distances = list(_distances(constraint, contacts, body))
        if distances:
            kind, which = constraint.kind, next(names)
            label = getattr(constraint, "name", kind) if kind == "obstacle" else kind
            taken = {f.name for f in fields}
            fields.append(Field(f"{label} {which}" if label in taken else str(label), _least(distances)))
    return fields


def _distances(constraint: PlacementConstraint, contacts: int, body: Body) -> Iterator[Distance]:
    """Yield the rows that a constraint has about a probe, as functions of where it is."""
    where = ca.SX.sym("probe", body.space)
    positions, normals = ([ca.SX.sym(name, body.space) for _ in range(contacts)] for name in "pn")
    palm = None
    if body.space == 3:
        palm = PalmPose(*(ca.SX.sym(name, *size) for name, size in zip("tRa", ((3,), (3, 3), (3,)), strict=True)))
    probe = LinkSphere(PROBE, where, 0.0)
    placement = Placement(positions, normals, (0.0,) * contacts, body.size, [probe], palm)
    for row in constraint.rows(placement):
        if row.link != PROBE:
            continue
        if isinstance(row, Clearance):
            yield _of_clearance(row, where)
        elif row.unit == "m":
            yield from _of_row(row, where)


def _of_clearance(row: Clearance, where: ca.SX) -> Distance:
    local, distance, lower = _Mapped(ca.Function("local", [where], [row.point])), _Mapped(row.distance), row.lower
    return lambda points: distance(local(points).T)[0] - lower


def _of_row(row: Row, where: ca.SX) -> Iterator[Distance]:
    value = _Mapped(ca.Function("row", [where], [row.expression]))
    lower, upper = row.lower, row.upper
    if np.isfinite(lower):
        yield lambda points: value(points)[0] - lower
    if np.isfinite(upper):
        yield lambda points: upper - value(points)[0]


def _least(distances: Sequence[Distance]) -> Distance:
    return lambda points: np.min([distance(points) for distance in distances], axis=0)


class _Mapped:
    """A compiled function of one point, for many; the mapped function is kept for each number of points."""

    def __init__(self, function: ca.Function) -> None:
        self.function, self.known = function, dict[int, ca.Function]()

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return the values, one column a point."""
        many = self.known.setdefault(len(points), self.function.map(len(points)))
        return np.asarray(many(points.T).full())
