"""Fingers of a hand that holds a mesh walk over it, one at a time, to where the grasp exerts the task better.

The hand was placed around a smooth surface, and the mesh's normals are others: what is best there need not be good
here. The palm and the other fingers stay where they are; the joints that move one finger alone bring its round
tip to a place beside a point of the mesh, where it touches the mesh and overlaps it nowhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.base import Values
from nlpgrasp.solve.surface.beside import near_edges
from nlpgrasp.solve.surface.scored import Scored
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import FEASIBLE, Workbench

FIRST_REACH, LAST_REACH = 0.12, 0.01  # of the body's size: how far a finger may go in one move
TRIALS, TRIED = 48, 6  # points that a finger might go to, and the best of them that its joints are moved to
SWEEPS = 12
GAIN = 1e-3  # relative: a sweep that gains less halves the reach
STEPS, LONGEST = 8, 0.3  # of Newton's method on the joints, and radians a step
TOUCHED = 1e-5  # metres between tip and mesh that count as none
ALLOWED = 10.0 * FEASIBLE
OFF_EDGES = 1e3  # what a contact's being nearer to an edge than the margin costs, over the body's size
DAMPING = 1e-8  # square metres
STILL = 1e-9  # metres per unit of a variable below which it does not move a fingertip


@dataclass(frozen=True)
class Held:
    """Contacts on a mesh and the hand that touches it there.

    Parameters
    ----------
    placed : Placed
    normals : (k, 3) array
        Inward.
    """

    placed: Placed
    normals: FloatArray


def walk(bench: Workbench, start: Held, rng: np.random.Generator, stop: Stop) -> Held:
    """Return a hand whose fingers went to better points of the mesh, where there are any within reach.

    Constraints and clearances are kept on the mesh itself, or broken by no more than at the start.

    Parameters
    ----------
    bench : Workbench
        Of a problem with a mesh and a hand that has a pose.
    start : Held
    rng : numpy.random.Generator
    stop : Stop
    """
    walking, reach = _Walking(bench, start, rng), FIRST_REACH
    best = start
    for _ in range(SWEEPS):
        if stop.requested() or reach < LAST_REACH:
            break
        walking.sweep(reach * bench.scaling.length)
        walking.look()
        if walking.score(walking.held) > _enough(walking.score(best)):
            best = walking.held
        else:
            walking.held = best
            reach *= 0.5
    return best


class _Walking:
    """A hand on its way over a mesh."""

    def __init__(self, bench: Workbench, start: Held, rng: np.random.Generator) -> None:
        self.bench, self.held, self.rng = bench, start, rng
        self._scored = Scored(bench, rng)
        self.look()
        hand = bench.hand_points.posed_hand
        variables = hand.variables(bench.problem.body.bounds)
        self._limits = np.concatenate([v.lower for v in variables]), np.concatenate([v.upper for v in variables])
        self._radii = np.asarray(hand.tip_radii)
        self._own = _moved_alone(bench, start.placed)
        self._allowed = max(ALLOWED, self._broken(start))

    def look(self) -> None:
        """Learn where the grasp is weak."""
        self._scored.look(self.held.placed.points, self.held.normals)

    def score(self, held: Held) -> float:
        """Return how well a hand exerts the task in all directions known by now."""
        near = float(np.sum(near_edges(self.bench.problem, held.placed)))
        return float(self._scored.of(held.placed.points[None], held.normals[None])[0]) - OFF_EDGES * near

    def sweep(self, reach: float) -> None:
        """Let each finger with a round tip that can move alone go up to so far, metres."""
        for i, own in enumerate(self._own):
            if own.any() and self._radii[i] > 0.0:
                self._move(i, reach)

    def _move(self, i: int, reach: float) -> None:
        """Move finger i to the first of the most promising points nearby that it gets to, if that is better."""
        cloud, held = self.bench.surface.mesh_cloud, self.held
        near = np.array(cloud.tree.query_ball_point(held.placed.points[i], reach), dtype=int)
        if not near.size:
            return
        if near.size > TRIALS:
            near = self.rng.choice(near, TRIALS, replace=False)
        points, normals = (np.repeat(v[None], near.size, axis=0) for v in (held.placed.points, held.normals))
        points[:, i], normals[:, i] = cloud.points[near], cloud.normals[near]
        others = np.delete(near_edges(self.bench.problem, held.placed), i)
        scores = self._scored.of(points, normals) - OFF_EDGES * float(np.sum(others))
        least = _enough(self.score(held))
        for j in np.argsort(-scores, kind="stable")[:TRIED]:
            if scores[j] <= least:
                return
            found = self._there(i, points[j, i] - self._radii[i] * normals[j, i])
            if found is not None and self.score(found) > least:
                self.held = found
                return

    def _there(self, i: int, goal: FloatArray) -> Held | None:
        """Return the hand with the centre of tip i at a place, touching the mesh there; None where it cannot."""
        bench, held = self.bench, self.held
        hand = self._reaching(i, goal)
        centre = self._tip(hand, i)[0]
        if np.linalg.norm(centre - goal) > TOUCHED:
            return None
        contact, _, distance = (v[0] for v in bench.surface.mesh.closest(centre[None]))
        if abs(distance - self._radii[i]) > TOUCHED:
            return None
        points, normals = held.placed.points.copy(), held.normals.copy()
        points[i], normals[i] = contact, (contact - centre) / distance
        found = Held(replace(held.placed, points=points, hand=hand), normals)
        return found if self._broken(found) <= self._allowed else None

    def _reaching(self, i: int, goal: FloatArray) -> Values:
        """Return the hand's values with tip i as near to a place as its own joints get it."""
        hand, own = self.held.placed.hand, self._own[i]
        for _ in range(STEPS):
            centre, slopes = self._tip(hand, i)
            if np.linalg.norm(goal - centre) < 0.1 * TOUCHED:
                break
            J = slopes[:, own]
            step = J.T @ np.linalg.solve(J @ J.T + DAMPING * np.eye(3), goal - centre)
            z = _joined(hand)
            z[own] += step * min(1.0, LONGEST / max(float(np.max(np.abs(step))), 1e-12))
            hand = _parted(np.clip(z, *self._limits), hand)
        return hand

    def _tip(self, hand: Values, i: int) -> tuple[FloatArray, FloatArray]:
        """Return the centre of tip i, (3,), and its derivatives by the hand's variables, (3, m)."""
        places, slopes = self.bench.hand_points.tip_motion(*hand.values())
        return places.full()[:, i], slopes.full()[3 * i : 3 * i + 3]

    def _broken(self, held: Held) -> float:
        """Return the largest violation of constraints and hand, with distances from the mesh itself."""
        values = self.bench.row_values(held.placed, held.normals)
        return float(self.bench.rows.excess(values[None])[0])


def _enough(score: float) -> float:
    """Return the score from which on a grasp is better than one of some score."""
    return score + GAIN * abs(score)


def _moved_alone(bench: Workbench, placed: Placed) -> NDArray[np.bool_]:
    """Return which of the hand's variables move each finger and no other, (k, m)."""
    slopes = np.abs(bench.hand_points.tip_motion(*placed.hand.values())[1].full())
    moves = slopes.reshape(len(placed.points), 3, -1).max(axis=1) > STILL
    return np.asarray(moves & (np.sum(moves, axis=0) == 1))


def _joined(hand: Values) -> FloatArray:
    return np.concatenate(list(hand.values()))


def _parted(z: FloatArray, like: Values) -> Values:
    ends = np.cumsum([len(v) for v in like.values()])[:-1]
    return dict(zip(like, np.split(z, ends), strict=True))
