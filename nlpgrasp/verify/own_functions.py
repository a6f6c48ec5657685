"""Bodies and constraints of kinds from outside the package, by their own functions evaluated at a file's numbers.

Such a kind states its surface ``h(p)`` and its constraints once, for the search. At numbers these are arithmetic: the
distance of a contact is ``h / |grad h|`` to first order, the normal ``grad h / |grad h|``, with the gradient by
differences. What a kind's own counterpart recomputes by other formulas (``register_body``) is a stronger claim.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.common.registry import SOLIDS
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.verify.check import NotCheckedError
from nlpgrasp.verify.sources import SourceFolders
from nlpgrasp.verify.stated_placement import ConstraintValue, Fit, StatedPlacement

if TYPE_CHECKING:  # CasADi is loaded by the kinds themselves
    from nlpgrasp.bodies import Body


@dataclass(frozen=True)
class OwnSurface:
    """A body by its own functions.

    Parameters
    ----------
    body : Body
    """

    body: Body

    @property
    def bounds(self) -> FloatArray:
        """Bounding box, (2, space), metres."""
        return self.body.bounds

    @property
    def rough(self) -> float:
        """Always 0: the distance is the solver's."""
        return 0.0

    def fit(self, face: str, point: FloatArray, normal: FloatArray, tip: str | None) -> Fit:
        """Return the distance of a contact from its face, limits included, and the deviation of its normal."""
        import casadi as ca

        del tip
        if face not in self.body.face_names:
            raise KeyError(face)
        stated, step = self.body.face(face), 1e-6 * self.body.size
        beside = step * np.eye(len(point))

        def h(p: FloatArray) -> float:
            return float(stated.surface(ca.DM(p)))

        gradient = np.array([h(point + e) - h(point - e) for e in beside]) / (2.0 * step)
        slope = max(float(np.linalg.norm(gradient)), 1e-300)
        outside = max((float(limit) for limit in stated.limits(ca.DM(point), 0.0)), default=0.0)
        return Fit(max(abs(h(point)) / slope, outside), float(np.linalg.norm(normal + gradient / slope)))

    def edge_distance(self, face: str, point: FloatArray) -> float:
        """Return the distance of a face's point (space,) from the face's sharp edges, metres."""
        return float(self.body.edge_distance(face, point[None])[0])

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distances (m,) of points (m, space), metres."""
        return self.body.signed_distance(points)


def body_functions(kind: str) -> Callable[[Json, SourceFolders], OwnSurface] | None:
    """Return the numeric model of a registered kind of body by its own functions; None of a kind that is none."""
    from nlpgrasp.bodies.base import Body
    from nlpgrasp.bodies.registry import body_from_dict

    solid = SOLIDS.find(kind)
    is_body = solid is not None and issubclass(solid, Body)
    return (lambda data, _: OwnSurface(body_from_dict(data))) if is_body else None


def constraint_functions(kind: str) -> Callable[[Json, StatedPlacement], Iterator[ConstraintValue]] | None:
    """Return the numeric model of a registered kind of constraint by its own functions; None of a kind that is none."""
    from nlpgrasp.constraints.registry import CONSTRAINTS

    return None if CONSTRAINTS.find(kind) is None else _constraint_values


def _constraint_values(data: Json, placement: StatedPlacement) -> Iterator[ConstraintValue]:
    """Yield the scalar constraints of a constraint by its own functions."""
    import casadi as ca

    from nlpgrasp.common.scalar_constraints import ScalarConstraint, SymbolicCandidate
    from nlpgrasp.constraints.registry import constraint_from_dict

    points, normals = ([ca.DM(row) for row in rows] for rows in (placement.points, placement.normals))
    contacts = SymbolicCandidate(points, normals, placement.radii, placement.size)
    try:
        rows = list[tuple[ScalarConstraint, list[float]]]()
        for row in constraint_from_dict(data).rows(contacts):
            if not isinstance(row, ScalarConstraint):
                raise NotCheckedError(f"a constraint of type {data['type']!r} keeps clearances of the hand")
            rows.append((row, np.asarray(ca.DM(row.expression)).ravel().tolist()))
    except (AttributeError, TypeError, NotImplementedError, InputError) as error:
        if placement.hand is None:
            raise
        raise NotCheckedError(f"a constraint of type {data['type']!r} asks for the hand's pose ({error})") from None
    for row, values in rows:
        for i, value in enumerate(values):
            name = row.name if len(values) == 1 else f"{row.name}[{i}]"
            yield ConstraintValue(name, value, row.lower, row.upper, row.scale)
