"""Clearance of a parallel gripper's fingers and palm from part, tables and obstacles, by exact geometry.

A box that moves along one of its own axes sweeps a box. What open fingers and palm sweep on a straight approach, the
fingers while they close, and the closed fingers on the retreat are therefore boxes (``GripperSolids``), in one frame
with axes along closing line, transverse direction and approach. Their signed distances from triangles are exact to
0.02 mm (``common/meshes/box_distance.py``). Curved bodies are triangulated; the largest distance of the triangles
from the surface is subtracted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from nlpgrasp.bodies import Body, Mesh
from nlpgrasp.bodies.mesh.display_triangles import triangles as display_triangles
from nlpgrasp.common.meshes.box_distance import least_box_distance
from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray
from nlpgrasp.constraints import Approach, Obstacle, PlacementConstraint, Table
from nlpgrasp.contacts import ContactModel, LineContact, PlaneContact
from nlpgrasp.contacts.pad import PadContact
from nlpgrasp.hands import ParallelJaw
from nlpgrasp.hands.parallel_jaw import Cone
from nlpgrasp.solution.kept_grasps import DISTINCT_ANGLE
from nlpgrasp.solution.obstructions import BODY, LEAST_PAD_SHARE, TABLE, TOLERANCE

FARTHEST = 0.02  # metres: largest clearance that is computed
TOUCHING = 2e-4  # metres: allowed depth of a finger in the part, by compression of its pad
UNSTATED_TOUCHING = TOLERANCE  # metres: the same for grippers without stated pads or fingers
FACE_DEPTH = 3e-3  # metres behind a pad within which the surface counts as its face
FLAT_DEPTH = 5e-4  # metres: the same where a contact is the whole pad, which touches as far as it yields
LINE_DEPTH = 1e-4  # metres: least depth of short lines
FLAT_AREA = 1e-14  # square metres: projected triangles with less are edge-on
PARALLEL = 1e-3  # least sine of the angle between closing line and a pad's direction, for a defined orientation
PATH_SIZES = 2.0  # length of an approach, in body sizes
SPACE_TO_CLOSE = (np.inf, 0.01, 0.004)  # metres beyond the opening of the grasp that are tried on an approach
SLIDES = (0.0, 0.25, -0.25)  # distances of the tool centre point beyond the contacts, over the pad's length
# barycentric coordinates of a grid of points over a triangle, (15, 3)
GRID = np.array([[i, j, 4 - i - j] for i in range(5) for j in range(5 - i)]) / 4.0
RANKED_CLEARANCE = 0.01  # metres: larger clearances of free poses rank equally


@dataclass(frozen=True)
class Solid:
    """Solid from which a gripper keeps a clearance: the held body, a table or an obstacle.

    Parameters
    ----------
    name : str
        As in ``blocked_by``: ``"the body"``, ``"the table"``, or the obstacle's name.
    clearance : float
        Required clearance, metres.
    triangles : (n, 3, 3) array
        Surface in the body's frame, metres; empty for a table.
    height : float
        Height of a table along the last axis, metres; minus infinity for other solids.
    roughness : float
        Largest distance of the triangles from the surface, metres.
    contains : callable or None
        Function from points (m, 3) to the mask of those inside, (m,); finds boxes inside the solid altogether.
    """

    name: str
    clearance: float = 0.0
    triangles: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    height: float = -np.inf
    roughness: float = 0.0
    contains: Callable[[FloatArray], FloatArray] | None = None

    def distances(self, boxes: FloatArray, rotation: FloatArray, origin: FloatArray) -> FloatArray:
        """Return the signed distance of each box from the solid, minus the required clearance, (b,), metres.

        Parameters
        ----------
        boxes : (b, 2, 3) array
            Corners in a frame, metres.
        rotation : (3, 3) array
            Axes of that frame in the body's, its columns.
        origin : (3,) array
            Of that frame in the body's, metres.
        """
        if np.isfinite(self.height):
            lowest = origin[2] + np.sum(np.minimum(rotation[2] * boxes[:, 0], rotation[2] * boxes[:, 1]), axis=1)
            return np.asarray(np.minimum(lowest - self.height, FARTHEST) - self.clearance)
        triangles = (self.triangles - origin) @ rotation
        lowest_corners, highest_corners = triangles.min(axis=1), triangles.max(axis=1)
        result = np.full(len(boxes), FARTHEST)
        for i, (lower, upper) in enumerate(boxes):
            near = triangles[np.all((lower - highest_corners < FARTHEST) & (lowest_corners - upper < FARTHEST), axis=1)]
            result[i] = least_box_distance(near, lower, upper, FARTHEST)
            if result[i] > 0.0 and self.contains is not None and self.contains((rotation @ upper + origin)[None])[0]:
                result[i] = -float(np.min(upper - lower)) / 2.0
        return result - self.roughness - self.clearance


def build_solids(body: Body, constraints: Iterable[PlacementConstraint]) -> list[Solid]:
    """Return the body, tables and obstacles as solids, in the body frame.

    Bodies in space only.
    """
    solids = [_body_solid(BODY, body, 0.0)]
    for constraint in constraints:
        if isinstance(constraint, Table):
            solids.append(Solid(TABLE, constraint.clearance, height=constraint.height))
        elif isinstance(constraint, Obstacle) and isinstance(constraint.body, Body):
            position = np.zeros(3) if constraint.position is None else np.asarray(constraint.position, dtype=float)
            pose = constraint.rotation, position
            solids.append(_body_solid(constraint.name, constraint.body, constraint.clearance, *pose))
    return solids


def _body_solid(
    name: str,
    body: Body,
    clearance: float,
    rotation: FloatArray | None = None,
    position: FloatArray | None = None,
) -> Solid:
    """Return a body in a given pose as a solid."""
    rotation, position = np.eye(3) if rotation is None else rotation, np.zeros(3) if position is None else position
    corners, roughness = surface_triangles(body)
    contains = partial(_contains, body, rotation, position)
    return Solid(name, clearance, corners @ rotation.T + position, roughness=roughness, contains=contains)


def _contains(body: Body, rotation: FloatArray, position: FloatArray, points: FloatArray) -> FloatArray:
    """Return which points (m, 3) are inside a body in a given pose, (m,)."""
    return np.asarray(body.signed_distance((points - position) @ rotation) < 0.0)


def surface_triangles(body: Body) -> tuple[FloatArray, float]:
    """Return triangles (n, 3, 3) of a body's surface, and their largest distance from the surface, metres.

    The distance is sampled on a grid over each triangle and increased by a twentieth, more than it varies between.
    """
    if isinstance(body, Mesh):
        return np.asarray(body.mesh.triangles, dtype=float), 0.0
    vertices, faces = body.triangles() or display_triangles(body)
    corners = np.asarray(vertices, dtype=float)[faces]
    points = np.einsum("pc,ncs->nps", GRID, corners).reshape(-1, 3)
    return corners, 1.05 * float(np.max(np.abs(body.signed_distance(points))))


@dataclass(frozen=True)
class JawPose:
    """Pose of a parallel gripper at two contacts, with its clearance on a straight approach.

    Parameters
    ----------
    direction : (3,) array
        Unit direction in which the gripper moves to the body, body frame.
    turn : float
        Angle about the closing line from the steepest approach downwards, radians.
    slide : float
        Distance of the tool centre point beyond the contacts along the approach, metres.
    flip : bool
        Whether the jaws are exchanged: the gripper is turned by half a turn about its approach.
    position : (3,) array
        Of the gripper's own frame in the body's, metres.
    rotation : (3, 3) array
        Of the gripper's own frame in the body's.
    opening, opened : float
        Distances between the pads in the grasp and on the approach, metres.
    clearance : float
        Least distance of fingers and palm on the approach, while the jaws close and on the way back with the body, from
        part, tables and obstacles, beyond what these require, metres, at most 0.02; minus the depth where blocked.
        The contact of the closing fingers with the part does not count up to a depth of 0.2 mm.
    blocked_by : mapping of str to float
        Depth in each solid that blocks the approach, metres, by name.
    """

    direction: FloatArray
    turn: float
    slide: float
    flip: bool
    position: FloatArray
    rotation: FloatArray
    opening: float
    opened: float
    clearance: float
    blocked_by: Mapping[str, float]

    @property
    def is_free(self) -> bool:
        """Whether approach, grasp and retreat are free."""
        return not self.blocked_by

    @property
    def matrix(self) -> FloatArray:
        """Pose (4, 4) of the gripper's frame in the body frame, ``[[R, t], [0, 1]]``, metres."""
        return np.block([[self.rotation, self.position[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])


class JawClearance:
    """Clearance of a parallel gripper at given contacts of a body, for all its poses.

    Parameters
    ----------
    gripper : ParallelJaw
    body : Body
        In space.
    constraints : sequence of PlacementConstraint
        Tables, obstacles and cones of the approach among them count.
    models : sequence of ContactModel
        Of the contacts; where they are rectangles, these have to lie flat on their faces, and else the whole pads.
    """

    def __init__(
        self,
        gripper: ParallelJaw,
        body: Body,
        constraints: Sequence[PlacementConstraint],
        models: Sequence[ContactModel] = (),
    ) -> None:
        self.gripper, self.path = gripper, PATH_SIZES * body.size
        self.patches = contact_patches(gripper, models)
        self.touching = UNSTATED_TOUCHING if gripper.pad is None and gripper.finger is None else TOUCHING
        self.solids = build_solids(body, constraints)
        self.cones: list[Cone] = [(np.asarray(c.direction), c.angle) for c in constraints if isinstance(c, Approach)]

    def with_contacts(self, models: Sequence[ContactModel]) -> JawClearance:
        """Return the clearance of the same gripper, body and surroundings with other contacts."""
        other = copy(self)
        other.patches = contact_patches(self.gripper, models)
        return other

    def poses(
        self, points: FloatArray, turns: int, slides: Sequence[float] = (0.0,), directions: FloatArray | None = None
    ) -> list[JawPose]:
        """Return a pose for each turn and slide, without flips: free poses first, then by clearance.

        Parameters
        ----------
        points : (2, 3) array
            Contacts, metres.
        turns : int
            Number of approach directions about the closing line; those outside all cones are left out.
        slides : sequence of float
            Distances of the tool centre point beyond the contacts, metres.
        directions : (m, 3) array, optional
            Approach directions in place of the turns.
        """
        if directions is None:
            directions = self.gripper.approaches(points, self.cones, turns)
        steepest = self.gripper.approaches(points)[0]
        poses = [self.pose(points, direction, slide, steepest) for direction in directions for slide in slides]
        return sorted(poses, key=rank)

    def pose(
        self, points: FloatArray, direction: FloatArray, slide: float = 0.0, steepest: FloatArray | None = None
    ) -> JawPose:
        """Return the pose for an approach direction, with the jaws opened as wide as collisions allow.

        ``steepest`` is the steepest approach, where it is known.
        """
        steepest = self.gripper.approaches(points)[0] if steepest is None else steepest
        opening, closing = _opening_and_closing(points)
        rotation, position = self.gripper.pose(points + slide * direction, direction)
        frame = np.stack([closing, np.cross(direction, closing), direction], axis=1)
        origin = points.mean(axis=0) + slide * direction
        opened, clearance, depths = opening, -np.inf, dict[str, float]()
        for space in SPACE_TO_CLOSE:
            width = max(opening, min(self.gripper.opening, opening + space))
            result, blocking = self._clearance(opening, width, frame, origin)
            if result > clearance:
                opened, clearance, depths = width, result, blocking
            if not blocking or width == opening:
                break
        turn = float(np.arctan2(np.cross(steepest, direction) @ closing, steepest @ direction))
        return JawPose(direction, turn, slide, False, position, rotation, opening, opened, clearance, depths)

    def _clearance(
        self, opening: float, opened: float, frame: FloatArray, origin: FloatArray
    ) -> tuple[float, dict[str, float]]:
        """Return the least clearance from all solids, metres, and the depth in each blocking solid, by name."""
        boxes, least_clearance, depths = self.gripper.solids(opening, opened, self.path), FARTHEST, dict[str, float]()
        for solid in self.solids:
            is_body = solid.name == BODY
            approaching, closing = [*boxes.open_fingers, *boxes.palm], boxes.closing_fingers
            retreating = [] if is_body else boxes.closed_fingers
            distances = solid.distances(np.array([*approaching, *closing, *retreating]), frame, origin)
            if is_body:  # the pads touch it
                on_pads = distances[len(approaching) :]
                depth = -float(np.min(on_pads)) - solid.roughness
                on_pads[:] = FARTHEST if depth <= self.touching else -depth
            clearance = float(np.min(distances))
            if clearance < (-self.touching if is_body else 0.0):
                depths[solid.name] = max(depths.get(solid.name, 0.0), -clearance)
            least_clearance = min(least_clearance, clearance)
        return least_clearance, depths

    def pad_shares(self, points: FloatArray, directions: FloatArray) -> FloatArray:
        """Return the fraction of each contact's patch, or pad, that is on its face, (m, 2); (m, 0) without either.

        Parts of the pad count behind which, along the closing line, the part's surface is within 3 mm, and
        within 0.5 mm where the contact is the whole pad (``contact_patches``). They are clipped from the triangles that
        face the pad.

        Parameters
        ----------
        points : (2, 3) array
            Contacts, metres.
        directions : (m, 3) array
            Approaches across the closing line.
        """
        _, closing = _opening_and_closing(points)
        shares = [np.zeros((len(directions), 0))]
        for point, inward, patch in zip(points, (closing, -closing), self.patches, strict=False):
            length, width, depth = patch.length, patch.width, patch.depth
            along = patch.along(inward, directions)
            half, across = 0.5 * np.array([width, length]), np.cross(along, inward)
            frames = np.stack([np.broadcast_to(inward, across.shape), across, along], axis=2)
            facing = _facing_triangles(self.solids[0].triangles - point, inward, float(np.hypot(*half)), depth)
            shares.append(_covered_areas(facing, frames, half, depth)[:, None] / (width * length))
        return np.minimum(np.concatenate(shares, axis=1), 1.0)

    def approaches_on_faces(self, points: FloatArray, directions: FloatArray) -> FloatArray:
        """Return the approaches (n, 3), of directions (m, 3), by which the pads are on their faces."""
        return np.asarray(directions[self.pad_shares(points, directions).min(axis=1, initial=1.0) >= LEAST_PAD_SHARE])

    def usable_approaches(self, points: FloatArray, directions: FloatArray) -> Iterator[FloatArray]:
        """Yield the approaches (3,), of directions (m, 3), by which pads are on their faces and the way in is free."""
        yield from (d for d in self.approaches_on_faces(points, directions) if self.pose(points, d).is_free)

    def directions(self, points: FloatArray, models: Sequence[ContactModel]) -> FloatArray | None:
        """Return the approach directions (m, 3) that rectangular contacts allow; None if they allow all."""
        stated = next((model.direction for model in _rectangles(models)), None)
        if not self.gripper.is_solid or stated is None:
            return None
        _, closing = _opening_and_closing(points)
        tangential = np.asarray(stated) - (closing @ np.asarray(stated)) * closing
        if np.linalg.norm(tangential) < PARALLEL:
            return None
        both_ways = np.outer([1.0, -1.0], tangential / np.linalg.norm(tangential))
        is_allowed = self._within_cones(both_ways)
        return np.asarray(both_ways[is_allowed] if np.any(is_allowed) else both_ways[:1])

    def turned_approaches(self, points: FloatArray, models: Sequence[ContactModel]) -> FloatArray:
        """Return the approaches (m, 3) along which rectangular contacts would lie after a turn about the closing line.

        Turns are multiples of 30 degrees without half a turn, which leaves a rectangle as it is. None are returned for
        other contacts.
        """
        along = self.directions(points, models)
        if along is None:
            return np.zeros((0, 3))
        _, closing = _opening_and_closing(points)
        count = round(2.0 * np.pi / DISTINCT_ANGLE)
        angles = DISTINCT_ANGLE * np.array([i for i in range(count) if 2 * i % count])
        turned = np.outer(np.cos(angles), along[0]) + np.outer(np.sin(angles), np.cross(closing, along[0]))
        return np.asarray(turned[self._within_cones(turned)])

    def _within_cones(self, directions: FloatArray) -> BoolArray:
        """Return the mask of approach directions (m, 3) within all cones, (m,)."""
        within = np.ones(len(directions), dtype=bool)
        for axis, angle in self.cones:
            within &= np.arccos(np.clip(directions @ axis, -1.0, 1.0)) <= angle
        return within


@dataclass(frozen=True)
class ContactPatch:
    """Rectangle that has to be on a face for a contact to exist.

    Parameters
    ----------
    length, width : float
        Metres.
    depth : float
        How far behind it the face may be, metres.
    direction : (3,) array or None
        Of the length, body frame; None for the gripper's approach.
    """

    length: float
    width: float
    depth: float
    direction: tuple[float, float, float] | None = None

    def along(self, inward: FloatArray, directions: FloatArray) -> FloatArray:
        """Return the directions of the length, (m, 3), across ``inward`` (3,), for approaches (m, 3)."""
        stated = np.zeros(3) if self.direction is None else np.asarray(self.direction)
        tangential = stated - (stated @ inward) * inward
        length = np.linalg.norm(tangential)
        return directions if length < PARALLEL else np.broadcast_to(tangential / length, directions.shape)


def contact_patches(gripper: ParallelJaw, models: Sequence[ContactModel]) -> list[ContactPatch]:
    """Return the patch of each of two contacts: that of a plane or line contact, or else the pad; none without either.

    The whole pad as a contact yields by 0.5 mm; smaller ones by the square of their share of its sides, as they would
    on a face equally curved, and lines by at least 0.1 mm.
    """
    patches = []
    for model in (*models, None, None)[:2]:
        if isinstance(model, PadContact):
            sides, is_line = model.sides, isinstance(model, LineContact)
            ratios = [side / whole for side, whole in zip(sides, gripper.pad or sides, strict=True)]
            depth = FLAT_DEPTH * min(1.0, *(ratios[:1] if is_line else ratios)) ** 2
            follows = gripper.is_solid and not is_line  # rectangles on stated fingers turn with them
            patch = ContactPatch(*sides, max(depth, LINE_DEPTH * is_line), None if follows else model.direction)
        elif gripper.pad is not None:
            patch = ContactPatch(gripper.pad[0], gripper.pad[1], FACE_DEPTH)
        else:
            return []
        patches.append(patch)
    return patches


def _rectangles(models: Sequence[ContactModel]) -> list[PlaneContact]:
    """Return the rectangular plane contacts, such as whole pads of a gripper."""
    return [model for model in models if isinstance(model, PlaneContact) and model.extents is not None]


def _opening_and_closing(points: FloatArray) -> tuple[float, FloatArray]:
    """Return the distance between two contacts, metres, and the unit direction from the first to the second."""
    opening = float(np.linalg.norm(points[1] - points[0]))
    return opening, (points[1] - points[0]) / opening


def _facing_triangles(triangles: FloatArray, inward: FloatArray, radius: float, face_depth: float) -> FloatArray:
    """Return the triangles (n, 3, 3) that face a pad about the origin and may be on it at some turn.

    Parameters
    ----------
    triangles : (m, 3, 3) array
        Metres.
    inward : (3,) array
        Direction from the pad into the part.
    radius : float
        Half the diagonal of the pad, metres.
    face_depth : float
        Largest distance along ``inward`` that counts, metres; those behind the pad do not count.
    """
    depth = triangles @ inward
    near = triangles[(depth.max(axis=1) >= -TOUCHING) & (depth.min(axis=1) <= face_depth)]
    near = near[np.all((near.min(axis=1) <= radius) & (near.max(axis=1) >= -radius), axis=1)]
    normals = np.cross(near[:, 1] - near[:, 0], near[:, 2] - near[:, 0])
    return np.asarray(near[normals @ inward < -FLAT_AREA])


def _covered_areas(triangles: FloatArray, frames: FloatArray, half: FloatArray, face_depth: float) -> FloatArray:
    """Return the areas (m,) of a rectangle in m frames that triangles (n, 3, 3) cover along x, square metres.

    Parameters
    ----------
    triangles : (n, 3, 3) array
        Metres, that face the rectangle.
    frames : (m, 3, 3) array
        Axes of the frames, their columns; x points from the rectangle into the part.
    half : (2,) array
        Half sides of the rectangle in y and z, about the origin.
    face_depth : float
        Largest distance in x that counts, metres.
    """
    polygons = (triangles[None] @ frames[:, None]).reshape(-1, 3, 3)
    owners = np.repeat(np.arange(len(frames)), len(triangles))
    for axis, sign, limit in (
        (1, 1.0, half[0]),
        (1, -1.0, half[0]),
        (2, 1.0, half[1]),
        (2, -1.0, half[1]),
        (0, 1.0, face_depth),
        (0, -1.0, TOUCHING),
    ):
        polygons, kept = _clip(polygons, sign * polygons[:, :, axis] - limit)
        owners = owners[kept]
    y, z = polygons[:, :, 1], polygons[:, :, 2]
    areas = 0.5 * np.abs(np.sum(y * np.roll(z, -1, axis=1) - np.roll(y, -1, axis=1) * z, axis=1))
    return np.asarray(np.bincount(owners, areas, len(frames)), dtype=float)


def _clip(polygons: FloatArray, excess: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return convex polygons (m, v + 1, 3) clipped to a half-space, and the indices (m,) of those that are not empty.

    By Sutherland and Hodgman, for all of them at once.

    Parameters
    ----------
    polygons : (n, v, 3) array
        Their last vertices may be equal.
    excess : (n, v) array
        Signed distances of the vertices from the half-space, outside positive.
    """
    before, excess_before = np.roll(polygons, 1, axis=1), np.roll(excess, 1, axis=1)
    inside, crosses = excess <= 0.0, (excess <= 0.0) != (excess_before <= 0.0)
    share = excess_before / np.where(crosses, excess_before - excess, 1.0)
    crossings = before + share[:, :, None] * (polygons - before)
    shape = len(polygons), 2 * polygons.shape[1]
    vertices = np.stack([crossings, polygons], axis=2).reshape(*shape, 3)
    remains = np.stack([crosses, inside], axis=2).reshape(shape)
    counts = np.sum(remains, axis=1)
    kept = np.flatnonzero(counts >= 3)
    first = np.argsort(~remains[kept], axis=1, kind="stable")
    slots = np.minimum(np.arange(polygons.shape[1] + 1), counts[kept, None] - 1)
    return vertices[kept[:, None], np.take_along_axis(first, slots, axis=1)], kept


def rank(pose: JawPose) -> tuple[bool, float, float, float]:
    """Return the sorting key of a pose: free first, then larger clearance, smaller slide, steeper approach.

    Clearances above a centimetre are equal.
    """
    clearance = min(pose.clearance, RANKED_CLEARANCE) if pose.is_free else pose.clearance
    return not pose.is_free, -round(clearance, 3), abs(pose.slide), abs(pose.turn)


def flip_pose(pose: JawPose, gripper: ParallelJaw) -> JawPose:
    """Return a pose with the jaws exchanged, by half a turn about the approach through the tool centre point."""
    rotation, position = gripper.flip(pose.rotation, pose.position, pose.direction)
    return replace(pose, flip=True, rotation=rotation, position=position)
