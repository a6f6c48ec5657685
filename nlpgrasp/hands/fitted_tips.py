"""Fingertips fitted to the collision shapes of links: the rounded convex hull of a link's end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.hands.robot import Joint, Robot, joint_motion
from nlpgrasp.hands.tips import HullTip, dome

LENGTH = 0.025  # metres: part of a link's end that its fingertip has
WIDEST = np.radians(50.0)  # angle of a patch, at most
SEARCHED = np.radians(80.0)  # angle about the pad's edge within which a patch is looked for
PROTRUSION = 5e-4  # metres: largest distance of other shapes of the link in front of the patch's tangent planes
OFF_SHAPE = (3.5e-4, 9e-4)  # metres: largest distance of the patch from a concave shape, the next if too narrow
NEXT_TO = np.radians(5.0)  # angle of the pad from a patch that is widened to it
ALL_SHAPES = 0.2  # radians by which the patch of the hull of all shapes has to be better than the farthest shape's
WIDE_ENOUGH, NARROWEST = np.radians(30.0), 0.1  # angle of a patch from which on it is not too narrow; at least
FIT = 5e-5  # metres: largest distance of the hull's corners from the convex hull of the link's end
ROUNDING = 1.5e-4  # metres, of the hulls
NARROWINGS = 5  # of a patch whose own samples are off the shapes, at most
BRIDGED = 1.8e-3  # metres: deepest hollow of a shape under the edge of a patch
SHRINKING = 0.8  # factor on the angle of a patch that is still off the shapes
MOST_POINTS = 80  # corners of a fingertip
SIDES = 48  # of the sampled directions
POSTURES = 100  # random postures
RANGE_WEIGHT = 0.5  # weight of the last joint's range against the direction to the other fingertips


def fit_hull_tips(robot: Robot, links: Sequence[str], others: Sequence[str] = ()) -> dict[str, HullTip]:
    """Return the rounded convex hulls of links' ends; their patches face between the pad's and the link's direction.

    Parameters
    ----------
    robot : Robot
    links : sequence of str
    others : sequence of str
        Links with further fingertips, which the patches face too.

    Raises
    ------
    InputError
        For one of ``links`` without a collision shape.
    """
    ends = {link: _LinkEnd(robot, link) for link in links}
    centres = {link: end.centre for link, end in ends.items()} | {link: np.zeros(3) for link in others}
    towards_others = _directions_to_others(robot, centres) if links else {}
    return {link: end.hull_tip(towards_others[link]) for link, end in ends.items()}


class _LinkEnd:
    """End of a link away from its last moving joint, as convex hull of its farthest shape and of all its shapes."""

    def __init__(self, robot: Robot, link: str) -> None:
        chain = [joint for joint in robot.chain(link) if joint.moves]
        frame = np.eye(4)
        if chain and (transform := robot.fixed_transform(chain[-1].child, link)) is not None:
            frame = transform
        self.shapes = robot.group_shapes(link)
        if not self.shapes:
            problem = "a link without a collision shape"
            raise InputError(f"URDFHand.fingertips[{link!r}]", problem, "a radius or a tip, such as ng.SphereTip(0.01)")
        vertices = [shape.mesh.vertices @ T[:3, :3].T + T[:3, 3] for shape, T in self.shapes]
        self.group = np.concatenate(vertices)
        direction = self.group.mean(axis=0) - frame[:3, 3]
        self.direction = direction / np.linalg.norm(direction)
        farthest = int(np.argmax([np.max(points @ self.direction) for points in vertices]))
        self.solids = [self._cut_end(vertices[farthest])]
        if len(vertices) > 1:
            self.solids.append(self._cut_end(self.group))
        self.centre = self.solids[0].mean(axis=0)
        self.motion, self.closing, self.slides = np.zeros(3), 0.0, False
        if chain:
            self.slides = not chain[-1].is_revolute
            axis = frame[:3, :3] @ chain[-1].axis
            motion = np.cross(axis, self.centre - frame[:3, 3]) if chain[-1].is_revolute else axis
            self.motion = motion / max(float(np.linalg.norm(motion)), 1e-12)
            self.closing = RANGE_WEIGHT * _range_balance(robot, chain[-1])

    def hull_tip(self, towards_others: FloatArray) -> HullTip:
        """Return the rounded hull whose patch faces along the last joint's motion to the others, and along the link."""
        distance = max(float(np.linalg.norm(towards_others)), 1e-12)
        closes = self.motion @ towards_others / distance + self.closing >= 0.0
        motion = self.motion if closes else -self.motion
        across = motion - (motion @ self.direction) * self.direction
        length = float(np.linalg.norm(across))
        pad = across / length if length > 1e-6 else self.direction
        middle = pad if self.slides else pad + self.direction
        normals = np.vstack([dome(middle / np.linalg.norm(middle), SEARCHED, SIDES).vertices, pad])
        tips = [self._widest_patch(solid, normals) for solid in self.solids]
        angles, facing = np.array([tip.angle for tip in tips]), np.array([tip.facing for tip in tips])
        merits = _merits(angles, facing @ normals[0], facing @ pad, self.slides)
        return tips[int(np.argmax(merits - ALL_SHAPES * np.arange(len(tips))))]

    def _cut_end(self, vertices: FloatArray) -> FloatArray:
        """Return the corners of the end of the convex hull of some vertices."""
        sphere = dome(self.direction, np.pi, SIDES).vertices
        return _cut(_supporting_points(vertices, sphere, len(sphere)), self.direction, LENGTH)

    def _widest_patch(self, solid: FloatArray, normals: FloatArray) -> HullTip:
        """Return the widest patch of a convex hull that is on the link's shapes, with no other shape in front of it."""
        corners = _supporting_points(solid, normals, MOST_POINTS)
        tip = HullTip(corners, normals[0], SEARCHED, ROUNDING)
        protrusion = np.max(normals @ self.group.T, axis=1) - np.max(normals @ corners.T, axis=1)
        gaps = self._gaps(tip.points_with_normals(normals))
        flat_points, flat_normals = _flat_parts(corners)
        flat_gaps = self._gaps(flat_points)
        facing, angle = normals[0], 0.0
        for off_shape in OFF_SHAPE:
            usable = (protrusion <= PROTRUSION) & (gaps <= off_shape)
            unusable = np.concatenate([normals[~usable], flat_normals[flat_gaps > off_shape]])
            for narrowing in range(NARROWINGS if angle < WIDE_ENOUGH else 0):
                facing, angle = _widest_cone(normals, usable, unusable, self.slides and narrowing == 0)
                patch = dome(facing, max(angle, NARROWEST), SIDES).vertices
                is_off = self._gaps(tip.points_with_normals(patch)) > off_shape
                if not is_off.any():
                    break
                unusable = np.concatenate([unusable, patch[is_off]])
        angle = max(angle, NARROWEST)
        while (
            angle > NARROWEST
            and np.max(self._gaps(tip.points_with_normals(dome(facing, angle, SIDES).vertices))) > BRIDGED
        ):
            angle *= SHRINKING
        return HullTip(corners, facing, angle, ROUNDING)

    def _deepest_hollow(self, tip: HullTip, facing: FloatArray, angle: float) -> float:
        """Return the largest distance outside the link's shapes of a hull's points within an angle, metres."""
        return float(np.max(self._gaps(tip.points_with_normals(dome(facing, angle, SIDES).vertices))))

    def _gaps(self, points: FloatArray) -> FloatArray:
        """Return the distances of points (m, 3), link frame, outside the link's shapes, (m,), metres, at least zero."""
        depths = [shape.depth((points - T[:3, 3]) @ T[:3, :3]) for shape, T in self.shapes]
        return np.asarray(np.maximum(-np.max(depths, axis=0), 0.0))


def _flat_parts(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points on facets and edges of a convex hull of corners, (m, 3), and their outward normals, (m, 3).

    The hull bridges hollows of the shape there, and sampled normals miss that: to a facet belongs a single normal.
    """
    if len(corners) < 4:
        return np.zeros((0, 3)), np.zeros((0, 3))
    hull = ConvexHull(corners, qhull_options="QJ")  # flat sets of corners too
    facets, normals = corners[hull.simplices], hull.equations[:, :3]
    points, directions = [facets.mean(axis=1)], [normals]
    for i in range(3):
        points += [(facets.sum(axis=1) + 3.0 * facets[:, i]) / 6.0, (facets.sum(axis=1) - facets[:, i]) / 2.0]
        both = normals + normals[hull.neighbors[:, i]]
        directions += [normals, both / np.maximum(np.linalg.norm(both, axis=1, keepdims=True), 1e-12)]
    return np.concatenate(points), np.concatenate(directions)


def _merits(angles: FloatArray, cosines: FloatArray, pad_cosines: FloatArray, slides: bool) -> FloatArray:
    """Return the merits of patches: angle less half of that to the wanted middle; of sliding jaws with the pad.

    A jaw that slides presses along its motion alone, a finger that turns with its end as well.
    """
    off, pad = np.arccos(np.clip(cosines, -1.0, 1.0)), np.arccos(np.clip(pad_cosines, -1.0, 1.0))
    return np.asarray(np.minimum(angles, WIDEST) - 0.5 * off - np.where(slides & (pad > angles), 0.5, 0.0))


def _widest_cone(
    normals: FloatArray, usable: NDArray[np.bool_], unusable: FloatArray, slides: bool
) -> tuple[FloatArray, float]:
    """Return the axis, one of normals (m, 3), and the angle of the best cone without unusable normals (n, 3).

    The first of the normals is the wanted middle, the last the pad; for a jaw that slides, a cone that ends next to a
    usable pad is widened to it.
    """
    if not usable.any():
        return normals[0], 0.0
    nearest = np.min(np.arccos(np.clip(normals @ unusable.T, -1.0, 1.0)), axis=1, initial=np.pi)
    clear = np.minimum(np.where(usable, nearest, 0.0), WIDEST)
    cosines = np.clip(normals @ normals[[0, -1]].T, -1.0, 1.0)
    if slides and usable[-1]:
        pad = np.arccos(cosines[:, 1])
        clear = np.where((pad > clear) & (pad <= clear + NEXT_TO), pad, clear)
    best = int(np.argmax(_merits(clear, cosines[:, 0], cosines[:, 1], slides)))
    return normals[best], float(clear[best])


def _cut(corners: FloatArray, direction: FloatArray, length: float) -> FloatArray:
    """Return the corners of the part of a convex hull within a length of its farthest point along a direction."""
    hull = ConvexHull(corners)
    height = corners @ direction - np.max(corners @ direction) + length
    a, b = np.unique(np.sort(hull.simplices[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0).T
    crosses = height[a] * height[b] < 0.0
    a, b = a[crosses], b[crosses]
    share = height[a] / (height[a] - height[b])
    return np.concatenate([corners[height >= 0.0], corners[a] + share[:, None] * (corners[b] - corners[a])])


def _supporting_points(corners: FloatArray, normals: FloatArray, most: int) -> FloatArray:
    """Return at most ``most`` corners with nearly the support function of all of them along the normals (m, 3)."""
    heights = normals @ corners.T
    support = heights.max(axis=1)
    chosen = [int(np.argmax(heights[0]))]
    best = heights[:, chosen[0]]
    while len(chosen) < most:
        worst = int(np.argmax(support - best))
        if support[worst] - best[worst] <= FIT:
            break
        chosen.append(int(np.argmax(heights[worst])))
        best = np.maximum(best, heights[:, chosen[-1]])
    return np.asarray(corners[chosen])


def _directions_to_others(robot: Robot, centres: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the mean direction from a point of each link to all points, link frame, metres, over random postures."""
    ranges = robot.ranges
    rng = np.random.default_rng(0)
    names = [joint.name for joint in robot.free_joints]
    low, high = (np.clip([ranges[name][side] for name in names], -np.pi, np.pi) for side in (0, 1))
    result = {link: np.zeros(3) for link in centres}
    for values in rng.uniform(low, high, (POSTURES, len(names))):
        positions = dict(zip(names, values.tolist(), strict=True))
        poses = {link: _link_pose(robot, link, positions) for link in centres}
        places = {link: poses[link][:3, :3] @ centre + poses[link][:3, 3] for link, centre in centres.items()}
        middle = np.mean(list(places.values()), axis=0)
        for link in centres:
            result[link] += (middle - places[link]) @ poses[link][:3, :3] / POSTURES
    return result


def _range_balance(robot: Robot, joint: Joint) -> float:
    """Return how far a joint's range is on one side of zero, from -1 (negative positions alone) to 1."""
    driver, multiplier, _ = robot.driving_joint(joint)
    low, high, _ = robot.ranges[driver]
    if not np.isfinite(low) or not np.isfinite(high) or high <= low:
        return 0.0
    return float(np.clip((low + high) / (high - low), -1.0, 1.0) * np.sign(multiplier))


def _link_pose(robot: Robot, link: str, positions: Mapping[str, float]) -> FloatArray:
    """Return the pose (4, 4) of a link in the palm's frame at positions of the free joints."""
    pose = np.eye(4)
    for joint in robot.chain(link):
        pose = pose @ joint.frame
        if joint.moves:
            driver, multiplier, offset = robot.driving_joint(joint)
            pose = pose @ joint_motion(not joint.is_revolute, joint.axis, multiplier * positions[driver] + offset)
    return pose
