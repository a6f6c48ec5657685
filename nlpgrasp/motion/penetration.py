"""Penetration depth of a hand's links in the body and its surroundings, by the links' own collision shapes.

Two measures of depth are taken, and the larger counts:

- ``max over x of d_L(x) + d_T(x)`` for a link L and a thing T (the body, a table, an obstacle), where ``d`` is how far
  a point of a solid is from the solid's surface. It is at least the depth of any point of one surface inside the other
  solid, and at most the shortest translation that parts the two: balls of radius ``d_L(x)`` and ``d_T(x)`` about x lie
  inside them, and a translation that parts two balls with one centre is as long as the sum of their radii.
- Of convex solids that meet, the shortest translation itself: thin plates that cross are parted by a long one only.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from nlpgrasp.bodies import Body, Mesh
from nlpgrasp.bodies.mesh.display_triangles import triangles
from nlpgrasp.common.meshes.search_tree import SearchTree
from nlpgrasp.common.unit_directions import directions_around, directions_beside
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.constraints import Obstacle, PlacementConstraint, Table
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.hands.collision_shapes import CollisionShape
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.obstructions import BODY, TOLERANCE, LinkPenetration

FINE = (1e-4, 0.05)  # metres and share: triangles are subdivided until the depth is known to this accuracy
MOST = 1000  # triangles subdivided together; of more the most promising ones
IMPLIED = 20_000  # triangles approximating an implicit body, at most
SAMPLES = 400  # per curved face, for the distance of its triangles from the surface
FEW = 64  # corners of a mesh up to which its convexity is tested
BEGINNINGS = 6  # starting points of the pattern search, per surface
BULGE = 0.02  # share by which a thing may be larger than the points of its surface that are known
SHEET = 0.05  # of its hull's volume: a surface that encloses less is none of a solid
CONVEX, PLANES = 0.999, 500  # of its hull's volume: a surface that counts as convex; planes that stand for its faces
SAME = 6  # digits to which normals of coplanar triangles agree
AROUND, BESIDE = 200, 12  # directions all around, and about the best one, for the shortest separating translation
ANGLES = (0.1, 1e-4)  # radians: first and last angle about the best one
STEPS = (1e-3, 1e-5)  # metres: first and last step of the pattern search for the deepest point
ON = 1e-7  # metres: how far outside a solid a point of its surface may be by rounding
STATION, MOST_STATIONS = 2e-3, 50  # metres that a link's middle moves between two postures; postures of a leg
_axes = np.concatenate([np.eye(3), -np.eye(3)])
_corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) / np.sqrt(3.0)
DIRECTIONS = np.concatenate([_axes, _corners])  # of the pattern search
Distance = Callable[[FloatArray], FloatArray]
IntArray = NDArray[np.integer]


class PenetrationModel:
    """Penetration depths of one hand in any posture, against one problem's body, tables and obstacles.

    Parameters
    ----------
    problem : GraspProblem
    hand : URDFHand
        That has the links; links without a collision shape count as free.
    tolerance : float
        Metres.
    """

    def __init__(self, problem: GraspProblem, hand: URDFHand, tolerance: float = TOLERANCE) -> None:
        self.hand, self.tolerance = hand, tolerance
        self.things = [_solid_body(BODY, problem.body), *_obstacles(problem.constraints)]
        every = {shape.fingerprint: shape for shapes in hand.robot.shapes.values() for shape in shapes}
        solids = {key: _solid_of_shape(shape) for key, shape in every.items()}  # fingers are often alike
        self._links = {
            link: _LinkSolid.of([solids[shape.fingerprint] for shape in shapes])
            for link, shapes in hand.robot.shapes.items()
            if shapes
        }

    @property
    def has_shapes(self) -> bool:
        """Whether any link has a collision shape; without one no penetration is known."""
        return bool(self._links)

    def at(self, values: Values) -> LinkPenetration:
        """Return the deepest penetration in a posture, given by values of the hand's variables."""
        worst = LinkPenetration(tolerance=self.tolerance)
        poses, middles = self._middles(values)
        if not poses:
            return worst
        names, radii = list(poses), np.array([self._links[link].radius for link in poses])
        for thing in self.things:
            near = thing.fast(middles) < radii
            for name in (name for name, is_near in zip(names, near, strict=True) if is_near):
                depth = self._links[name].depth_in(thing.seen_from(poses[name]))
                if depth > worst.depth:
                    worst = LinkPenetration(depth, name, thing.name, self.tolerance)
        return worst

    def along(self, postures: Iterable[Values]) -> LinkPenetration:
        """Return the deepest penetration over several postures."""
        every = [self.at(values) for values in postures]
        deepest = max(every, key=lambda found: found.depth, default=LinkPenetration(tolerance=self.tolerance))
        return replace(deepest, postures=len(every))

    def on_approach(self, before: Sequence[Values], grasp: Values) -> LinkPenetration:
        """Return the deepest penetration along a path of postures to a grasp.

        Postures every two millimetres are looked at, or a fiftieth of a leg; nothing is known between them. The grasp
        itself is left out.

        Parameters
        ----------
        before : sequence of dict
            Values of the hand's variables where the way turns, from afar on; straight in between.
        grasp : dict
            Where it ends.
        """
        ends = [*before, grasp]
        stations = []
        for here, there in pairwise(ends):
            moved = np.linalg.norm(self._middles(there)[1] - self._middles(here)[1], axis=1)
            count = min(max(int(np.ceil(float(np.max(moved, initial=0.0)) / STATION)), 1), MOST_STATIONS)
            shares = np.arange(count) / count
            stations += [{n: here[n] + s * (there[n] - here[n]) for n in here} for s in shares.tolist()]
        return self.along(stations)

    def _middles(self, values: Values) -> tuple[dict[str, FloatArray], FloatArray]:
        """Return the poses of the links that have shapes, and the middles of these, (m, 3), metres, body frame."""
        poses = self.hand.tree.body_poses(values)
        found = {link: poses[link] for link in self._links if link in poses}
        middles = [pose[:3, :3] @ self._links[link].centre + pose[:3, 3] for link, pose in found.items()]
        return found, np.array(middles).reshape(-1, 3)

    def tip_gaps(self, values: Values, points: FloatArray) -> list[float | None]:
        """Return the distance of each contact from the shapes of its fingertip's link and of links fixed to it.

        Metres, 0 where the shapes reach the contact; None where none of these links has a shape.

        Parameters
        ----------
        values : dict
            Of the hand's variables.
        points : (k, 3) array
            Contacts, metres, body frame.
        """
        robot, poses = self.hand.robot, self.hand.tree.body_poses(values)
        groups = robot.rigid_groups
        result: list[float | None] = []
        for (tip_link, _), point in zip(self.hand.tips, points, strict=True):
            gaps = []
            for link, shapes in robot.shapes.items():
                if groups[link] == groups[tip_link]:
                    local = (point - poses[link][:3, 3]) @ poses[link][:3, :3]
                    gaps += [-float(shape.depth(local[None])[0]) for shape in shapes]
            result.append(max(0.0, min(gaps)) if gaps else None)
        return result


@dataclass(frozen=True)
class LinkObstacle:
    """Solid obstacle to the links: body, table or obstacle.

    Parameters
    ----------
    name : str
    fast, fine : callable
        Points (m, 3), body frame, to signed distances (m,), metres, negative inside: one that is quick and never more
        than the true one near the surface, and one that is as exact as the body states it.
    points : (n, 3) array
        Points of its surface, corners among them, metres, body frame: they may be inside a link whose own surface is
        outside.
    convex : _Convex or None
        Where it is convex.
    """

    name: str
    fast: Distance
    fine: Distance
    points: FloatArray
    convex: _Convex | None = None

    def seen_from(self, pose: FloatArray) -> LinkObstacle:
        """Return the same obstacle for points in a frame that has this pose (4, 4)."""
        fast, fine, turn, shift = self.fast, self.fine, pose[:3, :3].T, pose[:3, 3]
        points = (self.points - shift) @ pose[:3, :3]
        convex = None if self.convex is None else self.convex.in_frame(pose)
        return LinkObstacle(
            self.name, lambda p: fast(p @ turn + shift), lambda p: fine(p @ turn + shift), points, convex
        )


@dataclass(frozen=True)
class _LinkSolid:
    """Union of a link's collision shapes.

    Parameters
    ----------
    parts : sequence of _LinkObstacleSolid
        Of each shape, in the link's frame.
    corners : (m, 3, 3) array
        Of the triangles of all their surfaces, metres, link frame.
    centre, radius : (3,) array and float
        Of a ball around all of them.
    """

    parts: Sequence[_LinkObstacleSolid]
    corners: FloatArray
    centre: FloatArray
    radius: float

    @classmethod
    def of(cls, solids: Sequence[_LinkObstacleSolid]) -> _LinkSolid:
        """Return the union of some solids."""
        corners = np.concatenate([solid.corners for solid in solids])
        every = corners.reshape(-1, 3)
        centre = (every.min(axis=0) + every.max(axis=0)) / 2.0
        radius = float(np.max(np.linalg.norm(every - centre, axis=1)))
        return cls(tuple(solids), corners, centre, radius)

    def depth_in(self, thing: LinkObstacle) -> float:
        """Return the link's penetration depth in an obstacle given in the link's frame, metres, at least zero."""
        points = _deepest_points(thing.fast, self._near(thing))[:BEGINNINGS]
        there = thing.points[np.linalg.norm(thing.points - self.centre, axis=1) < self.radius]
        if len(there):
            found = self._distance(there)
            order = np.argsort(found, kind="stable")[:BEGINNINGS]
            points = np.concatenate([points, there[order[found[order] < 0.0]]])
        if not len(points):
            return 0.0
        inside = _deepest_inside(thing.fine, self._distance, points)
        return max(inside, *self._penetration_depths(thing)) if inside > 0.0 else 0.0

    def _penetration_depths(self, thing: LinkObstacle) -> list[float]:
        """Return the penetration depth of each convex part in a convex obstacle, metres."""
        if thing.convex is None:
            return [0.0]
        return [0.0, *(_penetration_depth(part.convex, thing.convex) for part in self.parts if part.convex is not None)]

    def _near(self, thing: LinkObstacle) -> FloatArray:
        """Return the corners (m, 3, 3) of the triangles that may reach a bounding sphere of an obstacle."""
        if not len(thing.points):
            return self.corners
        middle = (thing.points.min(axis=0) + thing.points.max(axis=0)) / 2.0
        reach = float(np.max(np.linalg.norm(thing.points - middle, axis=1))) * (1.0 + BULGE)
        centres = self.corners.mean(axis=1)
        radii = np.max(np.linalg.norm(self.corners - centres[:, None], axis=2), axis=1)
        return np.asarray(self.corners[np.linalg.norm(centres - middle, axis=1) - radii < reach])

    def _distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance from the link, negative inside, of points (m, 3) in its frame."""
        return np.asarray(np.min([part.distance(points) for part in self.parts], axis=0))


@dataclass(frozen=True)
class _LinkObstacleSolid:
    """Closed surface with its signed distance.

    Parameters
    ----------
    corners : (m, 3, 3) array
        Of the surface's triangles, metres.
    distance : callable
        Points (m, 3) to metres, negative inside: exact there, and outside never too large.
    convex : _Convex or None
        Where the solid is convex.
    """

    corners: FloatArray
    distance: Distance
    convex: _Convex | None = None

    @classmethod
    def of(cls, vertices: FloatArray, faces: IntArray) -> _LinkObstacleSolid:
        """Return the solid of triangles; of sheets, which enclose next to nothing, their convex hull, as MuJoCo does.

        Inside a convex polyhedron the nearest point of its surface is on the nearest of its faces' planes. One with
        many faces is taken as the hull of its outermost vertices in ``PLANES`` directions, within the planes that touch
        it across them: wrong by less than a hundredth of a round one's radius. Any other surface is searched.
        """
        corners = vertices[faces]
        volume = float(np.sum(np.linalg.det(corners - corners.mean(axis=(0, 1))))) / 6.0
        hull = _convex_hull(vertices)
        if hull is None or SHEET * hull.volume <= abs(volume) < CONVEX * hull.volume:
            return cls(corners, SearchTree(vertices, faces).clearance)
        if abs(volume) < SHEET * hull.volume:
            corners = vertices[hull.simplices]
        normals, ends = np.unique(hull.equations[:, :3].round(SAME), axis=0), vertices[hull.vertices]
        offsets = np.max(normals @ ends.T, axis=1)[:, None]
        if len(normals) > PLANES:
            normals = directions_around(np.eye(3)[2], PLANES)
            offsets = np.max(normals @ ends.T, axis=1)[:, None]
            ends = ends[np.unique(np.argmax(normals @ ends.T, axis=1))]
            corners = ends[ConvexHull(ends).simplices]
        shape = _Convex(ends, normals)
        return cls(corners, lambda points: np.asarray(np.max(normals @ points.T - offsets, axis=0)), shape)


@dataclass(frozen=True)
class _Convex:
    """Convex solid: corners (n, 3), metres, and unit normals (m, 3) of its faces."""

    corners: FloatArray
    normals: FloatArray

    def in_frame(self, pose: FloatArray) -> _Convex:
        """Return the same solid for points in a frame that has this pose (4, 4)."""
        return _Convex((self.corners - pose[:3, 3]) @ pose[:3, :3], self.normals @ pose[:3, :3])


def _solid_of_shape(shape: CollisionShape) -> _LinkObstacleSolid:
    """Return the solid of a collision shape."""
    return _LinkObstacleSolid.of(np.asarray(shape.mesh.vertices, dtype=float), np.asarray(shape.mesh.faces))


def _obstacles(constraints: Sequence[PlacementConstraint]) -> Iterator[LinkObstacle]:
    """Yield the tables and obstacles among some constraints, without the required clearance."""
    for constraint in constraints:
        if isinstance(constraint, Table):
            above = partial(_height_above, constraint.height)
            yield LinkObstacle("the table", above, above, np.zeros((0, 3)))
        elif isinstance(constraint, Obstacle) and isinstance(constraint.body, Body):
            pose = np.eye(4)
            pose[:3, :3] = constraint.rotation
            pose[:3, 3] = 0.0 if constraint.position is None else np.asarray(constraint.position, dtype=float)
            outside = np.asarray(np.linalg.inv(pose), dtype=float)
            yield _solid_body(constraint.name, constraint.body).seen_from(outside)


def _height_above(height: float, points: FloatArray) -> FloatArray:
    """Return the heights of points (m, 3) above a table."""
    return np.asarray(points[:, 2] - height)


def _solid_body(name: str, body: Body) -> LinkObstacle:
    """Return a body with a fast and a fine signed distance.

    The first-order distance ``h / |grad h|`` of a curved body is exact near its surface and too deep inside; that from
    its triangles is too small by their distance from the surface, anywhere. Both are lower bounds, so the larger holds.
    """
    if isinstance(body, Mesh):
        corners, faces = np.asarray(body.mesh.vertices, dtype=float), np.asarray(body.mesh.faces)
        convex = _LinkObstacleSolid.of(corners, faces).convex if len(corners) <= FEW else None
        return LinkObstacle(name, body.clearance, body.clearance, _thin_out(corners), convex)
    rng = np.random.default_rng(0)
    sampled = np.concatenate([body.sample(face, SAMPLES, rng) for face in body.face_names])
    surface = body.triangles()
    solid = _LinkObstacleSolid.of(*(triangles(body, IMPLIED) if surface is None else surface))
    within = solid.distance
    off = max(0.0, float(np.max(within(sampled), initial=0.0)))

    def fast(points: FloatArray) -> FloatArray:
        return within(points) - off

    points = _thin_out(solid.corners.reshape(-1, 3))
    if surface is None:  # nothing is known of how an implicit function grows away from its surface
        return LinkObstacle(name, fast, fast, points, solid.convex)
    return LinkObstacle(name, fast, lambda p: np.maximum(body.signed_distance(p), fast(p)), points, solid.convex)


def _thin_out(points: FloatArray) -> FloatArray:
    """Return about ``MOST`` of some points (n, 3), evenly chosen, including the outermost ones."""
    around = directions_around(np.eye(3)[2], AROUND)
    outermost = points[np.unique(np.argmax(points @ around.T, axis=0))]
    return np.concatenate([points[:: max(1, len(points) // MOST)], outermost])


def _convex_hull(vertices: FloatArray) -> ConvexHull | None:
    """Return the convex hull of points (n, 3); None where they are in one plane."""
    try:
        return ConvexHull(vertices)
    except QhullError:
        return None


def _penetration_depth(one: _Convex, other: _Convex) -> float:
    """Return the penetration depth of two convex solids (shortest separating translation), metres; 0 if apart.

    That is the least sum over directions of how far one reaches along it and the other against it: among the normals of
    both, then near the best of them.
    """

    def overlap(directions: FloatArray) -> FloatArray:
        return np.asarray(np.max(one.corners @ directions.T, axis=0) - np.min(other.corners @ directions.T, axis=0))

    directions = np.concatenate([one.normals, -other.normals, directions_around(np.eye(3)[2], AROUND)])
    values = overlap(directions)
    best, least, angle = directions[int(np.argmin(values))], float(np.min(values)), ANGLES[0]
    while angle >= ANGLES[1] and least > 0.0:
        beside = directions_beside(best, angle, BESIDE)
        values = overlap(beside)
        if np.min(values) < least:
            best, least = beside[int(np.argmin(values))], float(np.min(values))
        else:
            angle /= 2.0
    return max(0.0, least)


def _deepest_points(distance: Distance, corners: FloatArray) -> FloatArray:
    """Return points (m, 3) of a surface inside an obstacle, the deepest first; none where the surface is outside.

    Triangles (m, 3, 3) are divided as long as they can hold a point that is deeper than the deepest known one: a
    signed distance changes by no more than a point moves.
    """
    best, known = 0.0, [np.zeros((0, 4))]
    while len(corners):
        centres = corners.mean(axis=1)
        reach = np.max(np.linalg.norm(corners - centres[:, None], axis=2), axis=1)
        depth = -distance(centres)
        known.append(np.column_stack([depth, centres])[depth > 0.0])
        best = max(best, float(np.max(depth)))
        promise = depth + reach
        kept = np.flatnonzero((promise > best + max(FINE[0], FINE[1] * best)) & (promise > 0.0))
        corners = _divided(corners[kept[np.argsort(-promise[kept], kind="stable")][:MOST]])
    found = np.concatenate(known)
    return found[np.argsort(-found[:, 0], kind="stable"), 1:]


def _divided(corners: FloatArray) -> FloatArray:
    """Return triangles (m, 3, 3) subdivided into four each."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, bc, ca = (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0
    return np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])


def _deepest_inside(one: Distance, other: Distance, points: FloatArray) -> float:
    """Return the largest sum of depths in two solids, metres, by pattern search from some points (m, 3)."""

    def both(points: FloatArray) -> FloatArray:
        a, b = one(points), other(points)
        return np.where(np.maximum(a, b) <= ON, a + b, 0.0)

    here = points
    value, step = both(here), STEPS[0]
    while step >= STEPS[1]:
        tried = here[:, None] + step * DIRECTIONS
        values = both(tried.reshape(-1, 3)).reshape(tried.shape[:2])
        which = np.argmin(values, axis=1)
        rows = np.arange(len(here))
        better = values[rows, which] < value
        here = np.where(better[:, None], tried[rows, which], here)
        value = np.where(better, values[rows, which], value)
        step = step if np.any(better) else step / 2.0
    return max(0.0, float(-np.min(value)))
