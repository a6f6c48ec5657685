"""Where a start of a hand with a pose of its own begins: poses at random, and poses that reach for good placements."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.stack import GraspStack
from nlpgrasp.hands.base import Values
from nlpgrasp.quality.screening import screen
from nlpgrasp.solve.start.random_placements import random_placements
from nlpgrasp.solve.start.scores import scores
from nlpgrasp.solve.start.touch import best_touching, touching_candidates
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import Workbench

POSES = 512  # random poses that a start compares
DRAWN, SCREENED, GOALS = 4096, 512, 64  # random placements; those looked at closer; those that hands reach for
ORDERS, NEAR, EACH = 24, 8, 12  # ways to share a goal's places among fingers; postures for each; kept for a goal
LOOKED_AT = 256
FAR = 4.0  # weight of a fingertip's distance from the body, over the body's size, against the score
BROKEN = 1.0  # weight of what breaks constraints, such as a palm that faces elsewhere: a hand seldom turns around
# weights of what is in the links' way: by the one the best poses come first, by the other those that are free
BLOCKED = (0.05, 5.0)
TRIES = 12  # poses that are moved to where all fingertips touch
MANY, MANY_TRIES = 6, 32  # contacts from which hands hardly ever touch with all, and poses then


@dataclass(frozen=True)
class _Poses:
    """Poses of a hand, with the sample points of the body nearest to its fingertips.

    Parameters
    ----------
    values : dict of str to (b, m) array
    points, normals : (b, k, 3) array
    faces : (b, k) array of str
    far : (b,) array
        The fingertips' mean distance from the body, metres.
    """

    values: Values
    points: FloatArray
    normals: FloatArray
    faces: NDArray[np.object_]
    far: FloatArray

    def placed(self, i: int) -> Placed:
        """Return pose i."""
        return Placed(tuple(self.faces[i]), self.points[i], {name: v[i] for name, v in self.values.items()})


def posed_candidates(bench: Workbench, rng: np.random.Generator, stop: Stop) -> Iterator[Placed]:
    """Return an iterator over what a start begins from: hands moved to where all their fingertips touch.

    The best come first; with many fingertips those that touch at all.
    """
    drawn = draw_posed_start(bench, rng)
    if len(bench.problem.models) >= MANY:
        return touching_candidates(bench, drawn, stop)
    return best_touching(bench, drawn, rng, stop)


def draw_posed_start(bench: Workbench, rng: np.random.Generator) -> Sequence[Placed]:
    """Return the best few of many poses of a hand around the body: random ones, and some that reach for goals.

    Each fingertip's contact is the nearest sample point of the faces it may use. Poses are ranked by how well the
    contacts exert the task, less how far the fingertips are from them, what constraints they break and how much their
    links are in the body's and each other's way: half of them by a small weight of the last, half by a large one.
    """
    count = bench.problem.hand.count if bench.problem.hand is not None else 0
    every = [_at_random(bench, rng)] + ([_reaching(bench, rng)] if count < MANY else [])
    values = {name: np.concatenate([v[name] for v, _ in every]) for name in every[0][0]}
    poses = _beside(bench, values, np.concatenate([tips for _, tips in every]))
    broken = bench.rows.broken(poses.points, poses.normals, poses.values)
    far = FAR * poses.far / bench.scaling.length + BROKEN * broken
    blocked = bench.rows.blocked(poses.points, poses.normals, poses.values)
    score = scores(bench, poses.points, poses.normals)
    orders = np.stack([_order(bench, poses, far + weight * blocked, score) for weight in BLOCKED], axis=1)
    chosen = list(dict.fromkeys(orders.ravel().tolist()))[: TRIES if count < MANY else MANY_TRIES]
    return [poses.placed(i) for i in chosen]


def _order(bench: Workbench, poses: _Poses, against: FloatArray, score: FloatArray) -> NDArray[np.intp]:
    """Return the best poses by number, best first: by upper bounds on mu less what speaks against a pose, (b,)."""
    some = np.argsort(against - score, kind="stable")[:LOOKED_AT]
    bounds = _bounds(bench, poses.points[some], poses.normals[some]) * bench.scaling.beta
    return np.asarray(some[np.argsort(against[some] - bounds, kind="stable")])


def _at_random(bench: Workbench, rng: np.random.Generator) -> tuple[Values, FloatArray]:
    """Return random poses with the fingertips' middle somewhere in the body, and the fingertips' centres."""
    body = bench.problem.body
    everything = np.concatenate(list(bench.surface.faces.values()))
    target = everything[rng.integers(len(everything), size=POSES)]
    around = body.centroid + rng.uniform(0.0, 0.8, (POSES, 1)) * (target - body.centroid)
    return bench.hand_points.posed_hand.draw(POSES, around, rng)


def _reaching(bench: Workbench, rng: np.random.Generator) -> tuple[Values, FloatArray]:
    """Return poses that reach for the best of some random placements, and the fingertips' centres."""
    hand = bench.hand_points.posed_hand
    points, normals = _goals(bench, rng)
    orders = np.array(list(permutations(range(hand.count))) if _alike(bench) else [range(hand.count)])
    if len(orders) > ORDERS:
        orders = orders[rng.choice(len(orders), ORDERS, replace=False)]
    radii = np.asarray(hand.tip_radii)[:, None]
    places = points[:, orders] - radii * normals[:, orders]  # (goals, orders, k, 3)
    values, tips = hand.reach(places.reshape(-1, *points.shape[1:]), NEAR, rng)
    missed = np.linalg.norm(tips - np.repeat(places.reshape(-1, *points.shape[1:]), NEAR, axis=0), axis=2).mean(axis=1)
    each = missed.reshape(len(points), -1)
    kept = np.argsort(each, axis=1, kind="stable")[:, :EACH] + each.shape[1] * np.arange(len(points))[:, None]
    return {name: v[kept.ravel()] for name, v in values.items()}, tips[kept.ravel()]


def _goals(bench: Workbench, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return points and inward normals of the best of some random placements, (m, k, 3) each."""
    drawn = random_placements(bench, DRAWN, rng)
    some = np.argsort(-scores(bench, drawn.points, drawn.normals), kind="stable")[:SCREENED]
    points, normals = drawn.points[some], drawn.normals[some]
    best = np.argsort(-_bounds(bench, points, normals), kind="stable")[:GOALS]
    return points[best], normals[best]


def _bounds(bench: Workbench, points: FloatArray, normals: FloatArray) -> FloatArray:
    """Return upper bounds on the mu of placements (b, k, 3), (b,)."""
    stack = GraspStack(points, normals, bench.problem.models, bench.problem.origin)
    return screen(stack, bench.problem.task, force_budget=bench.screening_budget)


def _alike(bench: Workbench) -> bool:
    """Return whether any finger may take any contact: all have one model and the same faces."""
    models = bench.problem.models
    usable = [bench.surface.usable(i) for i in range(len(models))]
    return all(m == models[0] for m in models) and all(u == usable[0] for u in usable)


def _beside(bench: Workbench, values: Values, tips: FloatArray) -> _Poses:
    """Return poses with the sample points nearest to their fingertips, (b, k, 3)."""
    points, normals = np.empty_like(tips), np.empty_like(tips)
    faces = np.empty(tips.shape[:2], dtype=object)
    far = np.zeros(len(tips))
    radii = bench.hand_points.hand.tip_radii
    for i, radius in enumerate(radii):
        cloud = bench.surface.cloud(i)
        distance, nearest = cloud.tree.query(tips[:, i])
        points[:, i], normals[:, i], faces[:, i] = cloud.points[nearest], cloud.normals[nearest], cloud.faces[nearest]
        far += np.abs(distance - radius) / len(radii)
    return _Poses(values, points, normals, faces, far)
