"""Clearances of a hand's links from body, obstacles and each other, with bounds between postures.

Links are the collision shapes of the robot file (``LinkParts``). The clearance of a part from the body is the least of
the body's distance at samples of the part and of the part's distance at points of the body's edges and vertices.

While the joints go from q to q + d on a straight line, a turning joint j moves a point of a link by at most
``|d_j| R_j``, where R_j bounds the distance of the point from the joint's axis: the lengths of all links between them,
with what sliding joints add, and the point's own distance from its link's origin (triangle inequality). A sliding joint
moves it by ``|d_j|``. The length of the point's path is then at most ``sum_j |d_j| R_j``, in any posture.

The distance to an obstacle changes by no more than the part moves. Where a part has the clearances a and b in two
postures, and no point of it moves along a path longer than l from one to the other, then after a part s of the path
the clearance is at least ``max(a - s, b - (l - s)) >= (a + b - l) / 2``. For two parts of the hand the lengths of both
paths are added. A step is halved until the bound shows that no part penetrates by more than a tolerance; where both
ends are clear, any step with ``l`` up to twice the tolerance does.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import cached_property

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.bodies.distance_grid import distance_grid
from nlpgrasp.bodies.mesh.display_triangles import triangles
from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.hands.moving_links import Frames, HandState
from nlpgrasp.motion.distance_fields import Distance, build_distance_fields
from nlpgrasp.motion.link_parts import BinnedPoints, LinkParts, sharp_edge_points
from nlpgrasp.problem.problem import GraspProblem

TOLERANCE = 1e-3  # tolerated penetration of a link, as a share of the hand's span
CURVED = 1.5  # longest path of a joint in a linkage between two near postures, over the straight one
TIP_SHARE = 0.2  # tolerated penetration of a round tip in the body, as a share of its radius, as in the program


class HandClearance:
    """Clearances of a hand's links from the body, the obstacles of the problem's constraints, and each other.

    They are one array: those of each part from each field, one field after another, then those of pairs of parts.

    Parameters
    ----------
    problem : GraspProblem
        With a URDF hand; the constraints on links, such as tables and obstacles, are its obstacles.
    hand : URDFHand
    parts : LinkParts, optional
        Of the hand, where they exist already.

    Attributes
    ----------
    tolerance : float
        Tolerated penetration at the postures of a path, metres.
    between : float
        Penetration between them that cannot be excluded, at most, metres.
    parts : LinkParts
    pairs : (r, 2) int array
        The pairs of parts whose clearances are computed.
    """

    def __init__(self, problem: GraspProblem, hand: URDFHand, parts: LinkParts | None = None) -> None:
        self.hand, self.body, self.parts = hand, problem.body, parts or LinkParts(hand)
        self.fields = build_distance_fields(problem.body, problem.constraints, hand.count)
        self.tolerance, self.between = TOLERANCE * hand.tree.span, 1e-3
        self._chosen = np.arange(len(self.parts.parts))  # parts whose clearances from fields are computed
        self.pairs = self.parts.pairs

    def for_joints(self, joints: IntArray) -> HandClearance:
        """Return the model restricted to the parts that given free joints move."""
        result, moves = copy(self), np.any(self.motion_bounds[:, joints] > 0.0, axis=1)
        result._chosen, result.pairs = np.flatnonzero(moves), self.pairs[np.any(moves[self.pairs], axis=1)]
        return result

    def for_palm_motion(self) -> HandClearance:
        """Return the model without self-collision, for motions of the palm alone."""
        result = copy(self)
        result.pairs = self.pairs[:0]
        return result

    def with_room(self, index: int, room: float) -> HandClearance:
        """Return the model with one distance field increased by a length, metres, as if its solid were farther away."""
        result = copy(self)
        result.fields = [field.with_room(room) if i == index else field for i, field in enumerate(self.fields)]
        return result

    def clearances(self, values: Values) -> FloatArray:
        """Return all clearances minus the required ones, (n,), metres; negative if something is too near."""
        return np.asarray(self.clearances_of([values])[0])

    def clearances_of(self, postures: Sequence[Values]) -> FloatArray:
        """Return the clearances in each of several postures, (b, n), metres."""
        frames = self.parts.frames_of(postures)
        distances = [self.field_clearances(number, frames) for number in range(len(self.fields))]
        return np.column_stack([*distances, [self.parts.pair_distances(posture, self.pairs) for posture in frames]])

    def field_clearances(self, number: int, frames: FloatArray) -> FloatArray:
        """Return the clearances (b, p) of the parts from a field, metres, given their links' frames (b, n, 4, 4).

        The least one of a posture, and those below a quarter of a part's size, are measured; the others are those of
        balls around the parts, which are less.
        """
        chosen, field = self._chosen, self.fields[number]
        if not len(chosen):
            return np.zeros((len(frames), 0))
        reaches, centres = self.parts.reaches[chosen], self.parts.ball_centres(frames)[:, chosen]
        distance = self._far_distance if number == 0 else field.distance
        result = distance(centres.reshape(-1, 3)).reshape(centres.shape[:2]) - reaches
        is_due, is_measured = result < 0.25 * reaches, np.zeros(result.shape, bool)
        while np.any(is_due & ~is_measured):
            which, new = np.nonzero(is_due & ~is_measured)
            close = np.inf if np.any(is_measured) else 3e-3
            result[which, new] = self._measured(number, chosen[new], frames[which, chosen[new]], close)
            is_measured |= is_due
            is_due[np.arange(len(result)), np.argmin(result, axis=1)] = True
        return np.asarray(result)

    def first_entry(self, postures: Sequence[Values], limits: FloatArray) -> tuple[int, int] | None:
        """Return a posture in which a part is in the body, deeper than limits (n,), and the clearance's index.

        It is the first posture in which outermost points of parts, all of them looked up at once, are surely too deep;
        None where there is none, which says nothing of other points.
        """
        count, grid = len(self._chosen), distance_grid(self.body)
        points, parts = self.parts.outermost
        place = np.full(len(self.parts.parts), -1)
        place[self._chosen] = np.arange(count)
        points, parts = points[place[parts] >= 0], parts[place[parts] >= 0]
        if not len(points):
            return None
        frames = self.parts.frames_of(postures)[:, parts]
        moved = (frames[..., :3, :3] @ points[:, :, None])[..., 0] + frames[..., :3, 3]
        spare = grid.nearest(moved) + grid.spacing - self.parts.radii[parts] - limits[place[parts]]
        entered = np.flatnonzero(np.min(spare, axis=1) < 0.0)
        return (int(entered[0]), int(place[parts[np.argmin(spare[entered[0]])]])) if len(entered) else None

    def exact_distance(self, number: int) -> Distance:
        """Return the distance of a field, of a mesh as its triangles state it."""
        return self.body.clearance if number == 0 and isinstance(self.body, Mesh) else self.fields[number].distance

    def link_distances(self, number: int, values: Values, most: float = 0.05) -> dict[str, float]:
        """Return the distance of each link from a field's solid, metres, up to the most that is told apart."""
        frames, all_parts, result = self.parts.frames(values), np.arange(len(self.parts.parts)), dict[str, float]()
        if len(all_parts):
            distance, required = self.exact_distance(number), self.fields[number].clearance
            measured = self.parts.nearest_samples(all_parts, frames, distance)[0] + required
            near = np.flatnonzero(measured < 3e-3) if number == 0 else all_parts[:0]
            measured[near] = np.minimum(measured[near], self._measured(0, near, frames[near], np.inf))
            for part, value in zip(self.parts.parts, measured.tolist(), strict=True):
                result[part.link] = min(result.get(part.link, most), value)
        return result

    def nearest_point(self, number: int, link: str, values: Values) -> FloatArray:
        """Return the point (3,) of a link's shapes that is nearest to a field's solid, metres, link frame."""
        parts = [i for i, part in enumerate(self.parts.parts) if part.link == link]
        frame, distance = self.parts.frames(values)[parts[0]], self.fields[number].distance
        _, samples = self.parts.nearest_samples(np.array(parts), np.repeat(frame[None], len(parts), axis=0), distance)
        points = [(samples - frame[:3, 3]) @ frame[:3, :3]]
        if number == 0:
            body = (self._body_points - frame[:3, 3]) @ frame[:3, :3]
            for i in parts:
                part = self.parts.parts[i]
                first = body[np.argmin(part.distance(body))]
                nearest = part.points[0] if part.radius > 0.0 else part.tree.nearest(first[None])[2][0]
                along = (first - nearest) / max(float(np.linalg.norm(first - nearest)), 1e-9)
                points.append((nearest + part.radius * along)[None])
        candidates = np.concatenate(points)
        return np.asarray(candidates[np.argmin(distance(candidates @ frame[:3, :3].T + frame[:3, 3]))])

    def rows(self, values: Values, reach: float = 0.01) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return the clearances below a reach, metres: indices (r,), values (r,), derivatives by the twist (r, 6 + m).

        The twist is that of ``Frames.rows``, about the palm's origin. A part is as near to a field as its nearest
        sample.
        """
        frames, count, moving = self.parts.frames(values), len(self._chosen), self.moving_frames(values)
        indices, result, slopes = [np.zeros(0, int)], [np.zeros(0)], [np.zeros((0, moving.links.size))]
        grid = distance_grid(self.body) if isinstance(self.body, Mesh) else None
        centres = self.parts.ball_centres(frames)[self._chosen]
        for number, field in enumerate(self.fields):
            distance = self._far_distance if number == 0 else field.distance
            near = np.flatnonzero(distance(centres) - self.parts.reaches[self._chosen] < reach)
            if len(near):
                parts = self._chosen[near]
                value, x = self.parts.nearest_samples(
                    parts, frames[parts], field.distance, grid if number == 0 else None, close=reach
                )
                indices.append(number * count + near)
                result.append(value)
                slopes.append(self.point_slopes(field.distance, x, [self.parts.parts[i].link for i in parts], moving))
        pairs, value, by_twist = self.pair_rows(values, self.pairs, reach)
        indices.append(len(self.fields) * count + pairs)
        result.append(value)
        slopes.append(by_twist)
        values_of_all = np.concatenate(result)
        below = values_of_all < reach
        return np.concatenate(indices)[below], values_of_all[below], np.concatenate(slopes)[below]

    def point_slopes(
        self, distance: Distance, x: FloatArray, links: Sequence[str], moving: Frames, step: float = 1e-6
    ) -> FloatArray:
        """Return the derivatives by the twist, (n, 6 + m), of the distance at points (n, 3) fixed to links.

        The twist is about the palm's origin; ``moving`` are the frames of one posture.
        """
        steps = step * np.concatenate([np.eye(3), -np.eye(3)])
        ahead, behind = distance((x + steps[:, None]).reshape(-1, 3)).reshape(2, 3, -1)
        groups = np.array([moving.links.group[link] for link in links], int)
        return moving.rows(x, groups, (ahead - behind).T / (2.0 * step), moving.t[:, 0], np.zeros(len(x), int))

    def pair_rows(self, values: Values, pairs: IntArray, reach: float) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return the distances of pairs (r, 2) of parts below a reach, metres, as ``rows`` does."""
        moving = self.moving_frames(values)
        groups = np.array([moving.links.group[part.link] for part in self.parts.parts], int)
        _, index, value, ends, n = self.parts.near_pairs(self.parts.frames(values)[None], pairs, reach)
        one = np.zeros(len(index), int)
        first, second = (moving.rows(ends[:, i], groups[pairs[index, i]], n, moving.t[:, 0], one) for i in range(2))
        return index, value, second - first

    def body_point_rows(
        self, parts: IntArray, points: Sequence[tuple[float, float, float]], moving: Frames
    ) -> tuple[FloatArray, FloatArray]:
        """Return the distances of points (m, 3) of the body from parts (m,), as ``rows`` does."""
        links = [self.parts.parts[i].link for i in parts]
        x, value, normals = np.asarray(points), np.zeros(len(parts)), np.zeros((len(parts), 3))
        for row, (i, frame) in enumerate(zip(parts, moving.of_links(links)[0], strict=True)):
            local = (x[row] - frame[:3, 3]) @ frame[:3, :3]
            distance, normal = self.parts.parts[i].distance_with_normals(local[None])
            value[row], normals[row] = distance[0], frame[:3, :3] @ normal[0]
        groups = np.array([moving.links.group[link] for link in links], int)
        return value, -moving.rows(x, groups, normals, moving.t[:, 0], np.zeros(len(parts), int))

    def moving_frames(self, values: Values) -> Frames:
        """Return the frames of the hand's groups of links in one posture, which tell how points on them move."""
        return self.hand.tree.moving_links.frames(HandState.of_values(values))

    def _far_distance(self, points: FloatArray) -> FloatArray:
        """Return a distance (m,) of points (m, 3) from the body quickly, metres: nowhere more than its own."""
        if not isinstance(self.body, Mesh):
            return self.fields[0].distance(points)
        lower, upper = self.body.bounds
        from_box = np.linalg.norm(np.maximum(np.maximum(lower - points, points - upper), 0.0), axis=1)
        grid = distance_grid(self.body)
        return np.asarray(
            np.where(from_box > 0.02, from_box, np.maximum(from_box, grid.nearest(points) - grid.spacing))
        )

    def _measured(self, number: int, chosen: IntArray, frames: FloatArray, close: float) -> FloatArray:
        """Return the clearances (p,) of chosen parts from a field, metres, by samples and points of the body.

        ``frames`` (p, 4, 4) are those of their links.
        """
        field = self.fields[number]
        if number > 0:
            return self.parts.nearest_samples(chosen, frames, field.distance)[0]
        grid = distance_grid(self.body) if isinstance(self.body, Mesh) else None
        result = self.parts.nearest_samples(chosen, frames, field.distance, grid, close=close)[0]
        for i in np.flatnonzero(result < 2e-3):  # farther away points of the body do not lower it
            part, local = self.parts.parts[chosen[i]], (self._body_points - frames[i, :3, 3]) @ frames[i, :3, :3]
            gaps = local - self.parts.centres[chosen[i]]
            near = np.einsum("ij,ij->i", gaps, gaps) < (self.parts.reaches[chosen[i]] + result[i]) ** 2
            result[i] = np.min(part.distance(local[near], float(result[i])), initial=result[i])
        return result

    @cached_property
    def body_edges(self) -> BinnedPoints:
        """Points of the body's sharp edges, some 1.5 mm apart, metres: links meet them between samples of their own."""
        points = self._edge_points
        _, first = np.unique(np.floor(points / 1.5e-3), axis=0, return_index=True)
        return BinnedPoints.of([points[first]])

    @cached_property
    def _edge_points(self) -> FloatArray:
        """Points of the body's sharp edges, (m, 3), metres."""
        edges = sharp_edge_points(*self._body_surface, 1.5e-3)
        return edges[:: 1 + len(edges) // 4000]

    @cached_property
    def _body_surface(self) -> tuple[FloatArray, IntArray]:
        """Vertices (n, 3), metres, and triangles (m, 3) of the body."""
        if isinstance(self.body, Mesh):
            return np.asarray(self.body.mesh.vertices), np.asarray(self.body.mesh.faces)
        surface = self.body.triangles()
        return triangles(self.body, 20_000) if surface is None else surface

    @cached_property
    def _body_points(self) -> FloatArray:
        """Points of the body's sharp edges, and vertices of a mesh, (m, 3), metres."""
        vertices = self._body_surface[0]
        return np.concatenate([self._edge_points, vertices[:: 1 + len(vertices) // 1000]])

    def clearance_change_bounds(self, before: Values, after: Values) -> FloatArray:
        """Return an upper bound on the change of each clearance between two postures, (n,), metres."""
        lengths = self.path_length_bounds(before, after)
        shift = float(np.linalg.norm(after["palm_position"] - before["palm_position"]))
        i, j = self.pairs.T
        return np.concatenate([*[lengths[self._chosen]] * len(self.fields), lengths[i] + lengths[j] - 2.0 * shift])

    def clearance_bounds(self, before: Values, after: Values, ends: tuple[FloatArray, FloatArray]) -> FloatArray:
        """Return a lower bound on each clearance along the path between two postures, (n,), metres.

        ``ends`` are the clearances in these postures.
        """
        a, b = ends
        return np.asarray((a + b - self.clearance_change_bounds(before, after)) / 2.0)

    def path_length_bounds(self, before: Values, after: Values) -> FloatArray:
        """Return a bound on the path length of each part's points between two postures, (parts,), metres.

        The path is straight in joint space, or near to that where linkages stay closed. The palm may move along, but
        not turn.
        """
        shift = float(np.linalg.norm(after["palm_position"] - before["palm_position"]))
        curved = CURVED if self.hand.closed_linkages else 1.0
        return np.asarray(self.motion_bounds @ (curved * np.abs(after["joints"] - before["joints"])) + shift)

    @cached_property
    def motion_bounds(self) -> FloatArray:
        """Bound on how far each part's points move per unit of each free joint, (parts, joints), metres."""
        farthest = np.linalg.norm(self.parts.centres, axis=1) + self.parts.reaches
        names = [part.link for part in self.parts.parts]
        bounds = [point_motion_bounds(self.hand, *pair) for pair in zip(names, farthest.tolist(), strict=True)]
        return np.array(bounds).reshape(len(names), len(self.hand.robot.free_joints))

    def body_mask(self) -> BoolArray:
        """Return which clearances are from the body, (n,)."""
        return np.arange(self.from_fields() + len(self.pairs)) < len(self._chosen)

    def tip_mask(self) -> BoolArray:
        """Return which clearances are between a fingertip's link and the body, (n,)."""
        other_count = (len(self.fields) - 1) * len(self._chosen) + len(self.pairs)
        return np.concatenate([self.parts.tips[self._chosen], np.zeros(other_count, bool)])

    def least_clearances(self) -> FloatArray:
        """Return the least admissible clearances, (n,), metres: zero, or negative for fingertips on the body."""
        limits = np.zeros(len(self.fields) * len(self._chosen) + len(self.pairs))
        groups = self.hand.robot.rigid_groups
        standoffs = {groups[link]: tip.standoff for link, tip in self.hand.tips}
        for number, i in enumerate(self._chosen):
            if self.parts.tips[i]:
                limits[number] = -max(TIP_SHARE * standoffs[groups[self.parts.parts[i].link]], self.tolerance)
        return limits

    def from_fields(self) -> int:
        """Return the number of clearances from fields, which come before those of pairs."""
        return len(self.fields) * len(self._chosen)

    def describe_clearance(self, index: int) -> str:
        """Return the part and the obstacle of a clearance, as text."""
        count = len(self._chosen)
        if index < self.from_fields():
            field, part = divmod(index, count)
            return f"{self._part_name(int(self._chosen[part]))} against {self.fields[field].name}"
        i, j = self.pairs[index - self.from_fields()]
        return f"{self._part_name(int(i))} against {self._part_name(int(j))}"

    def moving_joints(self, index: int) -> BoolArray:
        """Return the mask (m,) of the free joints that move the part or the two parts of a clearance."""
        count = self.from_fields()
        moved = [self._chosen[index % len(self._chosen)]] if index < count else self.pairs[index - count]
        return np.asarray(np.any(self.motion_bounds[moved] > 0.0, axis=0))

    def _part_name(self, part: int) -> str:
        """Return the name of a part: that of its link or fingertip."""
        link = self.parts.parts[part].link
        return f"fingertip {link}" if any(link == name for name, _ in self.hand.tips) else f"link {link}"


def point_motion_bounds(hand: URDFHand, link: str, distance: float) -> FloatArray:
    """Return a bound on how far a link's points move per unit of each free joint, (joints,), metres.

    Parameters
    ----------
    hand : URDFHand
    link : str
    distance : float
        Largest distance of the points from the origin of the link's frame, metres.
    """
    robot, length = hand.robot, distance
    index = {joint.name: i for i, joint in enumerate(robot.free_joints)}
    result = np.zeros(len(index))
    for joint in reversed(robot.chain(link)):
        if joint.moves:
            driver, multiplier, _ = robot.driving_joint(joint)
            result[index[driver]] += abs(multiplier) * (length if joint.is_revolute else 1.0)
            length += 0.0 if joint.is_revolute else max(abs(joint.lower), abs(joint.upper))
        length += float(np.linalg.norm(joint.xyz))
    return result
