"""Exact collision shapes of a hand's links: surface samples, and distances between links by MuJoCo.

A part is one collision shape of the robot file, fixed to its link. MuJoCo measures the distance of two parts, or the
shortest translation that separates them (Gilbert, Johnson, Keerthi 1988; van den Bergh 2001): spheres, capsules,
cylinders and boxes are exact, a mesh counts as its convex hull. Where a hull is in something and its mesh is not
convex, samples of one surface are measured in the other mesh.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations, pairwise
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from nlpgrasp.bodies.distance_grid import DistanceGrid
from nlpgrasp.common.cache import cached_arrays
from nlpgrasp.common.meshes.search_tree import SearchTree
from nlpgrasp.common.optional_packages import import_mujoco
from nlpgrasp.common.unit_directions import directions_around
from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.hands.collision_shapes import CollisionShape
from nlpgrasp.hands.tips import Tip
from nlpgrasp.solution.obstructions import LEAST_DEPTH


@dataclass(frozen=True)
class LinkPart:
    """A solid that is fixed to a link.

    Parameters
    ----------
    link : str
    shape : CollisionShape or None
        None for the ball of a fingertip whose link has no shape.
    points : (m, 3) array
        Samples of its surface; of a sphere its centre. Metres, link frame.
    radius : float
        Of the balls about these points that make up the part, metres; 0 where they are on its surface.
    normals, offsets : (f, 3) and (f,) array
        Outward unit normals and offsets, metres, of the faces of its convex hull.
    is_convex : bool
    triangles : (t, 3, 3) array
        Of its surface, metres, link frame.
    """

    link: str
    shape: CollisionShape | None
    points: FloatArray
    radius: float
    normals: FloatArray
    offsets: FloatArray
    is_convex: bool
    triangles: FloatArray

    @classmethod
    def of(cls, link: str, shape: CollisionShape, as_hull: bool) -> LinkPart:
        """Return the part of a collision shape, with its vertices for samples."""
        vertices, faces = np.asarray(shape.mesh.vertices, dtype=float), np.asarray(shape.mesh.faces)
        hull = _hull(vertices)
        if hull is None:  # flat
            return cls(link, shape, vertices, 0.0, np.zeros((0, 3)), np.zeros(0), False, vertices[faces])
        many = len(hull.equations) > 1000
        normals = hull.equations[:, :3] if many else np.unique(hull.equations[:, :3].round(6), axis=0)
        if len(normals) > 200:  # planes that support the hull, somewhat outside it in between
            normals = directions_around(np.eye(3)[2], 200)
        planes = normals, np.max(normals @ vertices[hull.vertices].T, axis=1)
        if shape.centre is not None and shape.kind == "sphere":
            return cls(link, shape, shape.centre[None].copy(), shape.radius, *planes, True, vertices[faces])
        volume = abs(float(np.sum(np.linalg.det(vertices[faces] - vertices.mean(axis=0)))) / 6.0)
        is_hull = as_hull or volume < 0.05 * hull.volume  # so is a sheet, which encloses no volume
        faces = hull.simplices if is_hull else faces
        return cls(link, shape, vertices, 0.0, *planes, is_hull or volume > 0.999 * hull.volume, vertices[faces])

    @cached_property
    def tree(self) -> SearchTree:
        """Search tree of the surface."""
        corners = self.triangles.reshape(-1, 3)
        return SearchTree(corners, np.arange(len(corners)).reshape(-1, 3))

    @property
    def ball(self) -> tuple[FloatArray, float]:
        """Centre (3,) and radius of a ball around the part, metres, link frame."""
        centre = (self.points.min(axis=0) + self.points.max(axis=0)) / 2.0
        return centre, float(np.max(np.linalg.norm(self.points - centre, axis=1))) + self.radius

    def outer_distance(self, points: FloatArray) -> FloatArray:
        """Return a signed distance of points (m, 3), link frame, (m,), metres: nowhere more than the true one."""
        return self.outer_distance_with_normals(points)[0]

    def outer_distance_with_normals(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ``outer_distance``, and its gradients (m, 3): outward normals of the ball or of the hull's faces."""
        if self.radius > 0.0:
            away = points - self.points[0]
            lengths = np.linalg.norm(away, axis=1)
            return lengths - self.radius, away / np.maximum(lengths, 1e-12)[:, None]
        if not len(self.normals):
            return np.full(len(points), -np.inf), np.zeros_like(points)
        beyond = points @ self.normals.T - self.offsets
        face = np.argmax(beyond, axis=1)
        return beyond[np.arange(len(face)), face], self.normals[face]

    def distance(self, points: FloatArray, limit: float = np.inf) -> FloatArray:
        """Return the signed distance of points (m, 3), link frame, (m,), metres, where it is less than a limit."""
        return self.distance_with_normals(points, limit)[0]

    def distance_with_normals(self, points: FloatArray, limit: float = np.inf) -> tuple[FloatArray, FloatArray]:
        """Return ``distance``, and its gradients (m, 3); elsewhere those of ``outer_distance``."""
        result, normals = self.outer_distance_with_normals(points)
        if self.radius == 0.0 and not (self.is_convex and len(self.normals) < 200):
            near = np.flatnonzero(result < limit)
            if len(near):
                result[near], normals[near] = self.tree.exact_signed_distance_with_gradient(points[near])
        return result, normals


class LinkParts:
    """The solids of a hand's links, with the pairs of them that are kept apart.

    Left out are links that are fixed to each other or neighbours in the chain, and links that overlap by construction:
    in nine tenths of random postures.

    Parameters
    ----------
    hand : URDFHand
    spacing : float
        Of the samples, metres.
    hulls : bool
        Whether each shape counts as its convex hull, as in MuJoCo.

    Attributes
    ----------
    parts : tuple of LinkPart
        The balls of round fingertips whose links have no shapes are among them.
    links : (n,) int array
        Index of each part's link among the tree's used links.
    tips : (n,) bool array
        Whether a part reaches a fingertip that is fixed to it.
    centres, reaches : (n, 3) and (n,) array
        Of a ball around each part, metres, link frame.
    radii : (n,) array
        Of the balls about the parts' samples, metres.
    """

    def __init__(self, hand: URDFHand, spacing: float = 2.5e-3, hulls: bool = False) -> None:
        self.hand, robot = hand, hand.robot
        shapes = [(link, shape) for link, shapes in robot.shapes.items() for shape in shapes]
        known = {shape.fingerprint: LinkPart.of(link, shape, hulls) for link, shape in _first(shapes)}
        parts = [replace(known[shape.fingerprint], link=link, shape=shape) for link, shape in shapes]
        key = [repr((spacing, hulls, [link for link, _ in shapes])).encode(), *(shape.content for _, shape in shapes)]
        samples = cached_arrays("link-samples", key, partial(_all_samples, parts, spacing))
        split = np.split(samples["points"], np.cumsum(samples["counts"]).astype(int))[: len(parts)]
        parts = [replace(part, points=points) for part, points in zip(parts, split, strict=True)]
        shaped = {robot.rigid_groups[part.link] for part in parts}
        for link, tip in hand.tips:
            if tip.standoff > 0.0 and robot.rigid_groups[link] not in shaped and not tip.slides:
                centre, none = np.asarray(tip.centre, dtype=float)[None], (np.zeros((0, 3)), np.zeros(0))
                parts.append(LinkPart(link, None, centre, tip.standoff, *none, True, np.zeros((0, 3, 3))))
        self.parts = tuple(parts)
        self.links = np.array([hand.tree.used_links.index(part.link) for part in parts], int)
        self.tips = np.array([any(_reaches(part, hand, *tip) for tip in hand.tips) for part in parts], bool)
        balls = [part.ball for part in parts]
        self.centres = np.array([centre for centre, _ in balls]).reshape(-1, 3)
        self.reaches = np.array([radius for _, radius in balls])
        self.radii = np.array([part.radius for part in parts])

    @cached_property
    def pairs(self) -> IntArray:
        """The pairs of parts whose links are kept apart, (r, 2)."""
        pairs = self._distant_pairs if self.hand.self_collision else np.zeros((0, 2), int)
        if not len(pairs):
            return pairs
        postures = self.palm_frames(self.hand.tree.random_joints(20, np.random.default_rng(0)))
        overlaps = np.array([self.pair_distances(frames, pairs) for frames in postures]) < -LEAST_DEPTH
        links = self.links[pairs]
        _, of_pair = np.unique(links, axis=0, return_inverse=True)
        permanent = [np.sum(overlaps[:, of_pair == i].any(axis=1)) >= 18 for i in range(int(np.max(of_pair)) + 1)]
        return np.asarray(pairs[~np.array(permanent)[of_pair.ravel()]])

    @property
    def _distant_pairs(self) -> IntArray:
        """The pairs (r, 2) of parts whose links are neither fixed to each other nor neighbours."""
        groups, adjacent = self.hand.robot.rigid_groups, self.hand.robot.adjacent
        of_links: dict[tuple[str, str], bool] = {}
        for a, b in combinations(dict.fromkeys(groups[part.link] for part in self.parts), 2):
            of_links[a, b] = of_links[b, a] = not adjacent(a, b)
        names = [groups[part.link] for part in self.parts]
        pairs = [(i, j) for i, j in combinations(range(len(names)), 2) if of_links.get((names[i], names[j]), False)]
        return np.array(pairs, int).reshape(-1, 2)

    def palm_frames(self, joints: FloatArray) -> FloatArray:
        """Return the frames of the parts' links in the palm's, (b, n, 4, 4), at positions (b, m) of the free joints."""
        return self.hand.tree.palm_poses(joints)[:, self.links]

    def frames_of(self, postures: Sequence[Values]) -> FloatArray:
        """Return the frames of the parts' links in the body's, (b, n, 4, 4), given the hand's variables in postures."""
        palm = self.palm_frames(np.array([values["joints"] for values in postures], dtype=float))
        return np.asarray(np.stack([self.hand.tree.palm_frame(values) for values in postures])[:, None] @ palm)

    def frames(self, values: Values) -> FloatArray:
        """Return the frames of the parts' links in the body's, (n, 4, 4), given values of the hand's variables."""
        return np.asarray(self.frames_of([values])[0])

    def extent(self, values: Values, direction: FloatArray) -> float:
        """Return how far the hand reaches in a direction (3,) of the body frame, metres."""
        frames, table = self.frames(values), self._samples
        parts = np.repeat(np.arange(len(self.parts)), [len(part.points) for part in self.parts])
        heights = np.einsum("ij,ij->i", table.points, (direction @ frames[:, :3, :3])[parts])
        return float(np.max(heights + (frames[:, :3, 3] @ direction + self.radii)[parts], initial=-np.inf))

    def outline(self, values: Values) -> tuple[FloatArray, FloatArray]:
        """Return outermost points of all parts, (m, 3), body frame, and the radii of balls about them, (m,), metres."""
        points, parts = self.outermost
        return _moved(points, self.frames(values)[parts]), self.radii[parts]

    @cached_property
    def outermost(self) -> tuple[FloatArray, IntArray]:
        """Outermost points of all parts in 60 directions, (m, 3), metres, link frame, and their parts, (m,)."""
        directions = directions_around(np.eye(3)[2], 60)
        result = [part.points[np.unique(np.argmax(part.points @ directions.T, axis=0))] for part in self.parts]
        parts = np.repeat(np.arange(len(result)), [len(points) for points in result])
        return np.concatenate([np.zeros((0, 3)), *result]), parts

    def ball_centres(self, frames: FloatArray) -> FloatArray:
        """Return the centres of the balls around the parts, (..., n, 3), given the links' frames (..., n, 4, 4)."""
        return np.asarray((frames[..., :3, :3] @ self.centres[:, :, None])[..., 0] + frames[..., :3, 3])

    def nearest_samples(
        self,
        chosen: IntArray,
        frames: FloatArray,
        distance: Callable[[FloatArray], FloatArray],
        grid: DistanceGrid | None = None,
        count: int = 8,
        close: float = np.inf,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the distance (p,) of each chosen part from a solid, metres, and the part's nearest point, (p, 3).

        Parameters
        ----------
        chosen : (p,) int array
            Indices of parts, one or more times each.
        frames : (p, 4, 4) array
            Frames of their links.
        distance : callable
            Points (m, 3) to their distances (m,) from the solid, metres.
        grid : DistanceGrid, optional
            The same distance on a grid, by which the most promising samples are chosen.
        count : int
            Number of samples of a part that are then measured, at most.
        close : float
            Distance up to which they are measured, metres; of parts farther away it is the least that the grid allows.
        """
        coarse, error = (distance, 0.0) if grid is None else (grid.nearest, grid.spacing)
        table = self._samples
        cells, owner = ranges(table.first_cells[chosen], table.cells[chosen])
        middles = _moved(table.middles[cells], frames[owner])
        value = coarse(middles)
        lowest = value - table.reaches[cells] - error
        first = first_of_each(owner, lowest)
        result, nearest = lowest[first] - self.radii[chosen], middles[first]
        is_near = result < close
        if not np.any(is_near):
            return result, nearest
        outside = np.zeros(len(middles)) if grid is None else grid.beyond(middles)  # where it tells less
        highest = value + table.reaches[cells] + error + outside
        keep = is_near[owner] & (lowest <= _least(owner, highest)[owner])
        owner = (np.cumsum(is_near) - 1)[owner]
        chosen, frames = chosen[is_near], frames[is_near]
        index, of_cell = ranges(table.first[cells[keep]], table.sizes[cells[keep]])
        owner = owner[keep][of_cell]
        points = _moved(table.points[index], frames[owner])
        value = coarse(points)
        if grid is not None:
            outside = grid.beyond(points)
            near = np.flatnonzero(value <= _least(owner, value + outside)[owner] + 2.0 * error)
            owner, points, outside = owner[near], points[near], outside[near]
            value = grid.distance(points)[0]
            order = np.lexsort((value, owner))
            ranks = np.arange(len(order)) - np.searchsorted(owner[order], owner[order])
            is_first = ranks < count
            near = order[is_first | (outside[order] > 0.0)]
            is_first = is_first[is_first | (outside[order] > 0.0)]
            owner, points, value = owner[near], points[near], value[near]
            measured = is_first & (_least(owner, value) - self.radii[chosen] < close)[owner]
            value[measured] = distance(points[measured])
            value[~measured] -= error
        first = first_of_each(owner, value)
        result[is_near], nearest[is_near] = value[first] - self.radii[chosen], points[first]
        return result, nearest

    @cached_property
    def _samples(self) -> BinnedPoints:
        return BinnedPoints.of([part.points for part in self.parts])

    def points(self, part: int, frame: FloatArray) -> FloatArray:
        """Return the samples (m, 3) of a part whose link has the given frame (4, 4)."""
        return np.asarray(self.parts[part].points @ frame[:3, :3].T + frame[:3, 3])

    def pair_distances(self, frames: FloatArray, pairs: IntArray) -> FloatArray:
        """Return the distance of the two parts of each pair (r, 2), (r,), metres; negative where they penetrate.

        Where the balls around two parts are apart it is the distance of these, which is less. ``frames`` (n, 4, 4) are
        those of the parts' links, in one frame.
        """
        gaps = self._ball_gaps(frames[None], pairs)[0]
        near = np.flatnonzero(gaps < 0.0)
        if len(near):
            gaps[near] = self._exact_distances(frames[None], np.zeros(len(near), int), pairs[near], 1.0)[0]
        return np.asarray(gaps)

    def near_pairs(
        self, frames: FloatArray, pairs: IntArray, reach: float
    ) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray]:
        """Return the pairs (r, 2) that are nearer than a reach, metres, in postures with frames (b, n, 4, 4).

        Postures and indices of pairs (m,), distances (m,), nearest points (m, 2, 3) on the first and on the second
        part, and unit vectors (m, 3) from the first to the second; where parts penetrate, along the shortest
        translation that separates them.
        """
        which, index = self._pairs_within(frames, pairs, reach)
        distances, ends = self._exact_distances(frames, which, pairs[index], reach)
        lines = ends[:, 1] - ends[:, 0]
        lengths = np.linalg.norm(lines, axis=1)
        near = (distances < reach) & (lengths > 1e-9)
        signs = np.where(distances < 0.0, -1.0, 1.0)[near]
        directions = lines[near] * (signs / lengths[near])[:, None]
        return which[near], index[near], distances[near], ends[near], directions

    def overlap_mask(self, frames: FloatArray, pairs: IntArray) -> BoolArray:
        """Return in which postures, with frames (b, n, 4, 4), some pair (r, 2) penetrates, (b,)."""
        which, index = self._pairs_within(frames, pairs, 0.0)
        distances, _ = self._exact_distances(frames, which, pairs[index], 0.0, stops=True)
        return np.bincount(which, distances < 0.0, len(frames)) > 0

    def _pairs_within(self, frames: FloatArray, pairs: IntArray, reach: float) -> tuple[IntArray, IntArray]:
        """Return postures and pairs (m,) whose capsules are nearer than a reach, metres, in order of the postures."""
        which, index = np.nonzero(self._ball_gaps(frames, pairs) < reach)
        ends, radii = self._capsules
        first, second = (
            (frames[which, part, None, :3, :3] @ ends[part, :, :, None])[..., 0] + frames[which, part, None, :3, 3]
            for part in pairs[index].T
        )
        near = segment_distances(first, second) < radii[pairs[index]].sum(axis=1) + reach
        return which[near], index[near]

    @cached_property
    def _capsules(self) -> tuple[FloatArray, FloatArray]:
        """Ends (n, 2, 3) of the axes of capsules around the parts, metres, link frames, and their radii (n,)."""
        ends, radii = np.zeros((len(self.parts), 2, 3)), np.zeros(len(self.parts))
        for i, part in enumerate(self.parts):
            middle = part.points.mean(axis=0)
            axis = np.linalg.eigh(np.cov((part.points - middle).T) if len(part.points) > 1 else np.eye(3))[1][:, 2]
            along = (part.points - middle) @ axis
            across = np.linalg.norm(part.points - middle - along[:, None] * axis, axis=1)
            middle = middle + 0.5 * (along.min() + along.max()) * axis
            half = max(0.5 * np.ptp(along) - 0.5 * float(across.max()), 0.0)  # spherical ends may be outside
            ends[i] = middle + half * axis * np.array([[-1.0], [1.0]])
            radii[i] = part.radius + np.max(segment_distances(part.points[:, None].repeat(2, axis=1), ends[i][None]))
        return ends, radii

    def _ball_gaps(self, frames: FloatArray, pairs: IntArray) -> FloatArray:
        """Return the distances (b, r) of the balls around the parts of pairs, metres, given frames (b, n, 4, 4)."""
        centres, (i, j) = self.ball_centres(frames).astype(np.float32).transpose(2, 0, 1), pairs.T
        x, y, z = (along[:, i] - along[:, j] for along in centres)  # rounding is below a micrometre
        return np.asarray(np.sqrt(x * x + y * y + z * z) - (self.reaches[i] + self.reaches[j]), float)

    def _exact_distances(
        self, frames: FloatArray, which: IntArray, pairs: IntArray, limit: float, stops: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """Return the distances (m,) of the parts of m pairs, metres, by MuJoCo, and the nearest points (m, 2, 3).

        Pairs farther apart than a limit have the limit for a distance.

        Parameters
        ----------
        frames : (b, n, 4, 4) array
        which : (m,) int array
            Postures of the pairs, in order.
        pairs : (m, 2) int array
        limit : float
            Metres.
        stops : bool
            Leave the pairs of a posture after the first one that penetrates at 0.
        """
        mujoco, model, data, local = self._geoms
        used = np.flatnonzero(np.bincount(which, minlength=len(frames)))
        poses = frames[used] @ local
        places, turns = poses[..., :3, 3], poses[..., :3, :3].reshape(*poses.shape[:2], 9)
        ends, result = np.zeros((len(pairs), 6)), np.zeros(len(pairs))
        starts = np.searchsorted(which, [*used.tolist(), len(frames)]).tolist()
        for posture, (start, end) in enumerate(pairwise(starts)):
            data.geom_xpos[:], data.geom_xmat[:] = places[posture], turns[posture]
            for number, (i, j) in enumerate(pairs[start:end].tolist(), start):
                distance = mujoco.mj_geomDistance(model, data, i, j, limit, ends[number])
                if distance < 0.0 and not (self.parts[i].is_convex and self.parts[j].is_convex):
                    pose = frames[used[posture]]
                    distance = self._mesh_distance(i, j, np.linalg.inv(pose[j]) @ pose[i])
                result[number] = distance
                if stops and distance < 0.0:
                    break
        return result, ends.reshape(-1, 2, 3)

    def _mesh_distance(self, i: int, j: int, pose: FloatArray) -> float:
        """Return the distance of two parts, metres, from their samples; ``pose`` is that of one in the other."""
        a, b = self.parts[i], self.parts[j]
        in_b = b.distance(a.points @ pose[:3, :3].T + pose[:3, 3], 0.0) - a.radius
        in_a = a.distance((b.points - pose[:3, 3]) @ pose[:3, :3], 0.0) - b.radius
        return min(float(np.min(in_b)), float(np.min(in_a)))

    @cached_property
    def _geoms(self) -> tuple[Any, Any, Any, FloatArray]:
        """MuJoCo with a model of the parts, its data, and the geoms' poses (n, 4, 4) in the links' frames."""
        mujoco = import_mujoco("distances between the links of a hand", "hands")
        spec = mujoco.MjSpec()
        kinds, meshes = mujoco.mjtGeom, dict[bytes, str]()
        primitives = {"box": kinds.mjGEOM_BOX, "cylinder": kinds.mjGEOM_CYLINDER, "capsule": kinds.mjGEOM_CAPSULE}
        for part in self.parts:
            geom, shape = spec.worldbody.add_geom(contype=0, conaffinity=0), part.shape
            if part.radius > 0.0 or shape is None:
                geom.type, geom.size, geom.pos = kinds.mjGEOM_SPHERE, [part.radius, 0.0, 0.0], part.points[0]
            elif shape.kind in primitives and shape.pose is not None:
                geom.type, geom.pos, size = primitives[shape.kind], shape.pose[:3, 3], np.asarray(shape.size) / 2.0
                geom.quat = Rotation.from_matrix(shape.pose[:3, :3]).as_quat(scalar_first=True)
                geom.size = size if shape.kind == "box" else [shape.size[0], size[1], 0.0]
            else:
                if shape.fingerprint not in meshes:
                    meshes[shape.fingerprint] = f"mesh{len(meshes)}"
                    mesh = spec.add_mesh(name=meshes[shape.fingerprint])
                    mesh.uservert = np.asarray(shape.mesh.vertices, dtype=float).ravel()
                    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
                geom.type, geom.meshname = kinds.mjGEOM_MESH, meshes[shape.fingerprint]
        model = spec.compile()
        local = np.tile(np.eye(4), (len(self.parts), 1, 1))
        local[:, :3, :3] = Rotation.from_quat(model.geom_quat, scalar_first=True).as_matrix()
        local[:, :3, 3] = model.geom_pos
        return mujoco, model, mujoco.MjData(model), local


@dataclass(frozen=True)
class BinnedPoints:
    """Points of several sets, as of the samples of parts, in cells of 6 mm.

    Parameters
    ----------
    points : (m, 3) array
        Metres, link frames.
    first, sizes : (c,) int arrays
        First sample of each cell, and their number.
    first_cells, cells : (n,) int arrays
        First cell of each part, and their number.
    middles, reaches : (c, 3) and (c,) array
        Of a ball around each cell's samples, metres.
    """

    points: FloatArray
    first: IntArray
    sizes: IntArray
    first_cells: IntArray
    cells: IntArray
    middles: FloatArray
    reaches: FloatArray

    @classmethod
    def of(cls, samples: Sequence[FloatArray]) -> BinnedPoints:
        """Return the table of the samples of each part, (m, 3) each."""
        points = np.concatenate([np.zeros((0, 3)), *samples])
        parts = np.repeat(np.arange(len(samples)), [len(part) for part in samples])
        keys = np.floor(points / 6e-3).astype(int)
        order = np.lexsort((*keys.T, parts))
        points, parts, keys = points[order], parts[order], keys[order]
        first = np.flatnonzero(np.any(np.diff(np.column_stack([parts, keys]), axis=0, prepend=-1), axis=1))
        sizes = np.diff(np.append(first, len(points)))
        middles = np.add.reduceat(points, first) / sizes[:, None] if len(points) else points
        distances = np.linalg.norm(points - np.repeat(middles, sizes, axis=0), axis=1)
        reaches = np.maximum.reduceat(distances, first) if len(points) else distances
        counts = np.bincount(parts[first], minlength=len(samples))
        return cls(points, first, sizes, np.cumsum(counts) - counts, counts, middles, reaches)


def segment_distances(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the distances (m,) of segments (m, 2, 3) from others (m, 2, 3), metres.

    The nearest points of two lines, or of a segment and an end of the other (Ericson 2005, Section 5.1.9).
    """
    d, e, r = first[:, 1] - first[:, 0], second[:, 1] - second[:, 0], first[:, 0] - second[:, 0]
    a, b, c, p, q = (np.einsum("...x,...x->...", *pair) for pair in ((d, d), (d, e), (e, e), (d, r), (e, r)))
    tiny = 1e-18
    s = np.clip((b * q - c * p) / np.maximum(a * c - b * b, tiny), 0.0, 1.0)
    t = np.clip((b * s + q) / np.maximum(c, tiny), 0.0, 1.0)
    s = np.clip((b * t - p) / np.maximum(a, tiny), 0.0, 1.0)
    return np.asarray(np.linalg.norm(r + s[:, None] * d - t[:, None] * e, axis=1))


def _first(shapes: Sequence[tuple[str, CollisionShape]]) -> list[tuple[str, CollisionShape]]:
    """Return the first of alike shapes: those of fingers often are."""
    return list({shape.fingerprint: (link, shape) for link, shape in reversed(shapes)}.values())


def _reaches(part: LinkPart, hand: URDFHand, link: str, tip: Tip) -> bool:
    """Return whether a part reaches the ball of a fingertip, or the middle of its patch.

    It is of the fingertip's link, or fixed to it where that has no shape.
    """
    pose = hand.robot.fixed_transform(link, part.link)
    if pose is None or (part.link != link and hand.robot.shapes.get(link)):
        return False
    centre = pose[:3, :3] @ tip.centre + pose[:3, 3]
    return bool(part.outer_distance(centre[None])[0] < (tip.standoff if tip.standoff > 0.0 else 2e-3))


def ranges(first: IntArray, sizes: IntArray) -> tuple[IntArray, IntArray]:
    """Return the indices from each first one on, of several sizes, one after another, and which range each is of."""
    which = np.repeat(np.arange(len(sizes)), sizes)
    return np.arange(len(which)) + (first - np.cumsum(sizes) + sizes)[which], which


def _least(owner: IntArray, values: FloatArray) -> FloatArray:
    """Return the least of the values (m,) of each owner (m,), which are in order and from 0 on without a gap."""
    return np.asarray(np.minimum.reduceat(values, np.flatnonzero(np.diff(owner, prepend=-1))))


def first_of_each(owner: IntArray, values: FloatArray) -> IntArray:
    """Return the index of the least of the values (m,) of each owner (m,), which are those of ``_least``."""
    order = np.lexsort((values, owner))
    return order[np.flatnonzero(np.diff(owner[order], prepend=-1))]


def _moved(points: FloatArray, frames: FloatArray) -> FloatArray:
    """Return points (m, 3), each moved by its frame (m, 4, 4)."""
    return np.asarray((frames[:, :3, :3] @ points[:, :, None])[..., 0] + frames[:, :3, 3])


def sharp_edge_points(vertices: FloatArray, faces: IntArray, spacing: float, angle: float = 0.5) -> FloatArray:
    """Return points (m, 3) along the edges of a mesh whose faces turn by more than an angle, radians.

    The ends of the edges are among them; the others are at most ``spacing`` apart, metres.
    """
    import trimesh

    mesh = trimesh.Trimesh(vertices, faces, process=True)
    edges = mesh.face_adjacency_edges[mesh.face_adjacency_angles > angle]
    ends = mesh.vertices[edges]
    result = [np.zeros((0, 3)), *ends.transpose(1, 0, 2)]
    counts = np.ceil(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / spacing).astype(int)
    for count in np.unique(counts[counts > 1]):
        shares = np.arange(1, count)[:, None, None] / count
        result.append((ends[counts == count, 0] * (1.0 - shares) + ends[counts == count, 1] * shares).reshape(-1, 3))
    return np.unique(np.concatenate(result).round(9), axis=0)


def _samples(corners: FloatArray, spacing: float) -> FloatArray:
    """Return points all over a surface of triangles (m, 3, 3), about ``spacing`` apart, metres, and on its edges."""
    vertices, indices = corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)
    done = [sharp_edge_points(vertices, indices, spacing), vertices]
    while len(corners):
        sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        is_small = sides.max(axis=1) <= 1.5 * spacing
        done.append(corners[is_small].mean(axis=1))
        corners, first = corners[~is_small], np.argmax(sides[~is_small], axis=1)[:, None]
        order = (first + np.arange(3)) % 3  # the longest side first, which is halved
        a, b, c = np.take_along_axis(corners, order[:, :, None], axis=1).transpose(1, 0, 2)
        middle = (a + b) / 2.0
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    points = np.concatenate(done)
    _, first = np.unique(np.floor(points / (0.7 * spacing)), axis=0, return_index=True)
    return points[np.sort(first)]


def _all_samples(parts: Sequence[LinkPart], spacing: float) -> dict[str, FloatArray]:
    """Return the samples of all parts, one part after another, and the numbers of each.

    Those inside another convex part of the same link are left out.
    """
    known, result = dict[bytes, FloatArray](), [np.zeros((0, 3))]
    for part in parts:
        points, key = part.points, part.triangles.round(9).tobytes()  # fingers are often alike
        if part.radius == 0.0:
            points = known[key] = known[key] if key in known else _samples(part.triangles, spacing)
        for other in parts:
            if other.link == part.link and other is not part and other.is_convex and part.radius == 0.0:
                is_inside = other.distance(points, -5e-4) < -5e-4
                points = points[~is_inside] if not np.all(is_inside) else points[:1]
        result.append(points)
    return {"points": np.concatenate(result), "counts": np.array([len(points) for points in result[1:]], float)}


def _hull(vertices: FloatArray) -> ConvexHull | None:
    """Return the convex hull of points (n, 3); None if they are coplanar."""
    try:
        return ConvexHull(vertices)
    except QhullError:
        return None
