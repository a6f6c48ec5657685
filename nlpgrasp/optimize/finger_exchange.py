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
    compiled: CompiledProblem,
    candidate: GraspCandidate,
    normals: FloatArray,
    rng: np.random.Generator,
    deadline: Deadline,
) -> GraspCandidate | None:
    """Return a hand on a mesh with its fingers moved to better mesh points within reach; None where none are better.

    Constraints and clearances are kept on the mesh itself, or broken by no more than at the start.

    Parameters
    ----------
    compiled : CompiledProblem
        Of a problem with a mesh and a hand that has a pose.
    candidate : GraspCandidate
        Contacts on the mesh, and the hand that touches it there.
    normals : (k, 3) array
        Inward.
    rng : numpy.random.Generator
    deadline : Deadline
    """
    best = start = MeshTouch(candidate, normals)
    walking, reach = _FingerSearch(compiled, start, rng), FIRST_REACH
    for _ in range(SWEEPS):
        if deadline.is_requested() or reach < LAST_REACH:
            break
        walking.sweep(reach * compiled.scaling.length)
        walking.add_weak_directions()
        if walking.score(walking.held) > _least_improvement(walking.score(best)):
            best = walking.held
        else:
            walking.held = best
            reach *= 0.5
    return None if best is start else best.candidate


@dataclass(frozen=True)
class MeshTouch:
    """Contacts on a mesh and the hand touching it there.

    Parameters
    ----------
    candidate : GraspCandidate
    normals : (k, 3) array
        Inward.
    """

    candidate: GraspCandidate
    normals: FloatArray


class LearnedScore:
    """Sampled quality with a growing set of weak directions.

    Parameters
    ----------
    compiled : CompiledProblem
    rng : numpy.random.Generator
    """

    def __init__(self, compiled: CompiledProblem, rng: np.random.Generator) -> None:
        self._bench, self._rng = compiled, rng
        self._screening = screening_directions(compiled)
        self._cuts = self._screening[:0]

    def add_weak_directions(self, points: FloatArray, normals: FloatArray) -> None:
        """Add the weakest directions of a grasp with these contacts, (k, space) each."""
        compiled, known = self._bench, self._cuts[-KNOWN:]
        grasp, task = compiled.grasp_at(points, normals), compiled.problem.task
        found = weakest_directions(grasp, task, compiled.closure_budget, self._rng, known, QUICK).directions
        self._cuts = np.concatenate([self._cuts, found])[-MOST_CUTS:]

    def score(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return the sampled quality of placements (b, k, space), (b,).

        The least ratio over all directions, with the tie-break for placements that are not closed.
        """
        problem, y = self._bench.problem, np.concatenate([self._screening, self._cuts])
        stack = GraspStack(points, normals, problem.models, problem.origin)
        return screening_score(sampled_ratios(stack, problem.task, y, self._bench.screening_budget))


class _FingerSearch:
    """State of a hand's local search on a mesh, one finger at a time."""

    def __init__(self, compiled: CompiledProblem, start: MeshTouch, rng: np.random.Generator) -> None:
        self.compiled, self.held, self.rng = compiled, start, rng
        self._scored = LearnedScore(compiled, rng)
        self.add_weak_directions()
        hand = compiled.hand_points.posed_hand
        variables = hand.variables(compiled.problem.body.bounds)
        self._limits = np.concatenate([v.lower for v in variables]), np.concatenate([v.upper for v in variables])
        self._radii = np.asarray(hand.tip_radii)
        self._own = _single_finger_variables(compiled, start.candidate)
        self._allowed = max(ALLOWED, self._broken(start))

    def add_weak_directions(self) -> None:
        """Add the directions in which the grasp is weak."""
        self._scored.add_weak_directions(self.held.candidate.points, self.held.normals)

    def score(self, held: MeshTouch) -> float:
        """Return the sampled quality of a grasp over the known directions, less the penalty for sharp edges."""
        near = float(np.sum(edge_margin_violation(self.compiled.problem, held.candidate)))
        return float(self._scored.score(held.candidate.points[None], held.normals[None])[0]) - OFF_EDGES * near

    def sweep(self, reach: float) -> None:
        """Move each finger with a round tip and joints of its own by up to ``reach``, metres."""
        for i, own in enumerate(self._own):
            if own.any() and self._radii[i] > 0.0:
                self._move(i, reach)

    def _move(self, i: int, reach: float) -> None:
        """Move finger i to the most promising nearby mesh point that it reaches, if that improves the grasp."""
        cloud, held = self.compiled.surface.mesh_cloud, self.held
        near = np.array(cloud.tree.query_ball_point(held.candidate.points[i], reach), dtype=int)
        if not near.size:
            return
        if near.size > TRIALS:
            near = self.rng.choice(near, TRIALS, replace=False)
        points, normals = (np.repeat(v[None], near.size, axis=0) for v in (held.candidate.points, held.normals))
        points[:, i], normals[:, i] = cloud.points[near], cloud.normals[near]
        others = np.delete(edge_margin_violation(self.compiled.problem, held.candidate), i)
        scores = self._scored.score(points, normals) - OFF_EDGES * float(np.sum(others))
        least = _least_improvement(self.score(held))
        for j in np.argsort(-scores, kind="stable")[:TRIED]:
            if scores[j] <= least:
                return
            found = self._touching_at(i, points[j, i] - self._radii[i] * normals[j, i])
            if found is not None and self.score(found) > least:
                self.held = found
                return

    def _touching_at(self, i: int, goal: FloatArray) -> MeshTouch | None:
        """Return the hand with the centre of tip i at a point, touching the mesh there; None where it cannot."""
        compiled, held = self.compiled, self.held
        hand = self._nearest_posture(i, goal)
        centre = self._tip(hand, i)[0]
        if np.linalg.norm(centre - goal) > TOUCHED:
            return None
        contact, _, distance = (v[0] for v in compiled.surface.mesh.closest(centre[None]))
        if abs(distance - self._radii[i]) > TOUCHED:
            return None
        points, normals = held.candidate.points.copy(), held.normals.copy()
        points[i], normals[i] = contact, (contact - centre) / distance
        found = MeshTouch(replace(held.candidate, points=points, hand=hand), normals)
        return found if self._broken(found) <= self._allowed else None

    def _nearest_posture(self, i: int, goal: FloatArray) -> Values:
        """Return the hand's values with tip i as near to a point as its own joints permit (inverse kinematics)."""
        hand, own = self.held.candidate.hand, self._own[i]
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
        places, slopes = self.compiled.hand_points.tip_motion(*hand.values())
        return places.full()[:, i], slopes.full()[3 * i : 3 * i + 3]

    def _broken(self, held: MeshTouch) -> float:
        """Return the largest constraint violation, with distances from the mesh itself."""
        values = self.compiled.row_values(held.candidate, held.normals)
        return float(self.compiled.rows.excess(values[None])[0])


def _least_improvement(score: float) -> float:
    """Return the least score that counts as an improvement over a score."""
    return score + GAIN * abs(score)


def _single_finger_variables(compiled: CompiledProblem, candidate: GraspCandidate) -> NDArray[np.bool_]:
    """Return the mask of the hand's variables that move only one finger, for each finger, (k, m)."""
    slopes = np.abs(compiled.hand_points.tip_motion(*candidate.hand.values())[1].full())
    moves = slopes.reshape(len(candidate.points), 3, -1).max(axis=1) > STILL
    return np.asarray(moves & (np.sum(moves, axis=0) == 1))


def _hand_vector(hand: Values) -> FloatArray:
    return np.concatenate(list(hand.values()))


def _split_variables(z: FloatArray, like: Values) -> Values:
    ends = np.cumsum([len(v) for v in like.values()])[:-1]
    return dict(zip(like, np.split(z, ends), strict=True))
