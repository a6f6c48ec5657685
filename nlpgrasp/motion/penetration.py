"""Penetration depth of a hand's links in body, surroundings and each other, by collision shapes.

The depth is the larger of two measures:

- ``max over x of d_L(x) + d_T(x)`` for a link L and an obstacle T (the body, a table, another link), where ``d`` is the
  distance of a point of a solid from the solid's surface. It is at least the depth of any point of one surface inside
  the other solid, and at most the shortest separating translation: balls of radius ``d_L(x)`` and ``d_T(x)`` about x
  lie inside them, and a translation that separates two balls with one centre is as long as the sum of their radii.
- For convex solids that intersect, the shortest separating translation itself: for thin plates that cross it is long.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.distance import cdist

from nlpgrasp.bodies import Body, Mesh
from nlpgrasp.bodies.distance_grid import distance_grid
from nlpgrasp.bodies.mesh.display_triangles import triangles
from nlpgrasp.common.meshes.search_tree import SearchTree
from nlpgrasp.common.unit_directions import directions_around, directions_beside
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.constraints import Obstacle, PlacementConstraint, Table
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.link_parts import LinkParts
from nlpgrasp.motion.straight_path import PathPosture
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.obstructions import BODY, LEAST_DEPTH, TABLE, TOLERANCE, LinkPenetration, link_name

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
    parts : LinkParts, optional
        Of the hand, where they exist already or shapes count as their hulls.
    """

    def __init__(
        self,
        problem: GraspProblem,
        hand: URDFHand,
        tolerance: float = TOLERANCE,
        parts: LinkParts | None = None,
    ) -> None:
        self.hand, self.tolerance, self.parts = hand, tolerance, parts or LinkParts(hand)
        self.obstacles = [_solid_body(BODY, problem.body), *_obstacles(problem.constraints)]
        self._body = problem.body
        self._shaped = [i for i, part in enumerate(self.parts.parts) if part.shape is not None]
        self._last: dict[str, tuple[bytes, list[LinkPenetration]]] = {}  # of the last posture, often asked again

    @property
    def has_shapes(self) -> bool:
        """Whether any link has a collision shape."""
        return bool(self._shaped)

    @property
    def has_convex_shapes(self) -> bool:
        """Whether each shape is its own convex hull."""
        return all(self.parts.parts[i].is_convex for i in self._shaped)

    def in_posture(self, values: Values) -> LinkPenetration:
        """Return the deepest penetration in one posture, given values of the hand's variables."""
        return self._deepest(self.in_surroundings(values) + self.in_each_other(values))

    def in_each_other(self, values: Values) -> list[LinkPenetration]:
        """Return the penetrations of links in each other in one posture."""
        joints = np.asarray(values["joints"], dtype=float)

        def penetrations() -> list[LinkPenetration]:
            depths = self._depths_in_each_other(joints)
            return [
                LinkPenetration(depth, pair[0], link_name(pair[1]), self.tolerance)
                for pair, depth in depths.items()
                if depth > LEAST_DEPTH
            ]

        return self._remember("links", joints.tobytes(), penetrations)  # an approach does not change the joints

    def in_surroundings(self, values: Values) -> list[LinkPenetration]:
        """Return the penetrations of links in the body and its surroundings in one posture."""
        key = b"".join(np.asarray(value, dtype=float).tobytes() for value in values.values())
        return self._remember("surroundings", key, lambda: self._surrounding_penetrations(values))

    def _remember(self, what: str, key: bytes, compute: Callable[[], list[LinkPenetration]]) -> list[LinkPenetration]:
        """Return the penetrations of a posture, which are computed once for the same one."""
        if what not in self._last or self._last[what][0] != key:
            self._last[what] = key, compute()
        return self._last[what][1]

    def _depths_in_each_other(self, joints: FloatArray) -> dict[tuple[str, str], float]:
        """Return the penetration depths of pairs of links, metres; pairs that are apart are left out."""
        names, result = [part.link for part in self.parts.parts], dict[tuple[str, str], float]()
        frames = self.parts.palm_frames(joints[None])[0]
        distances = self.parts.pair_distances(frames, self.parts.pairs)
        for (i, j), distance in zip(self.parts.pairs.tolist(), distances.tolist(), strict=True):
            if distance < 0.0:
                pair = names[i], names[j]
                is_convex = self.parts.parts[i].is_convex and self.parts.parts[j].is_convex
                depth = (
                    -distance if is_convex else self._mesh_depth(i, j, np.asarray(np.linalg.inv(frames[j]) @ frames[i]))
                )
                result[pair] = max(result.get(pair, 0.0), depth)
        return result

    def _mesh_depth(self, i: int, j: int, pose: FloatArray) -> float:
        """Return the depth of two parts in each other, metres; ``pose`` is that of the first in the other's frame."""
        other = self.parts.parts[j]
        obstacle = LinkObstacle("", other.distance, other.distance, other.points)
        return self._depth_in(obstacle.in_frame(pose), i, np.eye(4))

    def _surrounding_penetrations(self, values: Values) -> list[LinkPenetration]:
        frames, depths = self.parts.frames(values), dict[tuple[str, str], float]()
        centres = self.parts.ball_centres(frames)
        for obstacle in self.obstacles if len(centres) else ():
            reaching = obstacle.fast_distance(centres) < self.parts.reaches
            for i in (i for i in self._shaped if reaching[i]):
                depth = self._depth_in(obstacle, i, frames[i])
                key = self.parts.parts[i].link, obstacle.name
                depths[key] = max(depths.get(key, 0.0), depth)
        return [LinkPenetration(depth, *key, self.tolerance) for key, depth in depths.items() if depth > 0.0]

    def _depth_in(self, obstacle: LinkObstacle, index: int, frame: FloatArray) -> float:
        """Return the penetration depth of a part of a link in an obstacle, metres, 0 if apart."""
        part = self.parts.parts[index]
        starts = self._deepest_samples(obstacle, index, frame)
        centre, reach = frame[:3, :3] @ self.parts.centres[index] + frame[:3, 3], self.parts.reaches[index]
        inside = obstacle.points[np.linalg.norm(obstacle.points - centre, axis=1) < reach]
        if len(inside):
            distances = part.distance((inside - frame[:3, 3]) @ frame[:3, :3], 0.0)
            order = np.argsort(distances, kind="stable")[:3]
            starts = np.concatenate([starts, inside[order[distances[order] < 0.0]]])
        if not len(starts):
            return 0.0
        siblings = [self.parts.parts[i] for i in self._shaped if self.parts.parts[i].link == part.link]

        def in_link(points: FloatArray) -> FloatArray:
            local = (points - frame[:3, 3]) @ frame[:3, :3]
            return np.asarray(np.min([sibling.distance(local) for sibling in siblings], axis=0))

        depth = _deepest_inside(obstacle.exact_distance, in_link, starts)
        if depth > 0.0 and obstacle.convex is not None and part.is_convex and part.shape is not None:
            corners = np.asarray(part.shape.mesh.vertices) @ frame[:3, :3].T + frame[:3, 3]
            depth = max(depth, _penetration_depth(_Convex(corners, part.normals @ frame[:3, :3].T), obstacle.convex))
        return depth

    def _deepest_samples(self, obstacle: LinkObstacle, index: int, frame: FloatArray) -> FloatArray:
        """Return the deepest samples (m, 3) of a part's surface in an obstacle, deepest first, and at most three."""
        part, points = self.parts.parts[index], self.parts.points(index, frame)
        if part.radius > 0.0:  # towards the obstacle
            points = points + part.radius * directions_around(np.eye(3)[2], 400)
        if obstacle.name == BODY:
            grid = distance_grid(self._body)
            coarse = grid.nearest(points)
            points = points[coarse < min(float(np.min(coarse)) + 2.0 * grid.spacing, grid.spacing)]
            points = points[np.argsort(grid.distance(points)[0])[:16]]
        distances = obstacle.fast_distance(points)
        order = np.argsort(distances, kind="stable")[:3]
        return np.asarray(points[order[distances[order] < 0.0]])

    def points_inside(self, values: Values, penetration: LinkPenetration) -> FloatArray:
        """Return points of a link's surface about the deepest one in an obstacle, (m, 3), metres, link frame.

        They are about as far apart as the link is deep, so that an edge of the obstacle between them is half as deep.
        The deepest point comes first; each of the others is the farthest from those before it.
        """
        obstacle = next(obstacle for obstacle in self.obstacles if obstacle.name == penetration.thing)
        frames, link = self.parts.frames(values), str(penetration.link)
        of_link = [i for i in self._shaped if self.parts.parts[i].link == link]
        deepest: FloatArray = np.concatenate([self._deepest_samples(obstacle, i, frames[i])[:1] for i in of_link])
        if not len(deepest):
            return deepest
        frame = frames[of_link[0]]
        first = deepest[np.argmin(obstacle.fast_distance(deepest))]
        chosen = ((first - frame[:3, 3]) @ frame[:3, :3])[None]
        corners = np.concatenate([self.parts.parts[i].triangles for i in of_link])
        near = _points_near(chosen[0], 2.5 * penetration.depth, corners)
        while 0 < len(chosen) < min(16, len(near)):
            gaps = np.min(cdist(near, chosen), axis=1)
            chosen = np.concatenate([chosen, near[np.argmax(gaps)][None]])
        return np.asarray(chosen)

    def on_way(self, path: Sequence[PathPosture]) -> LinkPenetration:
        """Return the deepest penetration in the postures of a path, of those whose clearances leave one possible."""
        touching = [posture.values for posture in path if np.min(posture.clearances, initial=np.inf) < LEAST_DEPTH]
        return replace(self._deepest([self.in_posture(values) for values in touching]), postures=len(path))

    def _deepest(self, penetrations: Sequence[LinkPenetration]) -> LinkPenetration:
        """Return the deepest of several penetrations; one without depth if there is none."""
        none = LinkPenetration(tolerance=self.tolerance)
        return max(penetrations, key=lambda penetration: penetration.depth, default=none)

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
class _Convex:
    """Convex solid: corners (n, 3), metres, and unit normals (m, 3) of its faces."""

    corners: FloatArray
    normals: FloatArray

    def in_frame(self, pose: FloatArray) -> _Convex:
        """Return the solid in the coordinates of a frame, given the frame's pose (4, 4)."""
        return _Convex((self.corners - pose[:3, 3]) @ pose[:3, :3], self.normals @ pose[:3, :3])


def _signed_distance(vertices: FloatArray, faces: IntArray) -> tuple[Distance, _Convex | None]:
    """Return the signed distance of the solid within a surface, and the solid where it is convex.

    Inside a convex polyhedron the nearest point of its surface is on the nearest of its faces' planes. One with many
    faces is approximated within the planes that support it in 500 directions. Any other surface is searched.
    """
    hull = ConvexHull(vertices)
    corners = vertices[faces]
    volume = float(np.sum(np.linalg.det(corners - corners.mean(axis=(0, 1))))) / 6.0
    if abs(volume) < 0.999 * hull.volume:
        return SearchTree(vertices, faces).exact_signed_distance, None
    normals = np.unique(hull.equations[:, :3].round(6), axis=0)
    if len(normals) > 500:
        normals = directions_around(np.eye(3)[2], 500)
    outermost = hull.points[hull.vertices]
    offsets = np.max(normals @ outermost.T, axis=1)[:, None]
    return lambda points: np.asarray(np.max(normals @ points.T - offsets, axis=0)), _Convex(outermost, normals)


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
        convex = _signed_distance(corners, faces)[1] if len(corners) <= 64 else None
        return LinkObstacle(name, body.clearance, body.clearance, _thin_out(corners), convex)
    rng = np.random.default_rng(0)
    sampled = np.concatenate([body.sample(face, 400, rng) for face in body.face_names])
    surface = body.triangles()
    vertices, faces = triangles(body, 20_000) if surface is None else surface
    distance, convex = _signed_distance(vertices, faces)
    error = max(0.0, float(np.max(distance(sampled), initial=0.0)))

    def fast(points: FloatArray) -> FloatArray:
        return distance(points) - error

    points = _thin_out(vertices)
    if surface is None:  # the growth of an implicit function away from its surface is unknown
        return LinkObstacle(name, fast, fast, points, convex)
    return LinkObstacle(name, fast, lambda p: np.maximum(body.signed_distance(p), fast(p)), points, convex)


def _thin_out(points: FloatArray) -> FloatArray:
    """Return about ``1000`` of the points (n, 3), evenly chosen, the outermost ones included."""
    outermost = points[np.unique([np.argmax(points @ d) for d in directions_around(np.eye(3)[2], 200)])]
    return np.concatenate([points[:: max(1, len(points) // 1000)], outermost])


def _penetration_depth(solid: _Convex, other: _Convex) -> float:
    """Return the penetration depth of two convex solids, metres, 0 if apart.

    It is the shortest separating translation. That is the least overlap of their extents over directions: among the
    normals of both, then near the best of them.
    """

    def overlap(directions: FloatArray) -> FloatArray:
        return np.asarray(np.max(solid.corners @ directions.T, axis=0) - np.min(other.corners @ directions.T, axis=0))

    directions = np.concatenate([solid.normals, -other.normals, directions_around(np.eye(3)[2], 200)])
    values = overlap(directions)
    best, least, angle = directions[int(np.argmin(values))], float(np.min(values)), 0.1
    while angle >= 1e-4 and least > 0.0:
        closer = directions_beside(best, angle, 12)
        values = overlap(closer)
        if np.min(values) < least:
            best, least = closer[int(np.argmin(values))], float(np.min(values))
        else:
            angle /= 2.0
    return max(0.0, least)


def _points_near(point: FloatArray, radius: float, corners: FloatArray) -> FloatArray:
    """Return points (m, 3) all over the part of a surface within a radius of a point, metres.

    Triangles (m, 3, 3) are divided until they are small against the radius; the points are their centres.
    """
    while len(corners):
        centres = corners.mean(axis=1)
        reach = np.max(np.linalg.norm(corners - centres[:, None], axis=2), axis=1)
        distances = np.linalg.norm(centres - point, axis=1)
        is_near, is_small = distances - reach < radius, reach < 0.2 * radius
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
        return np.where(np.maximum(a, b) <= 1e-7, a + b, 0.0)

    best = points
    value = depth_sum(best)
    step = float(np.clip(-np.min(value), 1e-4, 1e-3))
    while step >= 1e-5:
        trial = best[:, None] + step * DIRECTIONS
        values = depth_sum(trial.reshape(-1, 3)).reshape(trial.shape[:2])
        index = np.argmin(values, axis=1)
        rows = np.arange(len(best))
        is_better = values[rows, index] < value
        best = np.where(is_better[:, None], trial[rows, index], best)
        value = np.where(is_better, values[rows, index], value)
        step = step if np.any(is_better) else step / 2.0
    return max(0.0, float(-np.min(value)))
