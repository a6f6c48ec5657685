"""Allowed region of each contact, by the constraints on it alone; other constraints are relaxed and named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.bodies import Body, Box, Cylinder, Mesh, Polygon, Prism, Sphere, Torus
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.constraints import BoxRegion, Forbid, HalfSpace, Obstacle, PlacementConstraint, Region, Table, Workspace
from nlpgrasp.global_bound.cells.allowed import Allowed, Distance, HalfSpaces
from nlpgrasp.hands import Fingertips
from nlpgrasp.problem.problem import GraspProblem

EXACT = (Box, Cylinder, Polygon, Prism, Sphere, Torus)  # bodies whose distance is exact, so that it grows at most by 1


@dataclass(frozen=True)
class Places:
    """Allowed faces and region of one contact.

    Parameters
    ----------
    faces : tuple of str
        Names of the faces it may use.
    allowed : Allowed
    key : tuple of int or float
        The same for contacts with the same places.
    """

    faces: tuple[str, ...]
    allowed: Allowed
    key: tuple[float, ...]


def places(problem: GraspProblem) -> tuple[list[Places], tuple[str, ...], tuple[PlacementConstraint, ...]]:
    """Return the places of each contact; what is left out, by name; and the constraints that are not.

    Left out are hands, what couples contacts, and unknown expressions.
    """
    radii = (0.0,) * len(problem.models) if problem.hand is None else problem.hand.tip_radii
    found = []
    known: set[int] = set()
    for i, radius in enumerate(radii):
        limits = {j: _limits(c, i, float(radius), problem.body.space) for j, c in enumerate(problem.constraints)}
        used = {j: limit for j, limit in limits.items() if limit is not None}
        known |= set(used)
        allowed = sum(used.values(), Allowed())
        found.append(Places(problem.allowed_faces(i), allowed, (float(radius), *map(float, used))))
    dropped = [] if problem.hand is None else [f"the hand ({problem.hand.kind})"]
    kept = []
    for j, constraint in enumerate(problem.constraints):
        if j in known or constraint.forbidden_faces():
            kept.append(constraint)
        else:
            dropped.append(getattr(constraint, "name", constraint.kind))
    return found, tuple(dropped), tuple(kept)


def relaxed(problem: GraspProblem) -> GraspProblem:
    """Return a problem without what a bound leaves out; fingertips stay where limits depend on their radii.

    On a mesh contacts touch the triangles themselves, up to the edges.
    """
    kept = places(problem)[2]
    radius = 0.0 if problem.hand is None else max(problem.hand.tip_radii)
    sized = radius > 0.0 and any(isinstance(constraint, Table | Obstacle) for constraint in kept)
    margin = 0.0 if isinstance(problem.body, Mesh) else problem.margin
    hand = Fingertips(len(problem.models), radius) if sized else None
    return replace(problem, hand=hand, constraints=kept, edge_margin=margin)


def _limits(constraint: PlacementConstraint, contact: int, radius: float, space: int) -> Allowed | None:
    """Return what a constraint leaves one contact; None where it says nothing of it alone, or nothing that is known."""
    if isinstance(constraint, Table):
        least = constraint.height + constraint.clearance + radius
        return Allowed(inside=(HalfSpaces(-np.eye(space)[-1:], np.array([-least]), radius),))
    if isinstance(constraint, Forbid) and constraint.region is not None:
        limits = _region(constraint.region)
        return None if limits is None else Allowed(outside=(limits,))
    if isinstance(constraint, Workspace) and not constraint.palm and isinstance(constraint.region, Region):
        limits = _region(constraint.region)
        held = constraint.fingers is None or contact in constraint.fingers
        return Allowed(inside=(limits,)) if held and limits is not None else None
    if isinstance(constraint, Obstacle) and isinstance(constraint.body, EXACT):
        distance = _distance(constraint, constraint.body)
        return Allowed(away=(Distance(distance, radius + constraint.clearance, radius),))
    return None


def _region(region: Region) -> HalfSpaces | None:
    """Return the region as half-spaces, None where it is given by a function."""
    if isinstance(region, HalfSpace):
        return HalfSpaces(-np.asarray(region.normal, dtype=float)[None], np.array([-region.offset]))
    if isinstance(region, BoxRegion):
        lower, upper = np.asarray(region.lower, dtype=float), np.asarray(region.upper, dtype=float)
        eye = np.eye(len(lower))
        return HalfSpaces(np.concatenate([eye, -eye]), np.concatenate([upper, -lower]))
    return None


def _distance(obstacle: Obstacle, body: Body) -> Callable[[FloatArray], FloatArray]:
    """Return the distance of points of the held body's frame from an obstacle."""
    position = np.zeros(body.space) if obstacle.position is None else np.asarray(obstacle.position, dtype=float)
    rotation = obstacle.rotation

    def distance(points: FloatArray) -> FloatArray:
        return body.signed_distance((points - position) @ rotation)

    return distance
