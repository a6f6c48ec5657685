"""Postures of a hand whose fingertips oppose each other, by size of what is between them: once a hand, cached.

Two kinds: around a ball all fingertips face their middle; across a slab two groups of them face each other. Postures
evolve: random ones are scored, the best of each size stay, and others are drawn near them. The score is mu of the
contacts that a posture suggests, less what its links extend beyond the planes in which the fingertips would touch.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from nlpgrasp.common.cache import cached_arrays
from nlpgrasp.common.unit_directions import directions
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.hands.moving_links import Frames
from nlpgrasp.optimize.hand_shapes import HandShapes

KINDS = "ball", "slab"
FIELDS = "joints", "middles", "axes", "radii", "scores", "arrangements"  # of postures
TINY = 1e-12  # metres: fingertips in one place have no direction
SMALLEST, CLASS, CLASSES = 0.004, 0.006, 10  # metres: least radius, width of a class of sizes; number of classes


@dataclass(frozen=True)
class Postures:
    """Postures, n of them, with the ball or slab between their fingertips.

    Parameters
    ----------
    joints : (n, m) array
    middles, axes : (n, 3) arrays
        Of ball or slab, metres and unit, palm frame; no axis (zero) of a ball.
    radii, scores : (n,) arrays
        Half the size, metres; score.
    arrangements : (n,) int array
        Number that tells which fingertips oppose the first one, and how far all are apart across the axis.
    """

    joints: FloatArray
    middles: FloatArray
    axes: FloatArray
    radii: FloatArray
    scores: FloatArray
    arrangements: IntArray

    def of(self, chosen: IntArray) -> Postures:
        """Return some of the postures."""
        return Postures(*(getattr(self, name)[chosen] for name in FIELDS))

    @classmethod
    def joined(cls, parts: list[Postures]) -> Postures:
        """Return several sets as one."""
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in FIELDS))

    @property
    def sizes(self) -> IntArray:
        """Class of sizes of each posture, (n,)."""
        return np.clip((self.radii - SMALLEST) / CLASS, 0, CLASSES - 1).astype(int)

    def best_of_sizes(self, most: int, of_each: int) -> Postures:
        """Return the best postures of each class of sizes, at most ``most``, of which ``of_each`` of a niche.

        Postures of a niche have one class of sizes and one arrangement.
        """
        order = np.argsort(-self.scores, kind="stable")
        order = order[_ranks(self.niches[order]) < of_each]
        return self.of(order[_ranks(self.sizes[order]) < most])

    @property
    def niches(self) -> IntArray:
        """Number of each posture's niche, (n,)."""
        return CLASSES * self.arrangements + self.sizes


def _ranks(classes: IntArray) -> IntArray:
    """Return the number of earlier entries of the same class, (n,)."""
    order = np.argsort(classes, kind="stable")
    firsts = np.flatnonzero(np.diff(classes[order], prepend=-1))
    result = np.empty(len(classes), int)
    result[order] = np.arange(len(classes)) - np.repeat(firsts, np.diff(firsts, append=len(classes)))
    return result


def posture_library(shapes: HandShapes) -> dict[str, Postures]:
    """Return postures around balls and across slabs, by these names."""

    def make() -> dict[str, FloatArray]:
        kinds = _evolved(shapes, np.random.default_rng(0))
        return {f"{name} {field}": getattr(pool, field) for name, pool in kinds.items() for field in FIELDS}

    tips, links = shapes.tips, shapes.links
    made_from = [
        *(shapes.samples.at, shapes.samples.groups, shapes.part_groups, shapes.parts.pairs),
        *(tips.at, tips.groups, tips.radii, tips.facing, tips.cosines, shapes.limits),
        *(links.frame, links.parent, links.axes, links.slides, links.coupling, links.offset),
    ]
    arrays: Mapping[str, Any] = cached_arrays("postures", made_from, make)
    return {name: Postures(*(arrays[f"{name} {field}"] for field in FIELDS)) for name in KINDS}


def largest_opening(library: dict[str, Postures]) -> float:
    """Return the largest size, metres, of what a hand's fingertips oppose each other about; 0 where they never do."""
    radii = [postures.radii[postures.scores > 0.0] for postures in library.values()]
    return 2.0 * float(np.max(np.concatenate(radii), initial=0.0))


def _evolved(
    shapes: HandShapes, rng: np.random.Generator, drawn: int = 4000, count: int = 750, generations: int = 18,
    kept: int = 120,
) -> dict[str, Postures]:  # fmt: skip
    """Return the best postures of each kind, ``kept`` of each size, after generations of ``count`` children.

    The best of each niche live on, six or what a size has place for, and all niches have as many children. A child
    moves one finger of a parent, or a quarter of its joints.
    """
    (lower, upper), links = shapes.limits, shapes.links
    fingers = np.array([links.moves[group] @ (links.coupling != 0.0) for group in shapes.tips.groups])  # joints of each
    first = shapes.closed(rng.uniform(lower, upper, (drawn, len(lower))))
    groupings = max(1, 2 ** int(shapes.fingers.max()) - 1)
    of_niche = {"ball": max(6, kept // groupings), "slab": max(6, kept // (3 * groupings))}  # a ball has one width
    vectors, numbers = np.zeros((0, 3)), np.zeros(0)
    none = Postures(first[:0], vectors, vectors, numbers, numbers, np.zeros(0, int))
    pools = dict.fromkeys(KINDS, none)
    for joints, kind in product(np.array_split(first, max(1, drawn // 500)), KINDS):  # few at a time, to save memory
        pools[kind] = _improved(shapes, pools[kind], joints, kind, of_niche[kind])
    for _ in range(generations):
        for kind, pool in pools.items():
            best = pool.best_of_sizes(len(pool.radii), of_niche[kind] // 2)
            rarity = 1.0 / np.bincount(best.niches)[best.niches]
            parents = best.joints[rng.choice(len(rarity), count, p=rarity / rarity.sum()) if len(rarity) else []]
            finger = fingers[rng.integers(len(fingers), size=len(parents))]
            moves = np.where(rng.random((len(parents), 1)) < 0.5, finger, rng.random(parents.shape) < 0.25)
            width = (upper - lower) * rng.choice([0.03, 0.08, 0.15], (len(parents), 1))
            children = parents + moves * width * rng.standard_normal(parents.shape)
            pools[kind] = _improved(shapes, pool, shapes.closed(np.clip(children, lower, upper)), kind, of_niche[kind])
    return {kind: pool.best_of_sizes(kept, of_niche[kind]) for kind, pool in pools.items()}


def _improved(
    shapes: HandShapes, pool: Postures, joints: FloatArray, kind: str, of_niche: int, width: float = 0.018
) -> Postures:
    """Return the best of each niche among a pool and further postures, of which those are tried whose links are apart.

    What is cheap comes first: the tips' unevenness and overhang, mu, and at last the links' distances.
    """
    frames = shapes.links.palm_frames(joints)
    tips = frames.points(shapes.tips.at, shapes.tips.groups)
    which, contacts = _contacts(tips, shapes.tips.radii, kind, shapes.fingers)
    usable = np.flatnonzero(contacts[3] > SMALLEST)
    which, (inward, middles, axes, radii, uneven) = which[usable], (part[usable] for part in contacts)
    beyond = overhang(shapes, frames.of(which), tips[which], inward)
    cost = 60.0 * beyond.max(axis=1, initial=0.0) + 10.0 * uneven
    opposed = (np.einsum("nkx,nx->nk", inward, inward[:, 0]) < 0.0) @ (1 << np.arange(tips.shape[1]))
    offsets = tips[which] - middles[:, None]
    across = offsets - np.einsum("nkx,nx->nk", offsets, axes)[..., None] * axes[:, None]
    widths = np.max(np.linalg.norm(across, axis=2), axis=1)
    arrangements = 3 * opposed + np.minimum(widths / width, 2.0).astype(int)
    order = np.argsort(cost, kind="stable")
    good = order[
        _ranks(arrangements[order]) < 1 + np.bincount(arrangements)[arrangements[order]] // 3
    ]  # others are not worth their mu
    touching = (tips[which] + shapes.tips.radii[:, None] * inward - middles[:, None])[good]
    score = sampled_mu(touching, inward[good]) - cost[good]
    new = Postures(joints[which[good]], middles[good], axes[good], radii[good], score, arrangements[good])
    least = np.full(1 + max(np.max(pool.niches, initial=0), np.max(new.niches, initial=0)), -np.inf)
    full = np.flatnonzero(np.bincount(pool.niches, minlength=len(least)) >= of_niche)
    least[full] = [pool.scores[pool.niches == niche].min() for niche in full]
    better = np.flatnonzero(score > least[new.niches])
    tried, place = np.unique(which[good[better]], return_inverse=True)
    apart = ~shapes.parts.overlap_mask(shapes.part_frames(frames.of(tried)), shapes.parts.pairs)[place]
    joined = Postures.joined([pool, new.of(better[apart])])
    return joined.best_of_sizes(len(joined.radii), of_niche)


def sampled_mu(points: FloatArray, normals: FloatArray, friction: float = 0.6, reach: float = 0.03) -> FloatArray:
    """Return about mu of contacts (b, k, 3) with inward normals, for forces of 1 N with torques over ``reach``, (b,).

    Along a wrench direction (a, b) a contact at p has ``g = a + b x p``. The support under the L2 budget is the norm of
    the projections of all g onto their friction cones; that of the task is 1 for the directions used.
    """
    y = directions(6, 2)
    a, b = y[:, :3].T, y[:, 3:].T / reach
    # |g|^2 = |a|^2 + 2 p . (a x b) + |b|^2 |p|^2 - (b . p)^2, in terms of 1, p and the products of p's components
    squares = [a[0] ** 2 + a[1] ** 2 + a[2] ** 2, *2.0 * np.cross(a.T, b.T).T]
    squares += [b[j] ** 2 + b[k] ** 2 for j, k in ((1, 2), (2, 0), (0, 1))]
    squares += [-2.0 * b[j] * b[k] for j, k in ((1, 2), (2, 0), (0, 1))]
    along, lengths = np.concatenate([a, b]).astype(np.float32), np.array(squares, dtype=np.float32)
    result = np.zeros(len(points))
    for start in range(0, len(points), 512):
        part = slice(start, start + 512)
        p, n = points[part].reshape(-1, 3), normals[part].reshape(-1, 3)
        features = np.column_stack([np.ones(len(p)), p, p**2, p[:, [1, 2, 0]] * p[:, [2, 0, 1]]])
        normal = np.concatenate([n, np.cross(p, n)], axis=1).astype(np.float32) @ along
        square = features.astype(np.float32) @ lengths
        tangent = np.sqrt(np.maximum(square - normal**2, 0.0))
        on_cone = np.maximum(normal + friction * tangent, 0.0) ** 2 / (1.0 + friction**2)
        projected = np.where(tangent <= friction * normal, square, on_cone)
        result[part] = np.sqrt(projected.reshape(-1, points.shape[1], y.shape[0]).sum(axis=1).min(axis=1))
    return result


def _contacts(
    tips: FloatArray, radii: FloatArray, kind: str, fingers: IntArray
) -> tuple[IntArray, tuple[FloatArray, ...]]:
    """Return the contacts of fingertips (b, k, 3): the posture of each, and arrays as follows.

    Inward normals (n, k, 3), which point from the fingertip into the body, middles, axes, half sizes and unevenness.
    """
    count, k = tips.shape[:2]
    if kind == "ball":
        middles = tips.mean(axis=1)
        distances = np.linalg.norm(tips - middles[:, None], axis=2)
        inward = (middles[:, None] - tips) / np.maximum(distances, TINY)[..., None]
        half, uneven = (distances - radii).mean(axis=1), np.ptp(distances, axis=1) / 4.0
        return np.arange(count), (inward, middles, np.zeros_like(middles), half, uneven)
    groups = int(fingers.max()) + 1  # those of a finger are on one side, the first one's on the first
    sides = np.array(list(product([1.0, -1.0], repeat=groups)))[1 : 2 ** (groups - 1), fingers].reshape(-1, k)
    which, sides = np.repeat(np.arange(count), len(sides)), np.tile(sides, (count, 1))
    x = tips[which]
    shares = [is_in / is_in.sum(axis=1, keepdims=True) for is_in in (sides > 0.0, sides < 0.0)]
    first, second = (np.einsum("nk,nkx->nx", share, x) for share in shares)
    length = np.linalg.norm(first - second, axis=1)
    axes, middles = (first - second) / np.maximum(length, TINY)[:, None], (first + second) / 2.0
    heights = np.einsum("nkx,nx->nk", x - middles[:, None], axes) * sides
    uneven = np.max(np.abs(heights - length[:, None] / 2.0), axis=1)
    return which, (-sides[..., None] * axes[:, None], middles, axes, length / 2.0 - radii.mean(), uneven)


def overhang(shapes: HandShapes, frames: Frames, tips: FloatArray, inward: FloatArray) -> FloatArray:
    """Return how far the samples of each fingertip's links are beyond the plane that it touches, (b, k), metres."""
    result = np.zeros(tips.shape[:2])
    for i, group in enumerate(shapes.tips.groups):
        at = shapes.samples.at[shapes.samples.groups == group]
        if len(at):
            local = (frames.R[:, group].transpose(0, 2, 1) @ inward[:, i, :, None])[..., 0]
            ahead = np.max(local @ (at[:: max(1, len(at) // 100)] - shapes.tips.at[i]).T, axis=1)
            result[:, i] = np.maximum(ahead - shapes.tips.radii[i], 0.0)
            turned = local @ shapes.tips.facing[i]
            result[:, i] += 0.02 * np.maximum(shapes.tips.cosines[i] - turned, 0.0)
    return result
