"""Self-collision constraints of links and fingertips, with an allowed overlap for each pair of links.

Spheres around a link reach beyond it: hardly any random posture keeps all spheres of a hand apart, while a quarter of
them keep the links apart. So each pair of links has an allowed overlap, from random postures: the least overlap of
their spheres among the postures in which the links' hulls penetrate by a millimetre, less the expected bias of a
uniform sample's minimum, ``(largest - least) / m`` for m such postures. Links whose spheres meet in many postures and
whose hulls do in none are not constrained (docs/hands.md).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import casadi as ca
import numpy as np

from nlpgrasp.common.cache import cached_arrays
from nlpgrasp.common.scalar_constraints import SELF_COLLISION, TIPS_APART, LinkSphere, ScalarConstraint
from nlpgrasp.common.types import Expression
from nlpgrasp.common.unit_directions import directions_around
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.hands.collision_shapes import CollisionShape
from nlpgrasp.hands.kinematics import LinkTree
from nlpgrasp.hands.link_spheres import SphereFit

SAMPLES = 1500  # random postures
MAX_POSTURES = 300  # largest number of postures per pair whose hulls are compared
ALWAYS_SHARE = 0.95  # share of postures: links that collide more often do so by construction
MIN_POSTURES = 20  # postures with meeting spheres and disjoint hulls after which a pair is not constrained
# penetration of hulls
HULL_DEPTH = 1e-3  # metres of penetration above which hulls count as colliding
MAX_CORNERS = 64  # largest number of corners, and of normals, of a hull
MIN_DISTANCE = 1e-12  # metres between the middles of hulls; nearer ones have no direction between them
FIRST_DIRECTION = np.array([0.0, 0.0, 1.0])  # unit, the first separating direction
EDGE_DIRECTIONS = directions_around(FIRST_DIRECTION, 60)  # beside the normals, for contact of edges with edges


def find_colliding_pairs(tree: LinkTree, fits: Mapping[str, SphereFit]) -> tuple[LinkPair, ...]:
    """Return the pairs of links that self-collision constraints keep apart.

    Left out are neighbours in the chain, links that overlap in nearly all postures, and links whose spheres meet in
    many postures but whose hulls do in none. Pairs that collide in no posture are included, without pairs of spheres.
    """
    poses = _random_poses(tree, fits)
    spheres = {link: MovedSpheres.of(fit, poses[link]) for link, fit in fits.items()}
    link_pairs = list(_separated_pairs(tree, fits))
    overlaps = _allowed_overlaps(tree, fits, poses, spheres, link_pairs)
    result = []
    for (a, b), overlap in zip(link_pairs, overlaps, strict=True):
        if not np.isfinite(overlap):
            continue
        overlapping = spheres[a].gaps_near(spheres[b])[1] < -overlap
        if np.sum(overlapping.any(axis=(1, 2))) <= ALWAYS_SHARE * SAMPLES:
            sphere_pairs = zip(*np.nonzero(overlapping.any(axis=0)), strict=True)
            result.append(LinkPair((a, b), float(overlap), tuple((int(i), int(j)) for i, j in sphere_pairs)))
    return tuple(result)


@dataclass(frozen=True)
class LinkPair:
    """A pair of links with self-collision constraints.

    Parameters
    ----------
    links : tuple of two str
    overlap : float
        How far their spheres may overlap, metres.
    pairs : tuple of pairs of int
        Numbers of the spheres that overlap more than that in some posture.
    """

    links: tuple[str, str]
    overlap: float
    pairs: tuple[tuple[int, int], ...]


def _random_poses(tree: LinkTree, fits: Mapping[str, SphereFit]) -> dict[str, FloatArray]:
    """Return the links' poses for random joint positions, (samples, 4, 4) each, palm frame."""
    names = tree.used_links
    poses = tree.palm_poses(tree.random_joints(SAMPLES, np.random.default_rng(0)))
    return {name: poses[:, names.index(name)] for name in fits}


def _separated_pairs(tree: LinkTree, fits: Mapping[str, SphereFit]) -> Iterator[tuple[str, str]]:
    """Yield the pairs of links that have more than one moving joint between them."""
    groups = tree.robot.rigid_groups
    for a, b in combinations(fits, 2):
        if groups[a] != groups[b] and not tree.robot.adjacent(a, b):
            yield a, b


@dataclass(frozen=True)
class MovedSpheres:
    """Spheres of a link in s postures, with a ball around them.

    Parameters
    ----------
    centres : (s, m, 3) array
        Metres, palm frame.
    radii : (m,) array
        Metres.
    middles : (s, 3) array
        Centres of the ball, metres.
    reach : float
        Its radius, metres.
    """

    centres: FloatArray
    radii: FloatArray
    middles: FloatArray
    reach: float

    @classmethod
    def of(cls, fit: SphereFit, poses: FloatArray) -> MovedSpheres:
        """Return the spheres of a link with the given poses (s, 4, 4)."""
        middle = fit.centres.mean(axis=0) if len(fit.centres) else np.zeros(3)
        reach = float(np.max(np.linalg.norm(fit.centres - middle, axis=1) + fit.radii, initial=-np.inf))
        rotations, positions = poses[:, :3, :3], poses[:, :3, 3]
        centres = np.einsum("sij,mj->smi", rotations, fit.centres) + positions[:, None]
        return cls(centres, fit.radii, rotations @ middle + positions, reach)

    def gaps_near(self, other: MovedSpheres) -> tuple[IntArray, FloatArray]:
        """Return the indices (n,) of postures in which two links' balls meet, and the gaps of their spheres there.

        Gaps (n, m, m') are signed distances, metres, negative where spheres overlap.
        """
        near = np.flatnonzero(np.linalg.norm(self.middles - other.middles, axis=1) < self.reach + other.reach)
        first, second = self.centres[near], other.centres[near]
        squares = [np.einsum("smx,smx->sm", centres, centres) for centres in (first, second)]
        products = first @ second.transpose(0, 2, 1)
        distances = np.sqrt(np.maximum(squares[0][:, :, None] + squares[1][:, None] - 2.0 * products, 0.0))
        return near, distances - self.radii[:, None] - other.radii


def _allowed_overlaps(
    tree: LinkTree,
    fits: Mapping[str, SphereFit],
    poses: Mapping[str, FloatArray],
    spheres: Mapping[str, MovedSpheres],
    link_pairs: Sequence[tuple[str, str]],
) -> FloatArray:
    """Return the sphere overlaps (c,) allowed for pairs of links, metres.

    Infinite for links whose spheres meet in many postures but whose hulls do in none; zero if their spheres meet in too
    few postures to tell.
    """

    def make() -> dict[str, FloatArray]:
        hulls = {link: [ShapeHull.of(shape) for shape in tree.robot.shapes.get(link, ())] for link in fits}
        values = []
        for a, b in link_pairs:
            near, gaps = spheres[a].gaps_near(spheres[b])
            values.append(_allowed_overlap(hulls[a], hulls[b], poses[a][near], poses[b][near], gaps))
        return {"overlaps": np.array(values)}

    arrays = [np.concatenate([poses[link].ravel(), fit.centres.ravel(), fit.radii]) for link, fit in fits.items()]
    shapes = [shape.content for link in fits for shape in tree.robot.shapes.get(link, ())]
    return cached_arrays("overlaps", ["\n".join(fits).encode(), *shapes, *arrays], make)["overlaps"]


def _allowed_overlap(
    hulls: Sequence[ShapeHull],
    other_hulls: Sequence[ShapeHull],
    frames: FloatArray,
    other_frames: FloatArray,
    gaps: FloatArray,
) -> float:
    """Return the sphere overlap allowed for a pair of links, metres, given sphere distances (b, m, n) in postures."""
    overlap = -gaps.min(axis=(1, 2), initial=np.inf)
    indices = np.flatnonzero(overlap > 0.0)
    indices = indices[:: max(1, len(indices) // MAX_POSTURES)]
    if not len(indices) or not hulls or not other_hulls:
        return 0.0
    depths = hull_penetration(hulls, other_hulls, np.linalg.inv(frames[indices]) @ other_frames[indices])
    deep_overlaps = overlap[indices][depths > HULL_DEPTH]
    if not len(deep_overlaps):
        return np.inf if len(indices) >= MIN_POSTURES else 0.0
    bias = (np.max(overlap) - np.min(deep_overlaps)) / len(deep_overlaps)
    return max(0.0, float(np.min(deep_overlaps) - bias))


@dataclass(frozen=True)
class ShapeHull:
    """Convex hull of a shape: corners and face normals.

    Parameters
    ----------
    corners : (v, 3) array
        Metres, link frame; of a hull with many, the extreme points in ``MAX_CORNERS`` directions.
    normals : (d, 3) array
        Unit; of a hull with many, ``MAX_CORNERS`` directions all around.
    """

    corners: FloatArray
    normals: FloatArray

    @classmethod
    def of(cls, shape: CollisionShape) -> ShapeHull:
        """Return the hull of a shape."""
        hull = shape.mesh.convex_hull if shape.kind == "mesh" else shape.mesh
        corners, normals = np.asarray(hull.vertices), np.unique(np.asarray(hull.face_normals).round(6), axis=0)
        directions = directions_around(FIRST_DIRECTION, MAX_CORNERS)
        if len(corners) > MAX_CORNERS:
            corners = corners[np.unique(np.argmax(corners @ directions.T, axis=0))]
        return cls(corners, normals if len(normals) <= MAX_CORNERS else directions)


def hull_penetration(hulls: Sequence[ShapeHull], other_hulls: Sequence[ShapeHull], frames: FloatArray) -> FloatArray:
    """Return the largest penetration depth of the hulls of two links, (b,), metres; negative if they are apart.

    Two convex sets are disjoint if, in some direction, one's support function plus the other's in the opposite
    direction is negative. The least sum over the hulls' normals and further directions is an upper bound on the depth.
    Where the line between the middles is such a direction, no other one is tried.

    Parameters
    ----------
    hulls, other_hulls : sequence of ShapeHull
        Of each link.
    frames : (b, 4, 4) array
        Of the other link in the first one's.
    """
    result = np.full(len(frames), -np.inf)
    for start in range(0, len(frames), 32):  # few postures at a time need little memory
        part = frames[start : start + 32]
        for a, b in product(hulls, other_hulls):
            depths = _hull_depth(a, b, part[:, :3, :3], part[:, :3, 3])
            result[start : start + 32] = np.maximum(result[start : start + 32], depths)
    return result


def _hull_depth(a: ShapeHull, b: ShapeHull, rotations: FloatArray, translations: FloatArray) -> FloatArray:
    """Return the penetration depth of two convex hulls, (b,), metres; negative if they are apart."""
    corners = b.corners @ rotations.transpose(0, 2, 1) + translations[:, None]  # (b, v, 3), the first one's frame
    between = corners.mean(axis=1) - a.corners.mean(axis=0)
    distances = np.linalg.norm(between, axis=1, keepdims=True)
    between = np.where(distances > MIN_DISTANCE, between / np.maximum(distances, MIN_DISTANCE), FIRST_DIRECTION)
    depths = np.max(between @ a.corners.T, axis=1) - np.min(np.einsum("bvx,bx->bv", corners, between), axis=1)
    meet = np.flatnonzero(depths > 0.0)
    if len(meet):
        corners, normals = corners[meet], np.concatenate([a.normals, EDGE_DIRECTIONS])
        gaps = np.max(a.corners @ normals.T, axis=0) - np.min(corners @ normals.T, axis=1)
        directions = (b.normals @ rotations[meet].transpose(0, 2, 1)).transpose(0, 2, 1)  # these point out of b
        other_gaps = np.max(corners @ directions, axis=1) - np.min(a.corners @ directions, axis=1)
        depths[meet] = np.minimum(gaps.min(axis=1), other_gaps.min(axis=1))
    return np.asarray(depths)


def self_collision_constraints(
    watched: Sequence[LinkPair], spheres: Sequence[LinkSphere], span: float
) -> list[ScalarConstraint]:
    """Return one constraint per pair of spheres: the overlap is at most the allowed one.

    Parameters
    ----------
    watched : sequence of LinkPair
    spheres : sequence of LinkSphere
        Of all links, named ``"link/number"``.
    span : float
        The hand's size, metres, for scaling.
    """
    by_name = {s.link: s for s in spheres if not s.is_tip}
    result = []
    for pair in watched:
        for i, j in pair.pairs:
            a, b = by_name[f"{pair.links[0]}/{i}"], by_name[f"{pair.links[1]}/{j}"]
            squared, least = ca.sumsqr(a.centre - b.centre), (a.radius + b.radius - pair.overlap) ** 2
            part = f"{a.link} and {b.link}"
            result.append(ScalarConstraint(SELF_COLLISION, squared, least, scale=span**2, unit="m2", part=part))
    return result


def colliding_tips(tree: LinkTree) -> tuple[tuple[int, int], ...]:
    """Return the pairs of round fingertips that can collide: those not on adjacent links."""
    groups, robot = tree.robot.rigid_groups, tree.robot
    round_tips = [(i, link) for i, (link, tip) in enumerate(tree.tips) if tip.standoff > 0.0]
    return tuple(
        (i, j) for (i, a), (j, b) in combinations(round_tips, 2) if groups[a] != groups[b] and not robot.adjacent(a, b)
    )


def tip_clearance_constraints(tree: LinkTree, variables: dict[str, Expression]) -> list[ScalarConstraint]:
    """Return one constraint per pair of round fingertips: the balls do not overlap.

    Parameters
    ----------
    tree : LinkTree
    variables : dict
        Symbols of the hand's variables, by name.
    """
    centres, radii = tree.tip_centres(variables), [tip.standoff for _, tip in tree.tips]
    result = []
    for i, j in colliding_tips(tree):
        a, b = centres[i], centres[j]
        if a is not None and b is not None:
            squared, least = ca.sumsqr(a - b), (radii[i] + radii[j]) ** 2
            result.append(ScalarConstraint(TIPS_APART, squared, least, scale=tree.span**2, unit="m2", fingers=(i, j)))
    return result
