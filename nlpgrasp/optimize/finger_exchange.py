"""Coordinate exchange of a hand's contacts on a mesh: one finger at a time, by inverse kinematics.

A hand that was refined on the smoothed surface has other contact normals on the mesh, where its grasp may be poor. The
palm and the other fingers are fixed; the joints of one finger alone bring its round tip into contact with another point
of the mesh, without penetration.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.validation import BoolArray, FloatArray
from nlpgrasp.hands.base import Values
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.coordinate_exchange import screening_directions
from nlpgrasp.optimize.grasp_on_body import edge_margin_violation
from nlpgrasp.quality.grasp import GraspStack
from nlpgrasp.quality.screening import sampled_ratios, screening_score
from nlpgrasp.quality.weakest_directions import QUICK, weakest_directions

LATEST, MOST_CUTS = 100, 400  # latest directions, from which descents begin; directions kept, at most
FIRST_REACH, LAST_REACH = 0.12, 0.01  # over the body's size: largest move of a finger, initial and final
TRIALS, TRIED = 48, 6  # mesh points scored per move; the best of them tried by inverse kinematics
SWEEPS = 12  # sweeps over all fingers, at most
GAIN = 1e-3  # relative: a sweep that gains less halves the reach
STEPS, LONGEST = 8, 0.3  # inverse kinematics: Newton steps, at most; longest step, radians
TOUCHING = 1e-5  # metres between tip and mesh that count as contact
ALLOWED = 10.0 * FEASIBLE  # largest constraint violation, relative to scales
EDGE_PENALTY = 1e3  # weight of violations of the margin from sharp edges, over the body's size
DAMPING = 1e-8  # square metres, of the damped least squares in inverse kinematics
FIXED = 1e-9  # metres per unit of a variable: slower motions of a fingertip count as none


def exchange_fingers(
    compiled: CompiledProblem,
    candidate: GraspCandidate,
    normals: FloatArray,
    rng: np.random.Generator,
    deadline: Deadline,
) -> GraspCandidate | None:
    """Return a hand with its fingers moved one by one to better points of a mesh; None without improvement.

    Constraints and clearances hold on the mesh itself, or are violated by no more than initially.

    Parameters
    ----------
    compiled : CompiledProblem
        Problem with a mesh and a hand that has a pose.
    candidate : GraspCandidate
        Contacts on the mesh, and the hand in contact there.
    normals : (k, 3) array
        Inward unit normals.
    rng : numpy.random.Generator
    deadline : Deadline
    """
    best = initial = MeshContacts(candidate, normals)
    search, reach = _FingerSearch(compiled, initial, rng), FIRST_REACH
    for _ in range(SWEEPS):
        if deadline.should_stop() or reach < LAST_REACH:
            break
        search.sweep(reach * compiled.scaling.length)
        search.add_weak_directions()
        if search.score(search.current) > _least_improvement(search.score(best)):
            best = search.current
        else:
            search.current = best
            reach *= 0.5
    return None if best is initial else best.candidate


@dataclass(frozen=True)
class MeshContacts:
    """Contacts on a mesh with their normals, and the hand that touches the mesh there.

    Parameters
    ----------
    candidate : GraspCandidate
    normals : (k, 3) array
        Inward unit normals.
    """

    candidate: GraspCandidate
    normals: FloatArray


class AdaptiveScore:
    """Quality score of placements over a growing set of weak directions.

    Parameters
    ----------
    compiled : CompiledProblem
    rng : numpy.random.Generator
    """

    def __init__(self, compiled: CompiledProblem, rng: np.random.Generator) -> None:
        self._compiled, self._rng = compiled, rng
        self._screening = screening_directions(compiled)
        self._cuts = self._screening[:0]

    def add_weak_directions(self, points: FloatArray, normals: FloatArray) -> None:
        """Add the weakest directions of the grasp with given points and normals, (k, space) each."""
        compiled, latest = self._compiled, self._cuts[-LATEST:]
        grasp, task = compiled.grasp_at(points, normals), compiled.problem.task
        weakest = weakest_directions(grasp, task, compiled.closure_budget, self._rng, latest, QUICK).directions
        self._cuts = np.concatenate([self._cuts, weakest])[-MOST_CUTS:]

    def score(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return the quality score of placements (b, k, space) over all known directions, (b,)."""
        problem, y = self._compiled.problem, np.concatenate([self._screening, self._cuts])
        stack = GraspStack(points, normals, problem.models, problem.origin)
        return screening_score(sampled_ratios(stack, problem.task, y, self._compiled.screening_budget))


class _FingerSearch:
    """Local search of a hand's contacts on a mesh, one finger at a time."""

    def __init__(self, compiled: CompiledProblem, initial: MeshContacts, rng: np.random.Generator) -> None:
        self.compiled, self.current, self.rng = compiled, initial, rng
        self._scorer = AdaptiveScore(compiled, rng)
        self.add_weak_directions()
        hand = compiled.hand_functions.posed_hand
        variables = hand.variables(compiled.problem.body.bounds)
        self._limits = np.concatenate([v.lower for v in variables]), np.concatenate([v.upper for v in variables])
        self._radii = np.asarray(hand.tip_radii)
        self._finger_variables = _single_finger_variables(compiled, initial.candidate)
        self._allowed = max(ALLOWED, self._violation(initial))

    def add_weak_directions(self) -> None:
        """Add the weak directions of the current grasp."""
        self._scorer.add_weak_directions(self.current.candidate.points, self.current.normals)

    def score(self, grasp: MeshContacts) -> float:
        """Return the quality score of a grasp, less a penalty for contacts near sharp edges."""
        violation = float(np.sum(edge_margin_violation(self.compiled.problem, grasp.candidate)))
        quality = float(self._scorer.score(grasp.candidate.points[None], grasp.normals[None])[0])
        return quality - EDGE_PENALTY * violation

    def sweep(self, reach: float) -> None:
        """Try to move the contact of each finger in turn by at most ``reach``, metres.

        Only fingers with a round tip and with joints that move no other finger are moved.
        """
        for i, variables in enumerate(self._finger_variables):
            if variables.any() and self._radii[i] > 0.0:
                self._move(i, reach)

    def _move(self, i: int, reach: float) -> None:
        """Move finger i to the most promising nearby mesh point that it reaches, if that improves the grasp."""
        cloud, current = self.compiled.surface.mesh_cloud, self.current
        neighbours = np.array(cloud.tree.query_ball_point(current.candidate.points[i], reach), dtype=int)
        if not neighbours.size:
            return
        if neighbours.size > TRIALS:
            neighbours = self.rng.choice(neighbours, TRIALS, replace=False)
        points, normals = (
            np.repeat(v[None], neighbours.size, axis=0) for v in (current.candidate.points, current.normals)
        )
        points[:, i], normals[:, i] = cloud.points[neighbours], cloud.normals[neighbours]
        others = np.delete(edge_margin_violation(self.compiled.problem, current.candidate), i)
        scores = self._scorer.score(points, normals) - EDGE_PENALTY * float(np.sum(others))
        least = _least_improvement(self.score(current))
        for j in np.argsort(-scores, kind="stable")[:TRIED]:
            if scores[j] <= least:
                return
            moved = self._touching_at(i, points[j, i] - self._radii[i] * normals[j, i])
            if moved is not None and self.score(moved) > least:
                self.current = moved
                return

    def _touching_at(self, i: int, goal: FloatArray) -> MeshContacts | None:
        """Return the contacts and hand with the centre of tip i at ``goal``, touching the mesh; None if infeasible."""
        compiled, current = self.compiled, self.current
        hand = self._nearest_posture(i, goal)
        centre = self._tip(hand, i)[0]
        if np.linalg.norm(centre - goal) > TOUCHING:
            return None
        contact, _, distance = (v[0] for v in compiled.surface.mesh.closest(centre[None]))
        if abs(distance - self._radii[i]) > TOUCHING:
            return None
        points, normals = current.candidate.points.copy(), current.normals.copy()
        points[i], normals[i] = contact, (contact - centre) / distance
        moved = MeshContacts(replace(current.candidate, points=points, hand=hand), normals)
        return moved if self._violation(moved) <= self._allowed else None

    def _nearest_posture(self, i: int, goal: FloatArray) -> Values:
        """Return the posture with tip i nearest to ``goal``, moved by that finger alone (inverse kinematics)."""
        hand, variables = self.current.candidate.hand, self._finger_variables[i]
        for _ in range(STEPS):
            centre, jacobian = self._tip(hand, i)
            if np.linalg.norm(goal - centre) < 0.1 * TOUCHING:
                break
            J = jacobian[:, variables]
            step = J.T @ np.linalg.solve(J @ J.T + DAMPING * np.eye(3), goal - centre)
            z = _hand_vector(hand)
            z[variables] += step * min(1.0, LONGEST / max(float(np.max(np.abs(step))), 1e-12))
            hand = _split_variables(np.clip(z, *self._limits), hand)
        return hand

    def _tip(self, hand: Values, i: int) -> tuple[FloatArray, FloatArray]:
        """Return the centre of tip i, (3,), and its Jacobian in the hand's variables, (3, m)."""
        positions, jacobian = self.compiled.hand_functions.tip_jacobian_function(*hand.values())
        return positions.full()[:, i], jacobian.full()[3 * i : 3 * i + 3]

    def _violation(self, grasp: MeshContacts) -> float:
        """Return the largest constraint violation of a grasp, with link distances from the mesh itself."""
        values = self.compiled.constraint_values_at(grasp.candidate, grasp.normals)
        return float(self.compiled.rows.largest_violations(values[None])[0])


def _least_improvement(score: float) -> float:
    """Return the score that a grasp must exceed to count as better than one with this score."""
    return score + GAIN * abs(score)


def _single_finger_variables(compiled: CompiledProblem, candidate: GraspCandidate) -> BoolArray:
    """Return for each finger the mask of the hand's variables that move this finger alone, (k, m)."""
    jacobian = np.abs(compiled.hand_functions.tip_jacobian_function(*candidate.hand.values())[1].full())
    moves = jacobian.reshape(len(candidate.points), 3, -1).max(axis=1) > FIXED
    return np.asarray(moves & (np.sum(moves, axis=0) == 1))


def _hand_vector(hand: Values) -> FloatArray:
    """Return the hand's variables as one vector, (m,)."""
    return np.concatenate(list(hand.values()))


def _split_variables(z: FloatArray, template: Values) -> Values:
    """Return a vector (m,) split into the hand's variables, with the names and sizes of a template."""
    ends = np.cumsum([len(v) for v in template.values()])[:-1]
    return dict(zip(template, np.split(z, ends), strict=True))
