"""Allowed region of each contact on the surface, by the constraints on that contact alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.bodies import Body, Box, Cylinder, Mesh, Polygon, Prism, Sphere, Torus
from nlpgrasp.common.validation import BoolArray, FloatArray
from nlpgrasp.constraints import BoxRegion, Forbid, HalfSpace, Obstacle, PlacementConstraint, Region, Table, Workspace
from nlpgrasp.global_bound.cells.cell import CellFace, SurfaceCell
from nlpgrasp.global_bound.cells.flat_cells import FlatFaceCells, clip
from nlpgrasp.hands import Fingertips
from nlpgrasp.problem.problem import GraspProblem

THIN = 1e-9  # relative to the face's size, extent below which a clipped piece is dropped
EXACT = (Box, Cylinder, Polygon, Prism, Sphere, Torus)  # bodies with an exact distance, of Lipschitz constant 1


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
        Fingertip radius, metres; 0 for a limit on the contact point.
    """

    A: FloatArray
    b: FloatArray
    radius: float = 0.0

    def offsets_at(self, normal: FloatArray) -> FloatArray:
        """Return the offsets c (m,) of the limits ``A p <= c`` on contact points p with a given inward normal."""
        return np.asarray(self.b + self.radius * self.A @ normal)

    def excess(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return the signed distances of points from each half-space, (k, m), metres, positive outside."""
        return np.asarray((points - self.radius * normals) @ self.A.T - self.b)


@dataclass(frozen=True)
class DistanceLimit:
    """Lower limit on the distance of a fingertip's centre from another body.

    Parameters
    ----------
    distance : callable
        Points (m, space) to exact distances (m,), metres.
    least, radius : float
        Least distance of the centre, and fingertip radius, metres.
    """

    distance: Callable[[FloatArray], FloatArray]
    least: float
    radius: float


@dataclass(frozen=True)
class PositionLimits:
    """Limits on the position of one contact.

    Parameters
    ----------
    half_spaces : tuple of HalfSpaces
        All of them contain the contact.
    excluded : tuple of HalfSpaces
        Open polytopes, none of which contains the contact point.
    distances : tuple of DistanceLimit
    """

    half_spaces: tuple[HalfSpaces, ...] = ()
    excluded: tuple[HalfSpaces, ...] = ()
    distances: tuple[DistanceLimit, ...] = ()

    def __add__(self, other: PositionLimits) -> PositionLimits:
        """Return the intersection of both regions."""
        return PositionLimits(
            self.half_spaces + other.half_spaces, self.excluded + other.excluded, self.distances + other.distances
        )

    @property
    def is_restricted(self) -> bool:
        """Whether there is any limit."""
        return bool(self.half_spaces or self.excluded or self.distances)

    def clip_face(self, face: CellFace) -> CellFace | None:
        """Return the allowed part of a flat face, None if empty; faces of other kinds are unchanged."""
        if not isinstance(face, FlatFaceCells):
            return face
        size = max(float(np.max(np.ptp(piece, axis=0))) for piece in face.pieces)
        pieces = list(face.pieces)
        for half_spaces in self.half_spaces:
            for normal, offset in zip(half_spaces.A, half_spaces.offsets_at(face.normal), strict=True):
                pieces = [clip(piece, normal, float(offset)) for piece in pieces if len(piece)]
        for half_spaces in self.excluded:
            pieces = [part for piece in pieces for part in _subtract_polytope(piece, half_spaces)]
        pieces = [piece for piece in pieces if len(piece) >= 2 and np.max(np.ptp(piece, axis=0)) > THIN * size]
        return FlatFaceCells(face.name, pieces, face.normal) if pieces else None

    def excludes(self, cell: SurfaceCell) -> bool:
        """Return whether a cell provably contains no allowed point."""
        centre, radius = cell.ball()  # rows of A are unit vectors; limits are on fingertips' centres
        for half_spaces in self.half_spaces:
            if np.any(half_spaces.A @ centre - half_spaces.b > radius + half_spaces.radius):
                return True
        # wholly inside an excluded polytope
        if any(np.all(half_spaces.A @ centre - half_spaces.b < -radius) for half_spaces in self.excluded):
            return True
        # wholly nearer than a least distance
        farthest = [(d.distance(centre[None])[0] + radius + d.radius, d.least) for d in self.distances]
        return any(distance < least for distance, least in farthest)

    def is_invariant(self, rotation: FloatArray, translation: FloatArray, tolerance: float) -> bool:
        """Return whether the region is provably invariant under a rigid motion or reflection."""
        if self.excluded or self.distances:
            return False
        if not self.half_spaces:
            return True
        rows = np.concatenate([np.column_stack([h.A, h.b, np.full(len(h.b), h.radius)]) for h in self.half_spaces])
        space = len(translation)
        images = rows.copy()
        images[:, :space] = rows[:, :space] @ rotation.T
        images[:, space] += images[:, :space] @ translation
        differences = np.max(np.abs(images[:, None] - rows[None]), axis=2)
        return bool(np.max(differences.min(axis=1)) <= tolerance)

    def contains(self, points: FloatArray, normals: FloatArray) -> BoolArray:
        """Return the mask of allowed points (m, space), given inward normals."""
        mask = np.ones(len(points), dtype=bool)
        for half_spaces in self.half_spaces:
            mask &= np.all(half_spaces.excess(points, normals) <= 0.0, axis=1)
        for half_spaces in self.excluded:
            mask &= np.any(half_spaces.excess(points, normals) >= 0.0, axis=1)
        for d in self.distances:
            mask &= d.distance(points - d.radius * normals) >= d.least
        return mask


def _subtract_polytope(piece: FloatArray, hole: HalfSpaces) -> list[FloatArray]:
    """Return convex pieces that cover the part of a convex piece outside an open polytope."""
    result = []
    for normal, offset in zip(hole.A, hole.b, strict=True):
        if len(piece) < 2:
            break
        outside = clip(piece, -normal, -float(offset))
        if len(outside) >= 2:
            result.append(outside)
        piece = clip(piece, normal, float(offset))
    return result


@dataclass(frozen=True)
class AllowedRegion:
    """Allowed faces and region of one contact.

    Parameters
    ----------
    faces : tuple of str
        Names of the allowed faces.
    allowed : PositionLimits
    key : tuple of float
        Equal for contacts with equal regions.
    """

    faces: tuple[str, ...]
    allowed: PositionLimits
    key: tuple[float, ...]


def allowed_regions(
    problem: GraspProblem,
) -> tuple[list[AllowedRegion], tuple[str, ...], tuple[PlacementConstraint, ...]]:
    """Return each contact's allowed region, the names of dropped hand and constraints, and the kept constraints.

    Dropped are the hand, constraints that couple contacts, and user-defined expressions.
    """
    radii = (0.0,) * len(problem.models) if problem.hand is None else problem.hand.tip_radii
    regions, kept = list[AllowedRegion](), set[int]()
    for i, radius in enumerate(radii):
        limits = dict[int, PositionLimits]()
        for j, constraint in enumerate(problem.constraints):
            limit = _region_limits(constraint, i, float(radius), problem.body.space)
            if limit is not None:
                limits[j] = limit
        kept |= set(limits)
        allowed = sum(limits.values(), PositionLimits())
        regions.append(AllowedRegion(problem.allowed_faces(i), allowed, (float(radius), *map(float, limits))))
    dropped = [] if problem.hand is None else [f"the hand ({problem.hand.kind})"]
    remaining = []
    for j, constraint in enumerate(problem.constraints):
        if j in kept or constraint.forbidden_faces():
            remaining.append(constraint)
        else:
            dropped.append(getattr(constraint, "name", constraint.kind))
    return regions, tuple(dropped), tuple(remaining)


def relaxed_problem(problem: GraspProblem) -> GraspProblem:
    """Return a problem with only those parts that the global bound takes into account.

    Fingertips stay if limits depend on their radii; all get the largest radius, with which limits are strictest. On a
    mesh, contacts touch the triangles themselves, up to the edges.
    """
    _, _, constraints = allowed_regions(problem)
    radius = 0.0 if problem.hand is None else max(problem.hand.tip_radii)
    needs_radius = radius > 0.0 and any(isinstance(constraint, Table | Obstacle) for constraint in constraints)
    margin = 0.0 if isinstance(problem.body, Mesh) else problem.margin
    hand = Fingertips(len(problem.models), radius) if needs_radius else None
    return replace(problem, hand=hand, constraints=constraints, edge_margin=margin)


def _region_limits(constraint: PlacementConstraint, contact: int, radius: float, space: int) -> PositionLimits | None:
    """Return the limits on one contact's position by a constraint; None if the bound cannot use the constraint.

    Usable are tables, obstacles with an exact distance, and forbidden regions and workspaces of the contact that are
    half-spaces or boxes, not those given by a user's function.
    """
    if isinstance(constraint, Table):
        lowest = constraint.height + constraint.clearance + radius
        return PositionLimits(half_spaces=(HalfSpaces(-np.eye(space)[-1:], np.array([-lowest]), radius),))
    if isinstance(constraint, Forbid) and constraint.region is not None:
        half_spaces = _half_spaces_of(constraint.region)
        return None if half_spaces is None else PositionLimits(excluded=(half_spaces,))
    if isinstance(constraint, Workspace) and not constraint.palm and isinstance(constraint.region, Region):
        half_spaces = _half_spaces_of(constraint.region)
        applies = constraint.fingers is None or contact in constraint.fingers
        return PositionLimits(half_spaces=(half_spaces,)) if applies and half_spaces is not None else None
    if isinstance(constraint, Obstacle) and isinstance(constraint.body, EXACT):
        distance = _distance_from_obstacle(constraint, constraint.body)
        return PositionLimits(distances=(DistanceLimit(distance, radius + constraint.clearance, radius),))
    return None


def _half_spaces_of(region: Region) -> HalfSpaces | None:
    """Return the half-spaces of a region; None for a region given by a user's function."""
    if isinstance(region, HalfSpace):
        return HalfSpaces(-np.asarray(region.normal, dtype=float)[None], np.array([-region.offset]))
    if isinstance(region, BoxRegion):
        lower, upper = np.asarray(region.lower, dtype=float), np.asarray(region.upper, dtype=float)
        eye = np.eye(len(lower))
        return HalfSpaces(np.concatenate([eye, -eye]), np.concatenate([upper, -lower]))
    return None


def _distance_from_obstacle(obstacle: Obstacle, body: Body) -> Callable[[FloatArray], FloatArray]:
    """Return a function for the distances of points, in the held body's frame, from an obstacle."""
    position = np.zeros(body.space) if obstacle.position is None else np.asarray(obstacle.position, dtype=float)
    rotation = obstacle.rotation

    def distance(points: FloatArray) -> FloatArray:
        return body.signed_distance((points - position) @ rotation)

    return distance
