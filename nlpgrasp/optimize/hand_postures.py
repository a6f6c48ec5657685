"""Postures of a hand whose fingertips oppose each other, by size of what is between them: once a hand, cached.

Two kinds: around a ball all fingertips face their middle; across a slab two groups of them face each other. Postures
evolve: random ones are scored, the best of each size stay, and others are drawn near them. The score is mu of the
contacts that a posture suggests, less what its links extend beyond the planes in which the fingertips would touch.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from nlpgrasp.budgets import L2Budget
from nlpgrasp.common.cache import cached_arrays
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.contacts import FrictionContact
from nlpgrasp.hands.moving_links import Frames, HandState
from nlpgrasp.optimize.hand_shapes import HandShapes
from nlpgrasp.quality.grasp import GraspStack
from nlpgrasp.quality.screening import sampled_ratios, spread_directions
from nlpgrasp.tasks import TaskEllipsoid

FIELDS = "joints", "middles", "axes", "radii", "scores"  # of postures
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
    """

    joints: FloatArray
    middles: FloatArray
    axes: FloatArray
    radii: FloatArray
    scores: FloatArray

    def of(self, chosen: IntArray) -> Postures:
        """Return some of the postures."""
        return Postures(*(getattr(self, name)[chosen] for name in FIELDS))

    @classmethod
    def joined(cls, parts: list[Postures]) -> Postures:
        """Return several sets as one."""
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in FIELDS))

    def best_of_sizes(self, most: int) -> Postures:
        """Return the best postures of each class of sizes, ``most`` in all."""
        sizes = np.clip((self.radii - SMALLEST) / CLASS, 0, CLASSES - 1).astype(int)
        order = np.argsort(-self.scores, kind="stable")
        return self.of(np.concatenate([order[sizes[order] == size][: most // CLASSES] for size in range(CLASSES)]))


def posture_library(shapes: HandShapes) -> dict[str, Postures]:
    """Return postures around balls and across slabs, by these names."""

    def make() -> dict[str, FloatArray]:
        rng, result = np.random.default_rng(0), dict[str, FloatArray]()
        for name in ("ball", "slab"):
            pool = _evolved(shapes, name, rng)
            result |= {f"{name} {field}": getattr(pool, field) for field in FIELDS}
        return result

    tips, links = shapes.tips, shapes.links
    made_from = [
        *(shapes.samples.at, shapes.samples.groups, shapes.spheres, shapes.sphere_groups, shapes.pairs, shapes.apart),
        *(tips.at, tips.groups, tips.radii, tips.facing, tips.cosines, shapes.limits),
        *(links.frame, links.parent, links.axes, links.slides, links.coupling, links.offset),
    ]
    arrays = cached_arrays("postures", made_from, make)
    return {name: Postures(*(arrays[f"{name} {field}"] for field in FIELDS)) for name in ("ball", "slab")}


def _evolved(
    shapes: HandShapes, kind: str, rng: np.random.Generator, count: int = 3000, generations: int = 5, most: int = 1200
) -> Postures:
    """Return the best postures of a kind after some generations of ``count`` each."""
    lower, upper = shapes.limits
    first = shapes.closed(rng.uniform(lower, upper, (3 * count, len(lower))))
    pool = _scored(shapes, kind, first).best_of_sizes(most)
    for _ in range(generations):
        parents = pool.joints[rng.integers(len(pool.radii), size=count)]
        width = (upper - lower) * rng.choice([0.03, 0.08, 0.15], (count, 1))
        children = shapes.closed(np.clip(parents + width * rng.standard_normal(parents.shape), lower, upper))
        pool = Postures.joined([pool, _scored(shapes, kind, children)]).best_of_sizes(most)
    return pool


def _scored(shapes: HandShapes, kind: str, joints: FloatArray) -> Postures:
    """Return those of the postures whose links are apart, with their scores."""
    frames = palm_frames(shapes, joints)
    apart = shapes.overlaps(frames) <= 0.0
    joints, frames = joints[apart], Frames(frames.links, frames.R[apart], frames.t[apart])
    tips, parts = frames.points(shapes.tips.at, shapes.tips.groups), list[Postures]()
    for inward, middles, axes, radii, uneven in _contacts(tips, shapes.tips.radii, kind):
        cost = 60.0 * overhang(shapes, frames, tips, inward).max(axis=1, initial=0.0) + 10.0 * uneven
        usable = np.flatnonzero(radii > SMALLEST)
        usable = usable[np.argsort(cost[usable], kind="stable")[: 1 + len(cost) // 3]]  # others are not worth their mu
        if len(usable):
            contacts = (tips + shapes.tips.radii[:, None] * inward)[usable] - middles[usable, None]
            score = _sampled_mu(contacts, inward[usable]) - cost[usable]
            parts.append(Postures(joints[usable], middles[usable], axes[usable], radii[usable], score))
    none = np.zeros((0, 3))
    return Postures.joined([Postures(joints[:0], none, none, none[:, 0], none[:, 0]), *parts])


def _sampled_mu(points: FloatArray, normals: FloatArray) -> FloatArray:
    """Return about mu of contacts (b, k, 3) with inward normals, for forces of 1 N with torques over 30 mm, (b,)."""
    stack = GraspStack(points, normals, FrictionContact(0.6), np.zeros(3))
    task = TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
    return np.asarray(np.min(sampled_ratios(stack, task, spread_directions(stack, task), L2Budget()), axis=1))


def palm_frames(shapes: HandShapes, joints: FloatArray) -> Frames:
    """Return the frames of postures (b, m) with the palm at the origin."""
    palms = np.broadcast_to(np.eye(3), (len(joints), 3, 3))
    return shapes.links.frames(HandState(palms, np.zeros((len(joints), 3)), joints))


def _contacts(tips: FloatArray, radii: FloatArray, kind: str) -> Iterator[tuple[FloatArray, ...]]:
    """Yield inward normals (b, k, 3), middles, axes, half sizes and unevenness of the contacts of fingertips (b, k, 3).

    Normals point from the fingertip into the body.
    """
    if kind == "ball":
        middles = tips.mean(axis=1)
        distances = np.linalg.norm(tips - middles[:, None], axis=2)
        inward = (middles[:, None] - tips) / distances[..., None]
        yield inward, middles, np.zeros_like(middles), (distances - radii).mean(axis=1), np.ptp(distances, axis=1) / 4.0
        return
    for others in product([1.0, -1.0], repeat=tips.shape[1] - 1):
        side = np.array([1.0, *others])
        if np.all(side > 0.0):
            continue
        first, second = tips[:, side > 0.0].mean(axis=1), tips[:, side < 0.0].mean(axis=1)
        length = np.linalg.norm(first - second, axis=1)
        axes, middles = (first - second) / length[:, None], (first + second) / 2.0
        heights = np.einsum("bkx,bx->bk", tips - middles[:, None], axes) * side
        uneven = np.max(np.abs(heights - length[:, None] / 2.0), axis=1)
        yield -side[:, None] * axes[:, None], middles, axes, length / 2.0 - radii.mean(), uneven


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
