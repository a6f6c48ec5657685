"""Fingertips fitted to collision shapes: rounded convex hulls of the ends of links."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from nlpgrasp.common.cache import Arrays, cached_arrays
from nlpgrasp.common.validation import BoolArray, FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.hands.closed_linkages import closed_linkages, random_joints
from nlpgrasp.hands.collision_shapes import CollisionShape
from nlpgrasp.hands.file_units import SCALE_CURE
from nlpgrasp.hands.robot import Joint, Robot, joint_motion
from nlpgrasp.hands.tips import HullTip, dome

LENGTH = 0.025  # metres: part of a link's end that its fingertip has
ALONG = 0.5  # cosine of the largest angle of a box's longest side from the link's direction along which it is cut
NEARBY = 0.05  # metres: part of a link's end whose shapes are kept behind the patch's tangent planes
WIDEST = np.radians(50.0)  # angle of a patch, at most
SEARCHED = np.radians(80.0)  # angle about the pad's edge within which a patch is looked for
PROTRUSION = 5e-4  # metres: largest distance of other shapes of the link in front of the patch's tangent planes
OFF_SHAPE = (3.5e-4, 9e-4)  # metres: largest distance of the patch from a concave shape, the next if too narrow
NEXT_TO = np.radians(5.0)  # angle of the pad from a patch that is widened to it
INSIDE = 1e-3  # radians by which a widened patch goes beyond the pad
ALL_SHAPES = 0.2  # radians by which the patch of the hull of all shapes has to be better than one shape's
MOST_SHAPES = 3  # shapes of a link's end of which each has a patch that is compared
WIDE_ENOUGH, NARROWEST = np.radians(30.0), 0.1  # angle of a patch from which on it is not too narrow; at least
FIT = 5e-5  # metres: largest distance of the hull's corners from the convex hull of the link's end
ROUNDING = 1.5e-4  # metres, of the hulls
NARROWINGS = 5  # of a patch whose own samples are off the shapes, at most
BRIDGED = 1.8e-3  # metres: deepest hollow of a shape under the edge of a patch
SHRINKING = 0.8  # factor on the angle of a patch that is still off the shapes
TINY = 1e-3  # metres: length of a link below which the scale of its meshes is questioned
MOST_POINTS = 80  # corners of a fingertip
SIDES = 48  # of the sampled directions
POSTURES = 100  # random postures
RANGE_WEIGHT = 0.5  # weight of the last joint's range against the direction to the other fingertips


def fit_hull_tips(robot: Robot, links: Sequence[str], others: Sequence[str] = ()) -> dict[str, HullTip]:
    """Return a fingertip for each link: the rounded convex hull of its end.

    The patches face between the direction of the pad and that of the link.

    Parameters
    ----------
    robot : Robot
    links : sequence of str
    others : sequence of str
        Links with further fingertips, which the patches face too.

    Raises
    ------
    InputError
        For one of ``links`` without a collision shape, or with shapes too small or flat for a hull.
    """
    ends = {link: _LinkEnd(robot, link) for link in links}
    centres = {link: end.centre for link, end in ends.items()} | {link: np.zeros(3) for link in others}
    towards_others = _directions_to_others(robot, centres) if links else {}
    patches: dict[bytes, Arrays] = {}  # fingers are often alike
    return {link: end.hull_tip(towards_others[link], patches) for link, end in ends.items()}


class _LinkEnd:
    """End of a link away from its last moving joint, as convex hulls of the link's own collision shapes.

    A link without shapes has those of the links fixed to it. A patch leaves out what those of other links cover.
    """

    def __init__(self, robot: Robot, link: str) -> None:
        chain = [joint for joint in robot.chain(link) if joint.moves]
        frame = np.eye(4)
        if chain and (transform := robot.fixed_transform(chain[-1].child, link)) is not None:
            frame = transform
        fixed, own = robot.group_shapes(link), robot.shapes.get(link)
        self.name, self.shapes = link, [(shape, np.eye(4)) for shape in own] if own else fixed
        self.covers = [pair for pair in fixed if not any(pair[0] is shape for shape in own)] if own else []
        if not self.shapes:
            problem = "a link without a collision shape"
            raise InputError(f"URDFHand.fingertips[{link!r}]", problem, "a radius or a tip, such as ng.SphereTip(0.01)")
        vertices = [shape.mesh.vertices @ T[:3, :3].T + T[:3, 3] for shape, T in self.shapes]
        self.group = np.concatenate(vertices)
        direction = self.group.mean(axis=0) - frame[:3, 3]
        length = float(np.linalg.norm(direction))
        self.direction = direction / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])  # about its joint alike
        vertices = [_hull_corners(points) for points in vertices]
        self.group = np.concatenate(vertices)
        farthest = int(np.argmax([np.max(points @ self.direction) for points in vertices]))
        self.cut = _long_side(*self.shapes[farthest], self.direction)
        self.centre = self._cut_end(vertices[farthest]).mean(axis=0)
        self.near = self._nearby_parts(vertices)
        self.motion, self.closing, self.slides = np.zeros(3), 0.0, False
        if chain:
            self.slides = not chain[-1].is_revolute
            axis = frame[:3, :3] @ chain[-1].axis
            motion = np.cross(axis, self.centre - frame[:3, 3]) if chain[-1].is_revolute else axis
            self.motion = motion / max(float(np.linalg.norm(motion)), 1e-12)
            self.closing = RANGE_WEIGHT * _range_balance(robot, chain[-1])
        moved = closed_linkages(robot).link_motion(link, self.centre) if robot.has_linkages else None
        if moved is not None:  # the last joint's own motion would open a linkage
            (self.motion, self.slides), self.closing = moved, 0.0

    def hull_tip(self, towards_others: FloatArray, patches: dict[bytes, Arrays]) -> HullTip:
        """Return the hull fingertip of the link's end.

        Its patch faces between the link's direction and the closing motion, which is that of the last joint towards the
        other fingertips. ``patches`` are those of other ends, by what they are made from.
        """
        distance = max(float(np.linalg.norm(towards_others)), 1e-12)
        closes = self.motion @ towards_others / distance + self.closing >= 0.0
        motion = self.motion if closes else -self.motion
        transverse = motion if self.slides else motion - (motion @ self.direction) * self.direction
        length = float(np.linalg.norm(transverse))
        pad = transverse / length if length > 1e-6 else self.direction
        middle = pad if self.slides else pad + self.direction
        normals = np.vstack([dome(middle / np.linalg.norm(middle), SEARCHED, SIDES).vertices, pad])
        if np.all(self._is_covered(self.group[np.argmax(normals @ self.group.T, axis=1)])):
            given = "a link whose collision shapes are inside those of links fixed to it"
            raise InputError(f"URDFHand.fingertips[{self.name!r}]", given, "the link that is outside")
        shapes = [part for shape, T in self.shapes for part in (shape.content, T)]
        covers = [part for shape, T in self.covers for part in (shape.content, T)]
        directions = np.round([self.cut, *normals], 9) + 0.0
        inputs = [*shapes, b"covered by", *covers, directions, str(self.slides).encode()]
        key = b"".join(part if isinstance(part, bytes) else part.tobytes() for part in inputs)
        if key not in patches:
            patches[key] = cached_arrays("fingertips", inputs, lambda: self._best_patch(normals))
        arrays = patches[key]
        return HullTip(arrays["points"], arrays["facing"], float(arrays["angle"]), ROUNDING)

    def _best_patch(self, normals: FloatArray) -> dict[str, FloatArray]:
        """Return corners, facing direction and angle of the best patch among the end's hulls."""
        tips = [self._widest_patch(solid, normals) for solid in self._solids(normals)]
        angles, facing = np.array([tip.angle for tip in tips]), np.array([tip.facing for tip in tips])
        merits = _merits(angles, facing @ normals[0], facing @ normals[-1], self.slides)
        if len(tips) > 1:
            merits[-1] -= ALL_SHAPES
        best = int(np.argmax(merits))
        return {"points": np.asarray(tips[best].points), "facing": facing[best], "angle": angles[best]}

    def _solids(self, normals: FloatArray) -> list[FloatArray]:
        """Return the convex hulls on which a patch is tried, each as its corners (n, 3).

        They are the ends of the outermost shapes and of all shapes together. A shape that others cover along all of the
        normals (m, 3) is left out.
        """
        if len(self.near) == 1:
            return [self._cut_end(self.near[0])]
        support = np.array([np.max(normals @ points.T, axis=1) for points in self.near])
        counts = np.sum(support >= np.max(support, axis=0) - PROTRUSION, axis=1)
        outermost = [i for i in np.argsort(-counts, kind="stable")[:MOST_SHAPES] if counts[i] > 0]
        return [self._cut_end(points) for points in (*(self.near[i] for i in outermost), self.group)]

    def _cut_end(self, vertices: FloatArray, length: float = LENGTH) -> FloatArray:
        """Return the corners of the end piece of a convex hull, of a given length, metres."""
        sphere = dome(self.cut, np.pi, SIDES).vertices
        try:
            return _end_piece(supporting_points(vertices, sphere, len(sphere)), self.cut, length)
        except QhullError:
            raise self._too_small() from None

    def _too_small(self) -> InputError:
        """Return the error for shapes whose convex hull has no volume."""
        extents = np.ptp(self.group, axis=0)
        size = " x ".join(f"{extent:.2g}" for extent in extents)
        allowed = "shapes large enough to fit a fingertip to, or a radius or a tip, such as ng.SphereTip(0.01)"
        cure = f"; {SCALE_CURE}" if np.max(extents) < TINY else ""
        given = f"a link whose collision shapes measure {size} m"
        return InputError(f"URDFHand.fingertips[{self.name!r}]", given, f"{allowed}{cure}")

    def _nearby_parts(self, vertices: Sequence[FloatArray]) -> list[FloatArray]:
        """Return the corners of the part of each shape's convex hull that is near the link's farthest point."""
        setbacks = np.max(self.group @ self.cut) - np.array([np.max(points @ self.cut) for points in vertices])
        shapes = zip(vertices, setbacks, strict=True)
        return [self._cut_end(points, NEARBY - distance) for points, distance in shapes if distance < NEARBY]

    def _widest_patch(self, solid: FloatArray, normals: FloatArray) -> HullTip:
        """Return the widest patch of a convex hull that lies on the link's shapes, with no shape in front."""
        corners = supporting_points(solid, normals, MOST_POINTS)
        tip = HullTip(corners, normals[0], SEARCHED, ROUNDING)
        protrusion = np.max(normals @ np.concatenate(self.near).T, axis=1) - np.max(normals @ corners.T, axis=1)
        points = tip.points_with_normals(normals)
        gaps = self._gaps(points)
        flat_points, flat_normals = _flat_parts(corners)
        flat_gaps = self._gaps(flat_points)
        facing, angle = normals[0], 0.0
        for off_shape in OFF_SHAPE:
            usable = (protrusion <= PROTRUSION) & (gaps <= off_shape) & ~self._is_covered(points)
            unusable = np.concatenate([normals[~usable], flat_normals[flat_gaps > off_shape]])
            for narrowing in range(NARROWINGS if angle < WIDE_ENOUGH else 0):
                facing, angle = _widest_cone(normals, usable, unusable, self.slides and narrowing == 0)
                patch = dome(facing, max(angle, NARROWEST), SIDES).vertices
                is_off = self._gaps(tip.points_with_normals(patch)) > off_shape
                if not is_off.any():
                    break
                unusable = np.concatenate([unusable, patch[is_off]])
        angle = max(angle, NARROWEST)
        while angle > NARROWEST and self._deepest_hollow(tip, facing, angle) > BRIDGED:
            angle *= SHRINKING
        return HullTip(corners, facing, angle, ROUNDING)

    def _deepest_hollow(self, tip: HullTip, facing: FloatArray, angle: float) -> float:
        """Return the largest gap between a patch and the link's shapes behind it, metres.

        The patch has the normals within ``angle``, radians, of ``facing``.
        """
        return float(np.max(self._gaps(tip.points_with_normals(dome(facing, angle, SIDES).vertices))))

    def _is_covered(self, points: FloatArray) -> BoolArray:
        """Return which points (m, 3), link frame, are inside shapes of links fixed to the link, (m,)."""
        return np.asarray(np.max(_depths(self.covers, points), axis=0, initial=-np.inf) > PROTRUSION)

    def _gaps(self, points: FloatArray) -> FloatArray:
        """Return the distances of points (m, 3), link frame, outside the link's shapes, (m,), metres, 0 inside."""
        return np.asarray(np.maximum(-np.max(_depths(self.shapes, points), axis=0), 0.0))


def _depths(shapes: Sequence[tuple[CollisionShape, FloatArray]], points: FloatArray) -> FloatArray:
    """Return the signed depths (shapes, m) of points (m, 3) below shapes with their transforms, metres."""
    depths = [shape.depth((points - T[:3, 3]) @ T[:3, :3]) for shape, T in shapes]
    return np.reshape(depths, (len(shapes), len(points)))


def _hull_corners(points: FloatArray) -> FloatArray:
    """Return the corners of the convex hull of points (n, 3); flat and few points as they are."""
    try:
        return points if len(points) <= 64 else np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        return points


def _long_side(shape: CollisionShape, transform: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the direction of a box's longest side if nearly along the link, else the link's direction, unit."""
    if shape.kind != "box" or shape.pose is None:
        return direction
    axis = transform[:3, :3] @ shape.pose[:3, int(np.argmax(shape.size))]
    cosine = float(axis @ direction)
    return np.asarray(np.sign(cosine) * axis if abs(cosine) >= ALONG else direction)


def _flat_parts(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points (m, 3) on facets and edges of the convex hull of corners, and their outward normals, (m, 3).

    The hull bridges hollows of the shape there, and sampled normals miss that: to a facet belongs a single normal.
    """
    if len(corners) < 4:
        return np.zeros((0, 3)), np.zeros((0, 3))
    hull = ConvexHull(corners, qhull_options="QJ")  # flat sets of corners too
    facets, normals = corners[hull.simplices], hull.equations[:, :3]
    points, directions = [facets.mean(axis=1)], [normals]
    for i in range(3):
        points += [(facets.sum(axis=1) + 3.0 * facets[:, i]) / 6.0, (facets.sum(axis=1) - facets[:, i]) / 2.0]
        sums = normals + normals[hull.neighbors[:, i]]
        directions += [normals, sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)]
    return np.concatenate(points), np.concatenate(directions)


def _merits(angles: FloatArray, cosines: FloatArray, pad_cosines: FloatArray, slides: bool) -> FloatArray:
    """Return the merit of each patch: its opening angle, less half its angle from the wanted direction.

    A jaw that slides presses along its motion alone, a finger that turns with its end as well.
    """
    deviations, pad_angles = np.arccos(np.clip(cosines, -1.0, 1.0)), np.arccos(np.clip(pad_cosines, -1.0, 1.0))
    return np.asarray(
        np.minimum(angles, WIDEST) - 0.5 * deviations - np.where(slides & (pad_angles >= angles), 0.5, 0.0)
    )


def _widest_cone(
    normals: FloatArray, usable: BoolArray, unusable: FloatArray, slides: bool
) -> tuple[FloatArray, float]:
    """Return axis and angle of the best cone of normals (m, 3) that contains no unusable normal (n, 3).

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
        clear = np.where((pad >= clear) & (pad <= clear + NEXT_TO), pad + INSIDE, clear)
    best = int(np.argmax(_merits(clear, cosines[:, 0], cosines[:, 1], slides)))
    return normals[best], float(clear[best])


def _end_piece(corners: FloatArray, direction: FloatArray, length: float) -> FloatArray:
    """Return the corners of the part of a convex hull within a length of its extreme point along a direction."""
    hull = ConvexHull(corners)
    height = corners @ direction - np.max(corners @ direction) + length
    a, b = np.unique(np.sort(hull.simplices[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0).T
    crosses = height[a] * height[b] < 0.0
    a, b = a[crosses], b[crosses]
    fraction = height[a] / (height[a] - height[b])
    return np.concatenate([corners[height >= 0.0], corners[a] + fraction[:, None] * (corners[b] - corners[a])])


def supporting_points(corners: FloatArray, normals: FloatArray, most: int) -> FloatArray:
    """Return at most ``most`` corners that nearly keep the support function along normals (m, 3)."""
    farthest = np.concatenate([np.argmax(part @ corners.T, axis=1) for part in np.array_split(normals, 16)])
    support = np.einsum("mx,mx->m", normals, corners[farthest])
    chosen, best = list[int](), np.full(len(normals), -np.inf)
    worst = 0
    while len(chosen) < most and support[worst] - best[worst] > FIT:
        chosen.append(int(farthest[worst]))
        best = np.maximum(best, normals @ corners[chosen[-1]])
        worst = int(np.argmax(support - best))
    return np.asarray(corners[chosen])


def _directions_to_others(robot: Robot, centres: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the mean vector from each link's point to the centroid of all points, link frame, metres.

    The mean is over random postures.
    """
    ranges = [robot.ranges[joint.name] for joint in robot.free_joints]
    low, high = (np.clip([ends[side] for ends in ranges], -np.pi, np.pi) for side in (0, 1))
    joints = random_joints(robot, np.array([low, high]), POSTURES, np.random.default_rng(0))
    poses = {link: link_poses_at(robot, link, joints) for link in centres}
    places = {link: poses[link][:, :3, :3] @ centre + poses[link][:, :3, 3] for link, centre in centres.items()}
    middle = np.mean(list(places.values()), axis=0)
    return {
        link: np.mean(np.einsum("bx,bxa->ba", middle - places[link], poses[link][:, :3, :3]), axis=0)
        for link in centres
    }


def _range_balance(robot: Robot, joint: Joint) -> float:
    """Return how one-sided a joint's range is about zero: -1 for negative positions only, 1 for positive ones."""
    driver, multiplier, _ = robot.driving_joint(joint)
    low, high, _ = robot.ranges[driver]
    if not np.isfinite(low) or not np.isfinite(high) or high <= low:
        return 0.0
    return float(np.clip((low + high) / (high - low), -1.0, 1.0) * np.sign(multiplier))


def link_poses_at(robot: Robot, link: str, joints: FloatArray) -> FloatArray:
    """Return the poses (b, 4, 4) of a link in the palm frame at positions (b, m) of the free joints."""
    index = {joint.name: i for i, joint in enumerate(robot.free_joints)}
    poses = np.broadcast_to(np.eye(4), (len(joints), 4, 4))
    for joint in robot.chain(link):
        poses = poses @ joint.frame
        if joint.moves:
            driver, multiplier, offset = robot.driving_joint(joint)
            positions = multiplier * joints[:, index[driver]] + offset
            poses = poses @ joint_motion(not joint.is_revolute, joint.axis, positions)
    return poses
