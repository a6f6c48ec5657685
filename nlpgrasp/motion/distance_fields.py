"""Distance fields of the body and obstacles, for collision checks of a hand."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count

import casadi as ca
import numpy as np

from nlpgrasp.bodies import Body
from nlpgrasp.common.evaluation import BatchEvaluator
from nlpgrasp.common.scalar_constraints import Clearance, LinkSphere, PalmPose, ScalarConstraint, SymbolicCandidate
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.constraints import PlacementConstraint, Table
from nlpgrasp.solution.obstructions import BODY, TABLE

PROBE = "probe"
Distance = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class DistanceField:
    """Distance field of the body or an obstacle, minus the required clearance.

    Parameters
    ----------
    name : str
        Unique among the fields of a problem.
    solid : str
        The body, the table, or an obstacle by its name.
    clearance : float
        Metres that it is required to be away.
    distance : callable
        Maps points (m, space) to distances (m,), metres, which outside never exceed the true ones. A ball of radius r
        about a point is collision-free if the distance is at least r.
    """

    name: str
    solid: str
    clearance: float
    distance: Distance

    def with_room(self, room: float) -> DistanceField:
        """Return the distance field increased by a length, metres, as if the solid were farther away."""
        return replace(self, distance=lambda points: self.distance(points) + room)


def build_distance_fields(body: Body, constraints: Sequence[PlacementConstraint], contacts: int) -> list[DistanceField]:
    """Return the distance fields of the body and of each constraint that keeps links away from something.

    Each constraint is evaluated for a probe, a link sphere of zero radius, so that its scalar constraints are
    distances of the centre; a ball of radius r satisfies them where they are at least r. Constraints that do not
    involve links, such as ``Spread``, apply to grasps only, not to the hand's motion.
    """
    fields = [DistanceField(BODY, BODY, 0.0, body.signed_distance)]
    counter = count(1)
    for constraint in constraints:
        distances = list(_probe_distances(constraint, contacts, body))
        if distances:
            kind, index = constraint.kind, next(counter)
            label = getattr(constraint, "name", kind) if kind == "obstacle" else kind
            name = f"{label} {index}" if label in {f.name for f in fields} else str(label)
            solid, clearance = TABLE if kind == Table.kind else str(label), float(getattr(constraint, "clearance", 0.0))
            fields.append(DistanceField(name, solid, clearance, _minimum(distances)))
    return fields


def distance_to_all(fields: Sequence[DistanceField]) -> Distance:
    """Return the pointwise minimum of several distance fields."""
    return _minimum([field.distance for field in fields])


def _probe_distances(constraint: PlacementConstraint, contacts: int, body: Body) -> Iterator[Distance]:
    """Yield each distance that a constraint limits for a probe sphere, as a function of the sphere's position."""
    position = ca.SX.sym("probe", body.space)
    positions, normals = ([ca.SX.sym(name, body.space) for _ in range(contacts)] for name in "pn")
    palm = None
    if body.space == 3:
        palm = PalmPose(*(ca.SX.sym(name, *size) for name, size in zip("tRa", ((3,), (3, 3), (3,)), strict=True)))
    probe = LinkSphere(PROBE, position, 0.0)
    placement = SymbolicCandidate(positions, normals, (0.0,) * contacts, body.size, [probe], palm)
    for row in constraint.rows(placement):
        if row.link != PROBE:
            continue
        if isinstance(row, Clearance):
            yield _clearance_distance(row, position)
        elif row.unit == "m":
            yield from _constraint_distances(row, position)


def _clearance_distance(row: Clearance, position: ca.SX) -> Distance:
    """Return the distance in a clearance constraint, minus the required clearance, as a function of position."""
    probe = ca.MX.sym("probe", position.shape[0])
    local = ca.Function("local", [position], [row.point])
    distance, lower = BatchEvaluator(ca.Function("distance", [probe], [row.distance(local(probe))])), row.lower
    return lambda points: distance(points)[0][:, 0] - lower


def _constraint_distances(row: ScalarConstraint, position: ca.SX) -> Iterator[Distance]:
    """Yield the distance of an expression from each finite limit, as a function of position."""
    value = BatchEvaluator(ca.Function("row", [position], [row.expression]))
    lower, upper = row.lower, row.upper
    if np.isfinite(lower):
        yield lambda points: value(points)[0][:, 0] - lower
    if np.isfinite(upper):
        yield lambda points: upper - value(points)[0][:, 0]


def _minimum(distances: Sequence[Distance]) -> Distance:
    """Return the pointwise minimum of several distance functions."""
    return lambda points: np.min([distance(points) for distance in distances], axis=0)
