"""Coordinate exchange of a hand's contacts on a mesh: one finger at a time, by inverse kinematics.

A hand that was refined around the smooth surface meets other normals on the mesh, where its contacts may be poor. The
palm and the other fingers stay where they are; the joints that move one finger alone bring its round tip to a place
beside a point of the mesh, where it touches the mesh and overlaps it nowhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.base import Values
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.coordinate_exchange import screening_directions
from nlpgrasp.optimize.grasp_on_body import edge_margin_violation
from nlpgrasp.quality.grasp import GraspStack
from nlpgrasp.quality.screening import sampled_ratios, screening_score
from nlpgrasp.quality.weakest_directions import QUICK, weakest_directions

KNOWN, MOST_CUTS = 100, 400  # directions at first; directions kept, at most
FIRST_REACH, LAST_REACH = 0.12, 0.01  # over the body's size: largest move of a finger, at first and at last
TRIALS, TRIED = 48, 6  # mesh points scored per move; the best of them tried by inverse kinematics
SWEEPS = 12  # sweeps over all fingers, at most
GAIN = 1e-3  # relative: a sweep that gains less halves the reach
STEPS, LONGEST = 8, 0.3  # inverse kinematics: Newton steps, at most; longest step, radians
TOUCHED = 1e-5  # metres between tip and mesh that count as contact
ALLOWED = 10.0 * FEASIBLE  # largest constraint violation, relative to scales
OFF_EDGES = 1e3  # penalty for violating the margin from sharp edges, over the body's size
DAMPING = 1e-8  # square metres, of the damped least squares in inverse kinematics
STILL = 1e-9  # metres per unit: variables that move a fingertip less count as not moving it


def walked(
    bench: CompiledProblem, placed: GraspCandidate, normals: FloatArray, rng: np.random.Generator, stop: Deadline
) -> GraspCandidate | None:
    """Return a hand on a mesh with its fingers moved to better mesh points within reach; None where none are better.

    Constraints and clearances are kept on the mesh itself, or broken by no more than at the start.

    Parameters
    ----------
    bench : Workbench
        Of a problem with a mesh and a hand that has a pose.
    placed : Placed
        Contacts on the mesh, and the hand that touches it there.
    normals : (k, 3) array
        Inward.
    rng : numpy.random.Generator
    stop : Stop
    """
    best = start = MeshTouch(placed, normals)
    walking, reach = _FingerSearch(bench, start, rng), FIRST_REACH
    for _ in range(SWEEPS):
        if stop.requested() or reach < LAST_REACH:
            break
        walking.sweep(reach * bench.scaling.length)
        walking.look()
        if walking.score(walking.held) > _least_improvement(walking.score(best)):
            best = walking.held
        else:
            walking.held = best
            reach *= 0.5
    return None if best is start else best.placed


@dataclass(frozen=True)
class MeshTouch:
    """Contacts on a mesh and the hand touching it there.

    Parameters
    ----------
    placed : Placed
    normals : (k, 3) array
        Inward.
    """

    placed: GraspCandidate
    normals: FloatArray


class LearnedScore:
    """Sampled quality with a growing set of weak directions.

    Parameters
    ----------
    bench : Workbench
    rng : numpy.random.Generator
    """

    def __init__(self, bench: CompiledProblem, rng: np.random.Generator) -> None:
        self._bench, self._rng = bench, rng
        self._screening = screening_directions(bench)
        self._cuts = self._screening[:0]

    def look(self, points: FloatArray, normals: FloatArray) -> None:
        """Add the weakest directions of a grasp with these contacts, (k, space) each."""
        bench, known = self._bench, self._cuts[-KNOWN:]
        grasp, task = bench.grasp_at(points, normals), bench.problem.task
        found = weakest_directions(grasp, task, bench.closure_budget, self._rng, known, QUICK).directions
        self._cuts = np.concatenate([self._cuts, found])[-MOST_CUTS:]

    def of(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return the sampled quality of placements (b, k, space), (b,).

        The least ratio over all directions, with the tie-break for placements that are not closed.
        """
        problem, y = self._bench.problem, np.concatenate([self._screening, self._cuts])
        stack = GraspStack(points, normals, problem.models, problem.origin)
        return screening_score(sampled_ratios(stack, problem.task, y, self._bench.screening_budget))


class _FingerSearch:
    """State of a hand's local search on a mesh, one finger at a time."""

    def __init__(self, bench: CompiledProblem, start: MeshTouch, rng: np.random.Generator) -> None:
        self.bench, self.held, self.rng = bench, start, rng
        self._scored = LearnedScore(bench, rng)
        self.look()
        hand = bench.hand_points.posed_hand
        variables = hand.variables(bench.problem.body.bounds)
        self._limits = np.concatenate([v.lower for v in variables]), np.concatenate([v.upper for v in variables])
        self._radii = np.asarray(hand.tip_radii)
        self._own = _single_finger_variables(bench, start.placed)
        self._allowed = max(ALLOWED, self._broken(start))

    def look(self) -> None:
        """Add the directions in which the grasp is weak."""
        self._scored.look(self.held.placed.points, self.held.normals)

    def score(self, held: MeshTouch) -> float:
        """Return the sampled quality of a grasp over the known directions, less the penalty for sharp edges."""
        near = float(np.sum(edge_margin_violation(self.bench.problem, held.placed)))
        return float(self._scored.of(held.placed.points[None], held.normals[None])[0]) - OFF_EDGES * near

    def sweep(self, reach: float) -> None:
        """Move each finger with a round tip and joints of its own by up to ``reach``, metres."""
        for i, own in enumerate(self._own):
            if own.any() and self._radii[i] > 0.0:
                self._move(i, reach)

    def _move(self, i: int, reach: float) -> None:
        """Move finger i to the most promising nearby mesh point that it reaches, if that improves the grasp."""
        cloud, held = self.bench.surface.mesh_cloud, self.held
        near = np.array(cloud.tree.query_ball_point(held.placed.points[i], reach), dtype=int)
        if not near.size:
            return
        if near.size > TRIALS:
            near = self.rng.choice(near, TRIALS, replace=False)
        points, normals = (np.repeat(v[None], near.size, axis=0) for v in (held.placed.points, held.normals))
        points[:, i], normals[:, i] = cloud.points[near], cloud.normals[near]
        others = np.delete(edge_margin_violation(self.bench.problem, held.placed), i)
        scores = self._scored.of(points, normals) - OFF_EDGES * float(np.sum(others))
        least = _least_improvement(self.score(held))
        for j in np.argsort(-scores, kind="stable")[:TRIED]:
            if scores[j] <= least:
                return
            found = self._there(i, points[j, i] - self._radii[i] * normals[j, i])
            if found is not None and self.score(found) > least:
                self.held = found
                return

    def _there(self, i: int, goal: FloatArray) -> MeshTouch | None:
        """Return the hand with the centre of tip i at a point, touching the mesh there; None where it cannot."""
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
        found = MeshTouch(replace(held.placed, points=points, hand=hand), normals)
        return found if self._broken(found) <= self._allowed else None

    def _reaching(self, i: int, goal: FloatArray) -> Values:
        """Return the hand's values with tip i as near to a point as its own joints permit (inverse kinematics)."""
        hand, own = self.held.placed.hand, self._own[i]
        for _ in range(STEPS):
            centre, slopes = self._tip(hand, i)
            if np.linalg.norm(goal - centre) < 0.1 * TOUCHED:
                break
            J = slopes[:, own]
            step = J.T @ np.linalg.solve(J @ J.T + DAMPING * np.eye(3), goal - centre)
            z = _hand_vector(hand)
            z[own] += step * min(1.0, LONGEST / max(float(np.max(np.abs(step))), 1e-12))
            hand = _split_variables(np.clip(z, *self._limits), hand)
        return hand

    def _tip(self, hand: Values, i: int) -> tuple[FloatArray, FloatArray]:
        """Return the centre of tip i, (3,), and its Jacobian in the hand's variables, (3, m)."""
        places, slopes = self.bench.hand_points.tip_motion(*hand.values())
        return places.full()[:, i], slopes.full()[3 * i : 3 * i + 3]

    def _broken(self, held: MeshTouch) -> float:
        """Return the largest constraint violation, with distances from the mesh itself."""
        values = self.bench.row_values(held.placed, held.normals)
        return float(self.bench.rows.excess(values[None])[0])


def _least_improvement(score: float) -> float:
    """Return the least score that counts as an improvement over a score."""
    return score + GAIN * abs(score)


def _single_finger_variables(bench: CompiledProblem, placed: GraspCandidate) -> NDArray[np.bool_]:
    """Return the mask of the hand's variables that move only one finger, for each finger, (k, m)."""
    slopes = np.abs(bench.hand_points.tip_motion(*placed.hand.values())[1].full())
    moves = slopes.reshape(len(placed.points), 3, -1).max(axis=1) > STILL
    return np.asarray(moves & (np.sum(moves, axis=0) == 1))


def _hand_vector(hand: Values) -> FloatArray:
    return np.concatenate(list(hand.values()))


def _split_variables(z: FloatArray, like: Values) -> Values:
    ends = np.cumsum([len(v) for v in like.values()])[:-1]
    return dict(zip(like, np.split(z, ends), strict=True))
