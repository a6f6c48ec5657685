"""Allowed region of each contact: faces and cells clipped by the constraints on it alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.bodies import Body, Box, Cylinder, Mesh, Polygon, Prism, Sphere, Torus
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.constraints import BoxRegion, Forbid, HalfSpace, Obstacle, PlacementConstraint, Region, Table, Workspace
from nlpgrasp.global_bound.cells.cell import CellFace, SurfaceCell
from nlpgrasp.global_bound.cells.flat_cells import FlatFaceCells, clip
from nlpgrasp.hands import Fingertips
from nlpgrasp.problem.problem import GraspProblem

THIN = 1e-9  # relative to a face: thinner pieces are dropped
EXACT = (Box, Cylinder, Polygon, Prism, Sphere, Torus)  # bodies whose distance is exact, so that it grows at most by 1


@dataclass(frozen=True)
class HalfSpaces:
    """Intersection of half-spaces ``A (p - radius n) <= b``, n the inward normal.

    Parameters
    ----------
    A : (m, space) array
        Unit rows.
    b : (m,) array
        Metres, body frame.
    radius : float
        Of a fingertip that it is about, metres; 0 for the contact point.
    """

    A: FloatArray
    b: FloatArray
    radius: float = 0.0

    def at(self, normal: FloatArray) -> FloatArray:
        """Return the offsets (m,) that hold for the contact point where the inward normal is this one."""
        return np.asarray(self.b + self.radius * self.A @ normal)

    def excess(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return how far each point is beyond each half-space, (k, m), metres."""
        return np.asarray((points - self.radius * normals) @ self.A.T - self.b)


@dataclass(frozen=True)
class Distance:
    """Least distance of a fingertip's centre from another body.

    Parameters
    ----------
    distance : callable
        Points (m, space) to exact distances (m,), metres.
    least, radius : float
        Metres: of the centre from the body, and of the fingertip.
    """

    distance: Callable[[FloatArray], FloatArray]
    least: float
    radius: float


@dataclass(frozen=True)
class ClippedRegion:
    """Allowed region of one contact.

    Parameters
    ----------
    inside : tuple of HalfSpaces
        All of which hold.
    outside : tuple of HalfSpaces
        Open polytopes that the contact point is in none of.
    away : tuple of Distance
    """

    inside: tuple[HalfSpaces, ...] = ()
    outside: tuple[HalfSpaces, ...] = ()
    away: tuple[Distance, ...] = ()

    def __add__(self, other: ClippedRegion) -> ClippedRegion:
        """Return the intersection of both regions."""
        return ClippedRegion(self.inside + other.inside, self.outside + other.outside, self.away + other.away)

    @property
    def is_limited(self) -> bool:
        """Whether there is any restriction."""
        return bool(self.inside or self.outside or self.away)

    def clip_face(self, surface: CellFace) -> CellFace | None:
        """Return the face, a flat one clipped by half-spaces; None where nothing is left."""
        if not isinstance(surface, FlatFaceCells):
            return surface
        size = max(float(np.max(np.ptp(piece, axis=0))) for piece in surface.pieces)
        pieces = list(surface.pieces)
        for limits in self.inside:
            for row, offset in zip(limits.A, limits.at(surface.normal), strict=True):
                pieces = [clip(piece, row, float(offset)) for piece in pieces if len(piece)]
        for limits in self.outside:
            pieces = [part for piece in pieces for part in _subtract_polytope(piece, limits)]
        pieces = [piece for piece in pieces if len(piece) >= 2 and np.max(np.ptp(piece, axis=0)) > THIN * size]
        return FlatFaceCells(surface.name, pieces, surface.normal) if pieces else None

    def excludes(self, cell: SurfaceCell) -> bool:
        """Return whether a cell certainly contains no allowed point."""
        centre, radius = cell.ball()
        for limits in self.inside:
            if np.any(limits.A @ centre - limits.b > radius + limits.radius):
                return True
        if any(np.all(limits.A @ centre - limits.b < -radius) for limits in self.outside):
            return True
        reach = [(d.distance(centre[None])[0] + radius + d.radius, d.least) for d in self.away]
        return any(most < least for most, least in reach)

    def same_after(self, rotation: FloatArray, translation: FloatArray, tolerance: float) -> bool:
        """Return whether the region is known to be invariant under a rigid motion or reflection."""
        if self.outside or self.away:
            return False
        if not self.inside:
            return True
        rows = np.concatenate([np.column_stack([h.A, h.b, np.full(len(h.b), h.radius)]) for h in self.inside])
        space = len(translation)
        images = rows.copy()
        images[:, :space] = rows[:, :space] @ rotation.T
        images[:, space] += images[:, :space] @ translation
        apart = np.max(np.abs(images[:, None] - rows[None]), axis=2)
        return bool(np.max(apart.min(axis=1)) <= tolerance)

    def each(self, points: FloatArray, normals: FloatArray, slack: float = 0.0) -> NDArray[np.bool_]:
        """Return the mask of allowed points (m, space), up to a slack in metres."""
        kept = np.ones(len(points), dtype=bool)
        for limits in self.inside:
            kept &= np.all(limits.excess(points, normals) <= slack, axis=1)
        for limits in self.outside:
            kept &= np.any(limits.excess(points, normals) >= -slack, axis=1)
        for d in self.away:
            kept &= d.distance(points - d.radius * normals) >= d.least - slack
        return kept


def _subtract_polytope(piece: FloatArray, hole: HalfSpaces) -> list[FloatArray]:
    """Return convex pieces that cover a convex piece outside of an open polytope."""
    result = []
    for row, offset in zip(hole.A, hole.b, strict=True):
        if len(piece) < 2:
            break
        beyond = clip(piece, -row, -float(offset))
        if len(beyond) >= 2:
            result.append(beyond)
        piece = clip(piece, row, float(offset))
    return result


@dataclass(frozen=True)
class AllowedRegion:
    """Allowed faces and region of one contact.

    Parameters
    ----------
    faces : tuple of str
        Names of the faces it may use.
    allowed : ClippedRegion
    key : tuple of int or float
        The same for contacts with the same places.
    """

    faces: tuple[str, ...]
    allowed: ClippedRegion
    key: tuple[float, ...]


def places(problem: GraspProblem) -> tuple[list[AllowedRegion], tuple[str, ...], tuple[PlacementConstraint, ...]]:
    """Return the places of each contact; what is left out, by name; and the constraints that are not.

    Left out are hands, what couples contacts, and unknown expressions.
    """
    radii = (0.0,) * len(problem.models) if problem.hand is None else problem.hand.tip_radii
    found = []
    known: set[int] = set()
    for i, radius in enumerate(radii):
        limits = {j: _region_limits(c, i, float(radius), problem.body.space) for j, c in enumerate(problem.constraints)}
        used = {j: limit for j, limit in limits.items() if limit is not None}
        known |= set(used)
        allowed = sum(used.values(), ClippedRegion())
        found.append(AllowedRegion(problem.allowed_faces(i), allowed, (float(radius), *map(float, used))))
    dropped = [] if problem.hand is None else [f"the hand ({problem.hand.kind})"]
    kept = []
    for j, constraint in enumerate(problem.constraints):
        if j in known or constraint.forbidden_faces():
            kept.append(constraint)
        else:
            dropped.append(getattr(constraint, "name", constraint.kind))
    return found, tuple(dropped), tuple(kept)


def relaxed_problem(problem: GraspProblem) -> GraspProblem:
    """Return a problem without what a bound leaves out; fingertips stay where limits depend on their radii.

    On a mesh contacts touch the triangles themselves, up to the edges.
    """
    kept = places(problem)[2]
    radius = 0.0 if problem.hand is None else max(problem.hand.tip_radii)
    sized = radius > 0.0 and any(isinstance(constraint, Table | Obstacle) for constraint in kept)
    margin = 0.0 if isinstance(problem.body, Mesh) else problem.margin
    hand = Fingertips(len(problem.models), radius) if sized else None
    return replace(problem, hand=hand, constraints=kept, edge_margin=margin)


def _region_limits(constraint: PlacementConstraint, contact: int, radius: float, space: int) -> ClippedRegion | None:
    """Return what a constraint leaves one contact; None where it says nothing of it alone, or nothing that is known."""
    if isinstance(constraint, Table):
        least = constraint.height + constraint.clearance + radius
        return ClippedRegion(inside=(HalfSpaces(-np.eye(space)[-1:], np.array([-least]), radius),))
    if isinstance(constraint, Forbid) and constraint.region is not None:
        limits = _region(constraint.region)
        return None if limits is None else ClippedRegion(outside=(limits,))
    if isinstance(constraint, Workspace) and not constraint.palm and isinstance(constraint.region, Region):
        limits = _region(constraint.region)
        held = constraint.fingers is None or contact in constraint.fingers
        return ClippedRegion(inside=(limits,)) if held and limits is not None else None
    if isinstance(constraint, Obstacle) and isinstance(constraint.body, EXACT):
        distance = _distance_from_obstacle(constraint, constraint.body)
        return ClippedRegion(away=(Distance(distance, radius + constraint.clearance, radius),))
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


def _distance_from_obstacle(obstacle: Obstacle, body: Body) -> Callable[[FloatArray], FloatArray]:
    """Return the distance of points of the held body's frame from an obstacle."""
    position = np.zeros(body.space) if obstacle.position is None else np.asarray(obstacle.position, dtype=float)
    rotation = obstacle.rotation

    def distance(points: FloatArray) -> FloatArray:
        return body.signed_distance((points - position) @ rotation)

    return distance
