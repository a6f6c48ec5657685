"""Penetration depth of a hand's links in body, surroundings and each other, by collision shapes.

The depth is the larger of two measures:

- ``max over x of d_L(x) + d_T(x)`` for a link L and an obstacle T (the body, a table, another link), where ``d`` is the
  distance of a point of a solid from the solid's surface. It is at least the depth of any point of one surface inside
  the other solid, and at most the shortest separating translation: balls of radius ``d_L(x)`` and ``d_T(x)`` about x
  lie inside them, and a translation that separates two balls with one centre is as long as the sum of their radii.
- For convex solids that intersect, the shortest separating translation itself: for thin plates that cross it is long.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations, pairwise

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.distance import cdist

from nlpgrasp.bodies import Body, Mesh
from nlpgrasp.bodies.mesh.display_triangles import triangles
from nlpgrasp.common.meshes.search_tree import SearchTree
from nlpgrasp.common.unit_directions import directions_around, directions_beside
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.constraints import Obstacle, PlacementConstraint, Table
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.hands.collision_shapes import CollisionShape
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.obstructions import BODY, LEAST_DEPTH, TABLE, TOLERANCE, LinkPenetration, link_name

DEPTH_ACCURACY = (1e-4, 0.05)  # metres and share: triangles are subdivided until the depth is known to this accuracy
BATCH = 1000  # largest number of triangles subdivided in a round, the most promising ones
IMPLICIT_TRIANGLES = 20_000  # largest number of triangles approximating an implicit body
SAMPLES = 400  # samples per curved face, for the distance of its triangles from the surface
CONVEX_TEST_CORNERS = 64  # corners of a mesh up to which its convexity is tested
SEARCH_STARTS = 6  # starting points of the pattern search, per surface
BULGE = 0.02  # share by which an obstacle may be larger than the samples of its surface
SHEET_VOLUME = 0.05  # share of its hull's volume below which a surface is a sheet and no solid
CONVEX_VOLUME = 0.999  # share of its hull's volume above which a solid counts as convex
MAX_PLANES = 500  # largest number of planes that approximate a convex solid's faces
NORMAL_DIGITS = 6  # digits to which normals of coplanar triangles agree
ALL_DIRECTIONS = 200  # directions over the sphere for the shortest separating translation
CLOSER_DIRECTIONS = 12  # directions about the best one
ANGLES = (0.1, 1e-4)  # radians: first and last angle about the best one
SEARCH_STEPS = (1e-3, 1e-5)  # metres: first and last step of the pattern search for the deepest point
SURFACE_TOLERANCE = 1e-7  # metres: distance outside a solid of a point of its surface, by rounding
POSTURE_SPACING = 2e-3  # metres that a link's centre moves between two postures
MAX_POSTURES = 50  # largest number of postures of a leg
MOST_AXES = 32  # normals of a convex solid above which others are tried to separate it from another
RANDOM_POSTURES, PERMANENT = 20, 0.9  # random postures, and the share of them in which links overlap by construction
MOST_POINTS = 16  # points kept outside an obstacle at a time, at most
NEAR = 2.5  # distance of these points from the deepest one over the penetration depth, at most
FINE = 0.2  # size of triangles over this distance
_axes = np.concatenate([np.eye(3), -np.eye(3)])
_corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) / np.sqrt(3.0)
DIRECTIONS = np.concatenate([_axes, _corners])  # directions of the pattern search
Distance = Callable[[FloatArray], FloatArray]


class PenetrationModel:
    """Penetration depths of a hand's links, in any posture, in body, tables, obstacles and each other.

    Parameters
    ----------
    problem : GraspProblem
    hand : URDFHand
        The links without a collision shape do not penetrate anything.
    tolerance : float
        Metres.
    hulls : bool
        Whether each collision shape counts as its convex hull, as in MuJoCo; in body and surroundings alone.
    """

    def __init__(
        self, problem: GraspProblem, hand: URDFHand, tolerance: float = TOLERANCE, hulls: bool = False
    ) -> None:
        self.hand, self.tolerance = hand, tolerance
        self.obstacles = [_solid_body(BODY, problem.body), *_obstacles(problem.constraints)]
        shapes = {shape.fingerprint: shape for shapes in hand.robot.shapes.values() for shape in shapes}
        solids = {key: _solid_of_shape(shape, hulls) for key, shape in shapes.items()}  # fingers are often alike
        self._links = {
            link: _LinkShape.of([solids[shape.fingerprint] for shape in shapes])
            for link, shapes in hand.robot.shapes.items()
            if shapes
        }
        can_meet = hand.self_collision and not hulls and len(self._links) > 1
        self._self_penetration = SelfPenetration(hand, self._links, tolerance) if can_meet else None
        self._last: tuple[bytes, list[LinkPenetration]] | None = None  # of the last posture, which is often asked again

    @property
    def has_shapes(self) -> bool:
        """Whether any link has a collision shape."""
        return bool(self._links)

    @property
    def has_convex_shapes(self) -> bool:
        """Whether each shape is its own convex hull."""
        return all(part.convex is not None for link in self._links.values() for part in link.parts)

    def in_posture(self, values: Values) -> LinkPenetration:
        """Return the deepest penetration in one posture, given values of the hand's variables."""
        return self._deepest(self.in_surroundings(values) + self.in_each_other(values))

    def in_each_other(self, values: Values) -> list[LinkPenetration]:
        """Return the penetrations of links in each other in one posture."""
        return [] if self._self_penetration is None else self._self_penetration.at_joints(values["joints"])

    def in_surroundings(self, values: Values) -> list[LinkPenetration]:
        """Return the penetrations of links in the body and its surroundings in one posture."""
        key = b"".join(np.asarray(value, dtype=float).tobytes() for value in values.values())
        if self._last is None or self._last[0] != key:
            self._last = key, self._surrounding_penetrations(values)
        return self._last[1]

    def _surrounding_penetrations(self, values: Values) -> list[LinkPenetration]:
        poses, centres = self._link_centres(values)
        if not poses:
            return []
        result, names = list[LinkPenetration](), list(poses)
        radii = np.array([self._links[link].radius for link in poses])
        for obstacle in self.obstacles:
            reaching = obstacle.fast_distance(centres) < radii
            for name in (name for name, is_near in zip(names, reaching, strict=True) if is_near):
                depth = self._links[name].depth_in(obstacle.in_frame(poses[name]))
                result += [LinkPenetration(depth, name, obstacle.name, self.tolerance)] if depth > 0.0 else []
        return result

    def points_inside(self, values: Values, penetration: LinkPenetration) -> FloatArray:
        """Return points of a link's surface about the deepest one in an obstacle, (m, 3), metres, link frame.

        They are about as far apart as the link is deep, so that an edge of the obstacle between them is half as deep.
        The deepest point comes first; each of the others is the farthest from those before it.
        """
        link = str(penetration.link)
        obstacle = next(obstacle for obstacle in self.obstacles if obstacle.name == penetration.thing)
        distance = obstacle.in_frame(self.hand.tree.body_poses(values)[link]).fast_distance
        chosen = _deepest_points(distance, self._links[link].corners)[:1]
        if len(chosen):
            near = _points_near(chosen[0], NEAR * penetration.depth, self._links[link].corners)
        while 0 < len(chosen) < min(MOST_POINTS, len(near)):
            gaps = np.min(cdist(near, chosen), axis=1)
            chosen = np.concatenate([chosen, near[np.argmax(gaps)][None]])
        return chosen

    def on_approach(self, waypoints: Sequence[Values], grasp: Values) -> PathPenetration:
        """Return the deepest penetrations along a path to a grasp, given by waypoints.

        Postures every two millimetres are checked, or a fiftieth of a leg; nothing is certified between them. The grasp
        itself is left out.

        Parameters
        ----------
        waypoints : sequence of dict
            Values of the hand's variables at the corners of the path, from the start on; straight in between.
        grasp : dict
            Values of the hand's variables at its end.
        """
        corners = [*waypoints, grasp]
        samples = []
        for start, end in pairwise(corners):
            distances = np.linalg.norm(self._link_centres(end)[1] - self._link_centres(start)[1], axis=1)
            count = min(max(int(np.ceil(float(np.max(distances, initial=0.0)) / POSTURE_SPACING)), 1), MAX_POSTURES)
            fractions = np.arange(count) / count
            samples += [{n: start[n] + s * (end[n] - start[n]) for n in start} for s in fractions.tolist()]
        in_surroundings = [penetration for values in samples for penetration in self.in_surroundings(values)]
        in_links = [penetration for values in samples for penetration in self.in_each_other(values)]
        deepest = replace(self._deepest(in_surroundings + in_links), postures=len(samples))
        return PathPenetration(deepest, self._deepest(in_surroundings).depth)

    def _deepest(self, penetrations: Sequence[LinkPenetration]) -> LinkPenetration:
        """Return the deepest of several penetrations; one without depth if there is none."""
        none = LinkPenetration(tolerance=self.tolerance)
        return max(penetrations, key=lambda penetration: penetration.depth, default=none)

    def _link_centres(self, values: Values) -> tuple[dict[str, FloatArray], FloatArray]:
        """Return the poses of links with shapes, and their bounding spheres' centres (m, 3), metres, body frame."""
        poses = self.hand.tree.body_poses(values)
        link_poses = {link: poses[link] for link in self._links if link in poses}
        centres = [pose[:3, :3] @ self._links[link].centre + pose[:3, 3] for link, pose in link_poses.items()]
        return link_poses, np.array(centres).reshape(-1, 3)

    def tip_gaps(self, values: Values, points: FloatArray) -> list[float | None]:
        """Return the distance of each contact from the shapes of its fingertip's link, metres.

        Links fixed to this link count, too. It is 0 where the shapes reach the contact, and None where none of these
        links has a shape.

        Parameters
        ----------
        values : dict
            Of the hand's variables.
        points : (k, 3) array
            Contacts, metres, body frame.
        """
        poses = self.hand.tree.body_poses(values)
        result: list[float | None] = []
        for (link, _), point in zip(self.hand.tips, points, strict=True):
            local = (point - poses[link][:3, 3]) @ poses[link][:3, :3]
            shapes = self.hand.robot.group_shapes(link)
            gaps = [-float(shape.depth(((local - T[:3, 3]) @ T[:3, :3])[None])[0]) for shape, T in shapes]
            result.append(max(0.0, min(gaps)) if gaps else None)
        return result


@dataclass(frozen=True)
class PathPenetration:
    """Deepest penetrations of a hand's links along a path.

    Parameters
    ----------
    deepest : LinkPenetration
        In anything.
    surroundings_depth : float
        Depth in the body, tables and obstacles alone, metres: as far a link pushes the body away.
    """

    deepest: LinkPenetration
    surroundings_depth: float

    def followed_by(self, other: PathPenetration) -> PathPenetration:
        """Return the deepest penetrations of this path and then another one."""
        deepest = max(self.deepest, other.deepest, key=lambda penetration: penetration.depth)
        postures = self.deepest.postures + other.deepest.postures
        depth = max(self.surroundings_depth, other.surroundings_depth)
        return PathPenetration(replace(deepest, postures=postures), depth)


class SelfPenetration:
    """Penetration depths of a hand's links in one another.

    Left out are links that are rigidly connected or neighbours in the chain, and those that overlap by construction: in
    nine tenths of random postures.

    Parameters
    ----------
    hand : URDFHand
    links : mapping of str to _LinkShape
    tolerance : float
        Metres.
    """

    def __init__(self, hand: URDFHand, links: Mapping[str, _LinkShape], tolerance: float) -> None:
        self._tree, self._tolerance = hand.tree, tolerance
        parts = [(link, part) for link, shape in links.items() for part in shape.parts]
        self._links = [link for link, _ in parts]
        self._link_indices = [self._tree.used_links.index(link) for link in self._links]
        self._shapes = [_LinkShape.of([part]) for _, part in parts]
        self._centres, self._radii = (
            np.array([getattr(shape, name) for shape in self._shapes]) for name in ("centre", "radius")
        )
        groups, robot = hand.robot.rigid_groups, hand.robot
        meeting = {(a, b) for a, b in combinations(links, 2) if groups[a] != groups[b] and not robot.adjacent(a, b)}
        self._can_meet = np.array([[(a, b) in meeting for b in self._links] for a in self._links], bool)
        self._permanent: dict[tuple[str, str], bool] = {}
        self._last: tuple[bytes, list[LinkPenetration]] | None = None  # an approach does not change the joints

    def at_joints(self, joints: FloatArray) -> list[LinkPenetration]:
        """Return the penetrations of links in one another, given positions of the free joints."""
        key = np.asarray(joints, dtype=float).tobytes()
        if self._last is None or self._last[0] != key:
            self._last = (
                key,
                [
                    LinkPenetration(depth, pair[0], link_name(pair[1]), self._tolerance)
                    for pair, depth in self._depths(joints).items()
                    if depth > LEAST_DEPTH and not self._is_permanent(pair)
                ],
            )
        return self._last[1]

    def _depths(self, joints: FloatArray, only: tuple[str, str] | None = None) -> dict[tuple[str, str], float]:
        """Return the penetration depths of pairs of links, metres; pairs that are apart are left out.

        Either of one pair, or of all but those that overlap by construction.
        """
        result = dict[tuple[str, str], float]()
        frames = self._tree.palm_poses(np.asarray(joints, dtype=float)[None])[0][self._link_indices]
        centres = np.einsum("mij,mj->mi", frames[:, :3, :3], self._centres) + frames[:, :3, 3]
        distances = np.linalg.norm(centres[:, None] - centres, axis=2)
        for i, j in np.argwhere(self._can_meet & (distances < self._radii[:, None] + self._radii)).tolist():
            pair = (self._links[i], self._links[j])
            if pair == only or (only is None and not self._permanent.get(pair, False)):
                pose = np.linalg.inv(frames[j]) @ frames[i]
                depth = self._part_depth(i, j, pose)
                if depth > result.get(pair, 0.0):
                    result[pair] = depth
        return result

    def _part_depth(self, i: int, j: int, pose: FloatArray) -> float:
        """Return the penetration depth of two collision shapes, metres.

        ``pose`` is that of the first shape in the frame of the second.
        """
        first, second, part = self._shapes[i], self._shapes[j], self._shapes[j].parts[0]
        hull = second.hull.in_frame(pose)
        if _are_separated(first.hull, hull):
            return 0.0
        if first.parts[0].convex is not None and part.convex is not None:
            return _penetration_depth(first.hull, hull)
        obstacle = LinkObstacle("", part.distance, part.distance, second.hull.corners)
        return first.depth_in(obstacle.in_frame(pose))

    def _is_permanent(self, pair: tuple[str, str]) -> bool:
        """Return whether two links overlap in nearly all random postures."""
        if pair not in self._permanent:
            postures = self._tree.random_joints(RANDOM_POSTURES, np.random.default_rng(0))
            free, most_free = 0, (1.0 - PERMANENT) * RANDOM_POSTURES
            for joints in postures:
                free += self._depths(joints, pair).get(pair, 0.0) <= LEAST_DEPTH
                if free > most_free:
                    break
            self._permanent[pair] = free <= most_free
        return self._permanent[pair]


@dataclass(frozen=True)
class LinkObstacle:
    """Solid that links may penetrate: the body, a table, an obstacle or a shape of another link.

    Parameters
    ----------
    name : str
    fast_distance, exact_distance : callable
        Points (m, 3), body frame, to signed distances (m,), metres, negative inside: one that is quick and never more
        than the true one near the surface, and one that is as exact as the body states it.
    points : (n, 3) array
        Points of its surface, corners among them, metres, body frame: they may be inside a link whose own surface is
        outside.
    convex : _Convex or None
        Where it is convex.
    """

    name: str
    fast_distance: Distance
    exact_distance: Distance
    points: FloatArray
    convex: _Convex | None = None

    def in_frame(self, pose: FloatArray) -> LinkObstacle:
        """Return the obstacle in the coordinates of a frame, given the frame's pose (4, 4)."""
        fast, exact, rotation, shift = self.fast_distance, self.exact_distance, pose[:3, :3].T, pose[:3, 3]
        points = (self.points - shift) @ pose[:3, :3]
        convex = None if self.convex is None else self.convex.in_frame(pose)
        return LinkObstacle(
            self.name, lambda p: fast(p @ rotation + shift), lambda p: exact(p @ rotation + shift), points, convex
        )


@dataclass(frozen=True)
class _LinkShape:
    """Union of a link's collision shapes.

    Parameters
    ----------
    parts : sequence of _Solid
        Of each shape, in the link's frame.
    corners : (m, 3, 3) array
        Of the triangles of all their surfaces, metres, link frame.
    centre, radius : (3,) array and float
        Of a ball around all of them.
    """

    parts: Sequence[_Solid]
    corners: FloatArray
    centre: FloatArray
    radius: float

    @classmethod
    def of(cls, solids: Sequence[_Solid]) -> _LinkShape:
        """Return the union of given solids."""
        corners = np.concatenate([solid.corners for solid in solids])
        points = corners.reshape(-1, 3)
        centre = (points.min(axis=0) + points.max(axis=0)) / 2.0
        radius = float(np.max(np.linalg.norm(points - centre, axis=1)))
        return cls(tuple(solids), corners, centre, radius)

    @cached_property
    def hull(self) -> _Convex:
        """Convex hull of the link's shape, which must be a single one."""
        solid = self.parts[0].convex
        if solid is not None:
            return solid
        points = self.corners.reshape(-1, 3)
        hull = _convex_hull(points)
        return _Convex(points if hull is None else points[hull.vertices], DIRECTIONS)

    def depth_in(self, obstacle: LinkObstacle) -> float:
        """Return the link's penetration depth in an obstacle, metres, 0 if apart.

        The obstacle is in the link's frame.
        """
        points = _deepest_points(obstacle.fast_distance, self._reaching_triangles(obstacle))[:SEARCH_STARTS]
        inside_candidates = obstacle.points[np.linalg.norm(obstacle.points - self.centre, axis=1) < self.radius]
        if len(inside_candidates):
            distances = self._distance(inside_candidates)
            order = np.argsort(distances, kind="stable")[:SEARCH_STARTS]
            points = np.concatenate([points, inside_candidates[order[distances[order] < 0.0]]])
        if not len(points):
            return 0.0
        depth = _deepest_inside(obstacle.exact_distance, self._distance, points)
        return max(depth, *self._penetration_depths(obstacle)) if depth > 0.0 else 0.0

    def _penetration_depths(self, obstacle: LinkObstacle) -> list[float]:
        """Return the penetration depth of each convex part of the link in a convex obstacle, metres."""
        if obstacle.convex is None:
            return [0.0]
        return [
            0.0,
            *(_penetration_depth(part.convex, obstacle.convex) for part in self.parts if part.convex is not None),
        ]

    def _reaching_triangles(self, obstacle: LinkObstacle) -> FloatArray:
        """Return the triangles (m, 3, 3) that may reach some bounding sphere of an obstacle."""
        if not len(obstacle.points):
            return self.corners
        middle = (obstacle.points.min(axis=0) + obstacle.points.max(axis=0)) / 2.0
        reach = float(np.max(np.linalg.norm(obstacle.points - middle, axis=1))) * (1.0 + BULGE)
        centres = self.corners.mean(axis=1)
        radii = np.max(np.linalg.norm(self.corners - centres[:, None], axis=2), axis=1)
        return np.asarray(self.corners[np.linalg.norm(centres - middle, axis=1) - radii < reach])

    def _distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance of points (m, 3), link frame, from the link, negative inside."""
        return np.asarray(np.min([part.distance(points) for part in self.parts], axis=0))


@dataclass(frozen=True)
class _Solid:
    """Closed surface with a signed distance.

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
    def of(cls, vertices: FloatArray, faces: IntArray) -> _Solid:
        """Return the solid of a triangulated surface.

        For a sheet, which encloses no volume, this is the convex hull, as in MuJoCo. Inside a convex polyhedron the
        nearest point of its surface is on the nearest of its faces' planes. One with many faces is approximated by the
        hull of its outermost vertices in ``MAX_PLANES`` directions, within the planes that support it: the error is
        below a hundredth of the radius of a ball. Any other surface is searched.
        """
        corners = vertices[faces]
        volume = float(np.sum(np.linalg.det(corners - corners.mean(axis=(0, 1))))) / 6.0
        hull = _convex_hull(vertices)
        if hull is None or SHEET_VOLUME * hull.volume <= abs(volume) < CONVEX_VOLUME * hull.volume:
            return cls(corners, SearchTree(vertices, faces).exact_signed_distance)
        return cls.of_hull(hull, vertices[hull.simplices] if abs(volume) < SHEET_VOLUME * hull.volume else corners)

    @classmethod
    def of_hull(cls, hull: ConvexHull, corners: FloatArray) -> _Solid:
        """Return the solid of a convex hull, given the triangles (m, 3, 3) of its surface."""
        normals = np.unique(hull.equations[:, :3].round(NORMAL_DIGITS), axis=0)
        corner_points = hull.points[hull.vertices]
        if len(normals) > MAX_PLANES:
            normals = directions_around(np.eye(3)[2], MAX_PLANES)
            corner_points = corner_points[np.unique(np.argmax(normals @ corner_points.T, axis=1))]
            corners = corner_points[ConvexHull(corner_points).simplices]
        offsets = np.max(normals @ corner_points.T, axis=1)[:, None]
        shape = _Convex(corner_points, normals)
        return cls(corners, lambda points: np.asarray(np.max(normals @ points.T - offsets, axis=0)), shape)


@dataclass(frozen=True)
class _Convex:
    """Convex solid: corners (n, 3), metres, and unit normals (m, 3) of its faces."""

    corners: FloatArray
    normals: FloatArray

    def in_frame(self, pose: FloatArray) -> _Convex:
        """Return the solid in the coordinates of a frame, given the frame's pose (4, 4)."""
        return _Convex((self.corners - pose[:3, 3]) @ pose[:3, :3], self.normals @ pose[:3, :3])


def _solid_of_shape(shape: CollisionShape, as_hull: bool) -> _Solid:
    """Return the solid of a collision shape, or of its convex hull."""
    vertices, faces = np.asarray(shape.mesh.vertices, dtype=float), np.asarray(shape.mesh.faces)
    hull = _convex_hull(vertices) if as_hull else None
    return _Solid.of(vertices, faces) if hull is None else _Solid.of_hull(hull, vertices[hull.simplices])


def _obstacles(constraints: Sequence[PlacementConstraint]) -> Iterator[LinkObstacle]:
    """Yield the tables and obstacles among given constraints, without the required clearances."""
    for constraint in constraints:
        if isinstance(constraint, Table):
            distance = partial(_height_above, constraint.height)
            yield LinkObstacle(TABLE, distance, distance, np.zeros((0, 3)))
        elif isinstance(constraint, Obstacle) and isinstance(constraint.body, Body):
            pose = np.eye(4)
            pose[:3, :3] = constraint.rotation
            pose[:3, 3] = 0.0 if constraint.position is None else np.asarray(constraint.position, dtype=float)
            inverse = np.asarray(np.linalg.inv(pose), dtype=float)
            yield _solid_body(constraint.name, constraint.body).in_frame(inverse)


def _height_above(height: float, points: FloatArray) -> FloatArray:
    """Return the height of points (m, 3) above a table."""
    return np.asarray(points[:, 2] - height)


def _solid_body(name: str, body: Body) -> LinkObstacle:
    """Return a body as an obstacle for links.

    The first-order distance ``h / |grad h|`` of a curved body is exact near its surface and too deep inside; that from
    its triangles is too small by their distance from the surface, anywhere. Both are lower bounds, so the larger holds.
    """
    if isinstance(body, Mesh):
        corners, faces = np.asarray(body.mesh.vertices, dtype=float), np.asarray(body.mesh.faces)
        convex = _Solid.of(corners, faces).convex if len(corners) <= CONVEX_TEST_CORNERS else None
        return LinkObstacle(name, body.clearance, body.clearance, _thin_out(corners), convex)
    rng = np.random.default_rng(0)
    sampled = np.concatenate([body.sample(face, SAMPLES, rng) for face in body.face_names])
    surface = body.triangles()
    solid = _Solid.of(*(triangles(body, IMPLICIT_TRIANGLES) if surface is None else surface))
    distance = solid.distance
    error = max(0.0, float(np.max(distance(sampled), initial=0.0)))

    def fast(points: FloatArray) -> FloatArray:
        return distance(points) - error

    points = _thin_out(solid.corners.reshape(-1, 3))
    if surface is None:  # the growth of an implicit function away from its surface is unknown
        return LinkObstacle(name, fast, fast, points, solid.convex)
    return LinkObstacle(name, fast, lambda p: np.maximum(body.signed_distance(p), fast(p)), points, solid.convex)


def _thin_out(points: FloatArray) -> FloatArray:
    """Return about ``BATCH`` of the points (n, 3), evenly chosen, the outermost ones included."""
    directions = directions_around(np.eye(3)[2], ALL_DIRECTIONS)
    outermost = points[np.unique(np.argmax(points @ directions.T, axis=0))]
    return np.concatenate([points[:: max(1, len(points) // BATCH)], outermost])


def _convex_hull(vertices: FloatArray) -> ConvexHull | None:
    """Return the convex hull of points (n, 3); None if they are coplanar."""
    try:
        return ConvexHull(vertices)
    except QhullError:
        return None


def _penetration_depth(solid: _Convex, other: _Convex) -> float:
    """Return the penetration depth of two convex solids, metres, 0 if apart.

    It is the shortest separating translation. That is the least overlap of their extents over directions: among the
    normals of both, then near the best of them.
    """

    def overlap(directions: FloatArray) -> FloatArray:
        return np.asarray(np.max(solid.corners @ directions.T, axis=0) - np.min(other.corners @ directions.T, axis=0))

    directions = np.concatenate([solid.normals, -other.normals, directions_around(np.eye(3)[2], ALL_DIRECTIONS)])
    values = overlap(directions)
    best, least, angle = directions[int(np.argmin(values))], float(np.min(values)), ANGLES[0]
    while angle >= ANGLES[1] and least > 0.0:
        closer = directions_beside(best, angle, CLOSER_DIRECTIONS)
        values = overlap(closer)
        if np.min(values) < least:
            best, least = closer[int(np.argmin(values))], float(np.min(values))
        else:
            angle /= 2.0
    return max(0.0, least)


def _are_separated(solid: _Convex, other: _Convex) -> bool:
    """Return whether a plane among a few candidates separates two convex solids."""
    between = other.corners.mean(axis=0) - solid.corners.mean(axis=0)
    normals = [s.normals if len(s.normals) <= MOST_AXES else DIRECTIONS for s in (solid, other)]
    directions = np.concatenate([between[None], normals[0], -normals[1]])
    return bool(np.any(np.max(solid.corners @ directions.T, axis=0) < np.min(other.corners @ directions.T, axis=0)))


def _deepest_points(distance: Distance, corners: FloatArray) -> FloatArray:
    """Return the points (m, 3) of a surface inside an obstacle, deepest first.

    Triangles (m, 3, 3) are divided as long as they can hold a point that is deeper than the deepest known one: a
    signed distance changes by no more than a point moves.
    """
    best, records = 0.0, [np.zeros((0, 4))]
    while len(corners):
        centres = corners.mean(axis=1)
        reach = np.max(np.linalg.norm(corners - centres[:, None], axis=2), axis=1)
        depth = -distance(centres)
        records.append(np.column_stack([depth, centres])[depth > 0.0])
        best = max(best, float(np.max(depth)))
        promise = depth + reach
        promising = np.flatnonzero(
            (promise > best + max(DEPTH_ACCURACY[0], DEPTH_ACCURACY[1] * best)) & (promise > 0.0)
        )
        corners = _subdivide(corners[promising[np.argsort(-promise[promising], kind="stable")][:BATCH]])
    points = np.concatenate(records)
    return points[np.argsort(-points[:, 0], kind="stable"), 1:]


def _points_near(point: FloatArray, radius: float, corners: FloatArray) -> FloatArray:
    """Return points (m, 3) all over the part of a surface within a radius of a point, metres.

    Triangles (m, 3, 3) are divided until they are small against the radius; the points are their centres.
    """
    while len(corners):
        centres = corners.mean(axis=1)
        reach = np.max(np.linalg.norm(corners - centres[:, None], axis=2), axis=1)
        distances = np.linalg.norm(centres - point, axis=1)
        is_near, is_small = distances - reach < radius, reach < FINE * radius
        if np.all(is_small[is_near]):
            return np.asarray(centres[is_near & (distances < radius)])
        corners = np.concatenate([corners[is_near & is_small], _subdivide(corners[is_near & ~is_small])])
    return np.zeros((0, 3))


def _subdivide(corners: FloatArray) -> FloatArray:
    """Return triangles (m, 3, 3) subdivided into four each."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, bc, ca = (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0
    return np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])


def _deepest_inside(first_distance: Distance, second_distance: Distance, points: FloatArray) -> float:
    """Return the largest sum of depths in two solids, metres, by pattern search from given points (m, 3)."""

    def depth_sum(points: FloatArray) -> FloatArray:
        a, b = first_distance(points), second_distance(points)
        return np.where(np.maximum(a, b) <= SURFACE_TOLERANCE, a + b, 0.0)

    best = points
    value, step = depth_sum(best), SEARCH_STEPS[0]
    while step >= SEARCH_STEPS[1]:
        trial = best[:, None] + step * DIRECTIONS
        values = depth_sum(trial.reshape(-1, 3)).reshape(trial.shape[:2])
        index = np.argmin(values, axis=1)
        rows = np.arange(len(best))
        is_better = values[rows, index] < value
        best = np.where(is_better[:, None], trial[rows, index], best)
        value = np.where(is_better, values[rows, index], value)
        step = step if np.any(is_better) else step / 2.0
    return max(0.0, float(-np.min(value)))
