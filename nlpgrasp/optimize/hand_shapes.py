"""Shapes of a hand in plain arrays: samples of its links, parts that are kept apart, fingertips."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from nlpgrasp.common.cache import cached_arrays
from nlpgrasp.common.drawing import Triangles
from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.collision_shapes import CollisionShape
from nlpgrasp.hands.moving_links import Frames, HandState, LinkPoints, MovingLinks
from nlpgrasp.hands.tips import CapsuleTip
from nlpgrasp.motion.link_parts import BinnedPoints, LinkParts, first_of_each, ranges
from nlpgrasp.optimize.joint_margins import JointLimitMargins
from nlpgrasp.optimize.solids import HasDistance


@dataclass(frozen=True)
class TipBalls:
    """Balls that stand for the fingertips, with the patches' directions and points.

    A ball replaces a fingertip while a hand is posed; the patch itself is the balls of one radius about its points.

    Parameters
    ----------
    at : (k, 3) array
        Centres, metres, frames of their groups.
    groups : (k,) int array
    radii : (k,) array
        Metres.
    facing : (k, 3) array
        Middle of each patch, frame of its group; zero for a patch all around.
    cosines : (k,) array
        Least cosine between the contact's normal and ``facing``; 1 for flat tips.
    patches : tuple of k (m, 3) arrays
        Points of each patch, metres, frame of its group.
    standoffs : (k,) array
        Radii of the balls about these, metres; 0 where the points are on the patch itself.
    sliding : (s,) int array
        Numbers of the fingertips along which contacts slide: flat ones, and those with an axis.
    middles : (s, 3) array
        Middles of these, metres, frames of their groups.
    along : (s, 2, 3) array
        Unit vectors along sides, or along an axis and zero, frames of their groups.
    halves : (s, 2) array
        Half their lengths, metres.
    tangent : (t, 2) int array
        Those of these vectors, by both numbers, that lie along the body: not a capsule's axis, for its ends touch too.
    """

    at: FloatArray
    groups: IntArray
    radii: FloatArray
    facing: FloatArray
    cosines: FloatArray
    patches: tuple[FloatArray, ...]
    standoffs: FloatArray
    sliding: IntArray
    middles: FloatArray
    along: FloatArray
    halves: FloatArray
    tangent: IntArray

    @classmethod
    def of(cls, hand: URDFHand, links: MovingLinks) -> TipBalls:
        """Return the balls of a hand's fingertips."""
        poses = [links.pose[link] for link, _ in hand.tips]
        at = [pose[:3, :3] @ tip.centre + pose[:3, 3] for pose, (_, tip) in zip(poses, hand.tips, strict=True)]
        stated = [getattr(tip, "facing", tip.normal) for _, tip in hand.tips]
        facing = [
            np.zeros(3) if direction is None else pose[:3, :3] @ np.asarray(direction)
            for pose, direction in zip(poses, stated, strict=True)
        ]
        cosines = [
            -1.0 if direction is None else float(np.cos(getattr(tip, "angle", 0.0)))
            for direction, (_, tip) in zip(stated, hand.tips, strict=True)
        ]
        groups, radii = [links.group[link] for link, _ in hand.tips], [tip.posing_radius for _, tip in hand.tips]
        standoffs = np.array([tip.standoff for _, tip in hand.tips])
        patches = [tip.backbone if tip.standoff > 0.0 else _filled(tip.surface()) for _, tip in hand.tips]
        patches = [p @ pose[:3, :3].T + pose[:3, 3] for p, pose in zip(patches, poses, strict=True)]
        balls = np.array(at), np.array(groups), np.array(radii)
        sliding = [i for i, (_, tip) in enumerate(hand.tips) if len(tip.half_sides)]
        wide = [(poses[i], hand.tips[i][1]) for i in sliding]
        middles = np.array([pose[:3, :3] @ tip.middle + pose[:3, 3] for pose, tip in wide]).reshape(-1, 3)
        sides = np.zeros((len(sliding), 2, 3))
        for i, (pose, tip) in enumerate(wide):
            sides[i, : len(tip.half_sides)] = tip.half_sides @ pose[:3, :3].T
        halves = np.linalg.norm(sides, axis=2)
        along = sides / np.where(halves > 0.0, halves, 1.0)[..., None]
        is_capsule = np.array([isinstance(tip, CapsuleTip) for _, tip in wide], bool)
        tangent = np.argwhere((halves > 0.0) & ~is_capsule[:, None])
        return cls(
            *balls, np.array(facing), np.array(cosines), tuple(patches), standoffs, np.array(sliding, int), middles,
            along, halves, tangent,
        )  # fmt: skip

    def is_at(self, points: FloatArray, group: int) -> BoolArray:
        """Return which points (m, 3), metres, frame of their group of links, are at one of its fingertips."""
        result = np.zeros(len(points), bool)
        for tip in np.flatnonzero(self.groups == group):
            gaps = cKDTree(self.patches[tip]).query(points)[0] - self.standoffs[tip]
            result |= gaps <= (5e-4 if self.standoffs[tip] else 1.5e-3)
        return result


class HandShapes:
    """Shapes of a hand's links, its fingertips, joint limits and closed linkages.

    Parameters
    ----------
    hand : URDFHand
    parts : LinkParts
        Of the hand.
    margin : float
        Of joints from their limits, radians.
    spacing : float
        Of the samples, metres.

    Attributes
    ----------
    least : (g,) array
        Least distance of each group of links from body and surroundings, metres.
    fingers : (k,) int array
        Number of each fingertip's finger, from 0 on: tips along one chain of joints are of one finger.
    """

    def __init__(self, hand: URDFHand, parts: LinkParts, margin: float, spacing: float = 3e-3) -> None:
        self.links, self.parts = hand.tree.moving_links, parts
        self.part_groups = np.array([self.links.group[part.link] for part in parts.parts], int)
        self.least = np.zeros(1 + len(self.links.parent))
        for link, group in self.links.group.items():
            self.least[group] = hand.least_clearance(link)
        self.tips = TipBalls.of(hand, self.links)
        self.fingers = _finger_numbers(self.links.moves[self.tips.groups])
        margins = JointLimitMargins.of(hand, margin)
        self.linkages = hand.tree.linkages if hand.robot.has_linkages else None
        held = {*hand.robot.passive, *hand.robot.stop_positions}  # others move them, or springs hold them at a limit
        self.limits = margins.narrow_limits(np.array([margin > 0.0 and name not in held for name in margins.names]))
        at, groups, cells, self._owners = self._samples(hand, spacing)
        self.samples = LinkPoints(at, groups)
        self.bins, self.first = cells, np.flatnonzero(np.diff(cells, prepend=-1))
        self.counts = np.diff(np.append(self.first, len(at)))
        sizes = list(map(len, self.tips.patches))
        self.patches = LinkPoints(np.concatenate(self.tips.patches), np.repeat(self.tips.groups, sizes))
        self.patch_starts = np.cumsum([0, *sizes[:-1]])
        middles = np.stack([np.bincount(cells, at[:, i]) for i in range(3)], axis=1) / self.counts[:, None]
        self.reach = np.zeros(len(middles))
        np.maximum.at(self.reach, cells, np.linalg.norm(at - middles[cells], axis=1))
        self.middles = LinkPoints(middles, groups[self.first])

    def _samples(self, hand: URDFHand, spacing: float) -> tuple[FloatArray, IntArray, IntArray, IntArray]:
        """Return samples of the links' hulls outside the fingertips' balls, with groups, bins and links, in order."""
        parts, alike = list[FloatArray](), dict[bytes, FloatArray]()
        self._names = tuple(hand.robot.shapes)
        for number, (link, shapes) in enumerate(hand.robot.shapes.items()):
            pose, group = self.links.pose[link], self.links.group[link]
            if shapes:
                key = b"".join(shape.fingerprint for shape in shapes)
                if key not in alike:
                    content = [str(spacing).encode(), *(shape.content for shape in shapes)]
                    alike[key] = cached_arrays("samples", content, partial(_surface, shapes, spacing))["at"]
                local = alike[key]
                at = local @ pose[:3, :3].T + pose[:3, 3]
                at = at[~self.tips.is_at(at, group)]
                parts.append(np.column_stack([np.full(len(at), group), at, np.full(len(at), number)]))
        table = np.concatenate([np.zeros((0, 5)), *parts])
        cells = _cell_numbers(np.column_stack([table[:, 0], np.floor(table[:, 1:4] / (3.0 * spacing))]))
        _, bins = np.unique(cells, return_inverse=True)
        order = np.argsort(bins, kind="stable")
        whole = table[order].astype(int)
        return table[order, 1:4], whole[:, 0], bins[order], whole[:, 4]

    def nearest_body_edges(
        self, points: BinnedPoints, frames: Frames, reach: float
    ) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray]:
        """Return, of each cell of points of the body, the one nearest to each part, within ``reach``, metres.

        Their postures and parts (n,), positions (n, 3), distances (n,) and gradients (n, 3) of the parts' distances.
        Those at a fingertip are left out.
        """
        found = [(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)))]
        centres = self.parts.ball_centres(self.part_frames(frames)).transpose(1, 0, 2)
        far = self.parts.reaches[:, None, None] + points.reaches + reach
        balls = np.nonzero(_squared_distances(centres, points.middles) < far * far)
        ends = np.searchsorted(balls[0], np.arange(len(self.parts.parts) + 1))
        for i in np.flatnonzero(np.diff(ends)):
            part, (which, cell) = self.parts.parts[i], (index[ends[i] : ends[i + 1]] for index in balls[1:])
            group, pose = self.part_groups[i], self.links.pose[part.link]
            R, t = frames.R[:, group] @ pose[:3, :3], frames.t[:, group] + frames.R[:, group] @ pose[:3, 3]
            distances = part.outer_distance(_in_frames(points.middles[cell], R[which], t[which]))
            near = distances < points.reaches[cell] + reach
            index, owner = ranges(points.first[cell[near]], points.sizes[cell[near]])
            which, x = which[near][owner], points.points[index]
            value, normals = part.distance_with_normals(_in_frames(x, R[which], t[which]), reach)
            inside = np.flatnonzero(value < reach)
            if group in self.tips.groups:
                at = _in_frames(x[inside], frames.R[which[inside], group], frames.t[which[inside], group])
                inside = inside[~self.tips.is_at(at, group)]
            chosen = inside[first_of_each(owner[inside], value[inside])]
            normals = (R[which[chosen]] @ normals[chosen][..., None])[..., 0]
            found.append((which[chosen], np.full(len(chosen), i), x[chosen], value[chosen], normals))
        which, parts, x, value, normals = (np.concatenate(column) for column in zip(*found, strict=True))
        return which, parts, x, value, normals

    def closed(self, joints: FloatArray) -> FloatArray:
        """Return joint positions (b, m) moved so that linkages are closed."""
        return joints if self.linkages is None else self.linkages.close(joints)

    def moved(self, state: HandState, twist: FloatArray, pivot: FloatArray) -> HandState:
        """Return postures after twists (b, 6 + m) about pivots (b, 3), within the limits and with linkages closed."""
        result = state.moved(twist, pivot, self.limits)
        return replace(result, joints=self.closed(result.joints))

    def linkage_rows(self, joints: FloatArray) -> FloatArray:
        """Return the derivatives (b, r, 6 + m) by the twist of what closed linkages keep."""
        if self.linkages is None:
            return np.zeros((len(joints), 0, self.links.size))
        slopes = self.linkages.jacobians(joints)
        return np.concatenate([np.zeros((*slopes.shape[:2], 6)), slopes], axis=2)

    def free_twists(self, joints: FloatArray, scale: FloatArray) -> FloatArray:
        """Return the projections (b, n, n) of twists over ``scale``, (n,), onto those that keep linkages closed."""
        if self.linkages is None:
            return np.broadcast_to(np.eye(len(scale)), (len(joints), len(scale), len(scale)))
        rows = self.linkage_rows(joints) * scale
        return np.eye(len(scale)) - np.linalg.pinv(rows, rcond=1e-6) @ rows

    def points_by_link(self, chosen: IntArray) -> dict[str, FloatArray]:
        """Return chosen samples by link, (m, 3) each, metres, link frame."""
        result = dict[str, FloatArray]()
        for number in np.unique(self._owners[chosen]):
            pose, at = self.links.pose[self._names[number]], self.samples.at[chosen[self._owners[chosen] == number]]
            result[self._names[number]] = (at - pose[:3, 3]) @ pose[:3, :3]
        return result

    def part_frames(self, frames: Frames) -> FloatArray:
        """Return the frames (b, n, 4, 4) of the links of all parts."""
        return frames.of_links([part.link for part in self.parts.parts])

    def lowest_samples(
        self, grid: HasDistance, frames: Frames, reach: float
    ) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray]:
        """Return, of each bin of samples, the one nearest to a solid, where nearer than ``reach``, metres.

        Their postures and indices (n,), positions (n, 3), distances and gradients of these (n, 3).
        """
        which, hit = np.nonzero(grid.nearest(frames.cloud(self.middles)) < self.reach + reach + grid.spacing)
        counts = self.counts[hit]
        index = np.arange(counts.sum()) + np.repeat(self.first[hit] - np.cumsum(counts) + counts, counts)
        groups = self.middles.groups[hit]
        poses = np.concatenate([frames.R[which, groups].reshape(-1, 9), frames.t[which, groups]], axis=1)
        R = np.repeat(np.ascontiguousarray(poses.T, dtype=np.float32), counts, axis=1)  # and t, one row each
        at = self.samples.columns[:, index]
        x = (R[0:9:3] * at[0] + R[1:9:3] * at[1] + R[2:9:3] * at[2] + R[9:]).T
        near = np.flatnonzero(grid.nearest(x) < reach + grid.spacing)
        which, index, x = np.repeat(which, counts)[near], index[near], x[near].astype(float)
        value, slope = grid.distance(x)
        keys = which * len(self.first) + self.bins[index]  # in order
        starts = np.flatnonzero(np.diff(keys, prepend=-1))
        least = np.repeat(np.minimum.reduceat(value, starts), np.diff(starts, append=len(keys))) if len(keys) else value
        lowest = np.flatnonzero((value == least) & (value < reach))
        lowest = lowest[np.diff(keys[lowest], prepend=-1) > 0]
        return which[lowest], index[lowest], x[lowest], value[lowest], slope[lowest]


def _squared_distances(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the squares (..., n, m) of the distances of points (..., n, 3) from points (m, 3)."""
    return np.asarray(np.sum(a * a, axis=-1)[..., None] - 2.0 * (a @ b.T) + np.sum(b * b, axis=-1))


def _in_frames(x: FloatArray, R: FloatArray, t: FloatArray) -> FloatArray:
    """Return points (m, 3), each in coordinates of its frame, rotations (m, 3, 3) and origins (m, 3)."""
    return np.asarray(((x - t)[:, None] @ R)[:, 0])


def _finger_numbers(moves: BoolArray) -> IntArray:
    """Return the number of each fingertip's finger, (k,), from 0 on, given which joints move it, (k, joints).

    A fingertip is of the finger that goes on from it; where several do, as from a palm, it is by itself.
    """
    contained = np.all(moves[:, None] <= moves, axis=2)  # all joints that move the first one move the second
    same = np.argmax(contained & contained.T, axis=1)
    is_end = ~np.any(contained & ~contained.T, axis=1)
    ends = [np.unique(same[of_one & is_end]) for of_one in contained]
    owners = [int(end[0]) if len(end) == 1 else i for i, end in enumerate(ends)]
    return np.unique(owners, return_inverse=True)[1]


def _filled(patch: Triangles, spacing: float = 4e-3) -> FloatArray:
    """Return the vertices of a patch, and points of its triangles that are larger than ``spacing``, metres."""
    import trimesh

    points = trimesh.remesh.subdivide_to_size(patch.vertices, patch.faces, spacing)[0]
    _, first = np.unique(np.round(points / 1e-5), axis=0, return_index=True)
    return np.asarray(points[np.sort(first)])


def _surface(shapes: Sequence[CollisionShape], spacing: float) -> dict[str, FloatArray]:
    """Return points all over the convex hulls of shapes, corners included, without those inside another shape."""
    result = list[FloatArray]()
    for shape in shapes:
        hull = shape.mesh.convex_hull if shape.kind == "mesh" else shape.mesh
        corners = hull.vertices if len(hull.vertices) <= 64 else hull.vertices[:0]
        points = np.concatenate([corners, *_lattices(np.asarray(hull.triangles), spacing)])
        _, first = np.unique(_cell_numbers(np.floor(points / (0.7 * spacing))), return_index=True)
        points = points[np.sort(first)]
        for other in shapes:
            if other is not shape:
                points = points[other.depth(points) < 5e-4]
        result.append(points)
    return {"at": np.concatenate(result)}


def _lattices(triangles: FloatArray, spacing: float) -> Iterator[FloatArray]:
    """Yield points (m, 3) of triangles (n, 3, 3) on regular lattices whose sides are at most ``spacing``, metres."""
    longest = np.max(np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2), axis=1, initial=0.0)
    parts = np.maximum(np.ceil(longest / spacing), 1.0).astype(int)
    for count in np.unique(parts):
        i, j = np.nonzero(np.add.outer(np.arange(count + 1), np.arange(count + 1)) <= count)
        weights = np.stack([i, j, count - i - j], axis=1) / count
        yield (weights @ triangles[parts == count]).reshape(-1, 3)


def _cell_numbers(cells: FloatArray) -> IntArray:
    """Return a number for each cell of a grid (n, d), in the cells' order."""
    whole = (cells - cells.min(axis=0, initial=np.inf)).astype(np.int64)
    return np.asarray(np.ravel_multi_index(whole.T, whole.max(axis=0, initial=0) + 1))
