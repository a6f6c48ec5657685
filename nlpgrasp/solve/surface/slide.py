"""From contacts on the solver's smooth surface to contacts on the mesh itself.

Smoothing rounds edges and noise; where the smooth surface and the mesh differ, the nearest point of the mesh
may have quite another normal. So the nearest points are only the beginning: the contacts then slide over the
mesh, one at a time, to the sample point that resists the task best. They stay where the mesh's normal is within
30 degrees of the smooth one: a finger on a sharp edge or on one noisy triangle is no contact to rely on.
"""

from __future__ import annotations

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.grasp.stack import GraspStack
from nlpgrasp.quality.screening import sampled_ratios, screening_score
from nlpgrasp.solve.ascent.weakest import weakest_directions
from nlpgrasp.solve.start.screen import screening_directions
from nlpgrasp.solve.workbench.workbench import FEASIBLE, MESH_ANGLE, Workbench
from nlpgrasp.solve.workers.stop import Stop

FIRST_REACH, LAST_REACH = 0.12, 0.01  # of the body's size: how far a contact may slide in one move
TRIALS = 48
SWEEPS = 12


def slide_onto_mesh(
    bench: Workbench,
    body: Mesh,
    start: FloatArray,
    hand: dict[str, FloatArray] | None,
    rng: np.random.Generator,
    stop: Stop,
    reach: float = FIRST_REACH,
) -> Grasp:
    """Return a grasp whose contacts are on the mesh, with the mesh's own normals.

    Every move is to a point of the mesh, keeps the constraints, and raises the least ratio over the weakest
    directions found so far; these are searched anew after each sweep.

    Parameters
    ----------
    bench : Workbench
    body : Mesh
    start : (k, 3) array
        Contacts on the smooth surface.
    hand : dict or None
        Values of the hand's variables, for the constraints; None to leave constraints out of it.
    rng : numpy.random.Generator
    stop : Stop
    reach : float
        How far a contact may slide in the first moves, over the body's size.
    """
    points, normals = _nearest_plain(bench, body, start)
    y = screening_directions(bench)
    cuts = _weakest(bench, points, normals, y[:0], rng)
    best_points, best_normals = points.copy(), normals.copy()
    best = _value(bench, points, normals, cuts)
    for _ in range(SWEEPS):
        if stop.requested() or reach < LAST_REACH:
            break
        moved = False
        for i in range(len(points)):
            moved |= _move(
                bench, points, normals, i, np.concatenate([y, cuts]), reach * bench.scaling.length, rng, hand
            )
        cuts = np.concatenate([cuts, _weakest(bench, points, normals, cuts, rng)])[-400:]
        value = _value(bench, points, normals, cuts)
        if value > best * (1.0 + 1e-3):
            best, best_points, best_normals = value, points.copy(), normals.copy()
        else:
            points, normals = best_points.copy(), best_normals.copy()
            moved = False
        if not moved:
            reach *= 0.5
    return Grasp(best_points, best_normals, bench.problem.models, bench.problem.origin)


def _nearest_plain(bench: Workbench, body: Mesh, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the nearest points of the mesh away from sharp edges, and the mesh's inward normals there."""
    positions, outward, _ = body.closest(points)
    smooth = body.evaluate(body.face_names[0], positions)[2]
    edge = np.sum(smooth * outward, axis=1) < np.cos(MESH_ANGLE)
    cloud, inward, tree = bench.mesh_cloud
    nearest = tree.query(points)[1]
    return np.where(edge[:, None], cloud[nearest], positions), np.where(edge[:, None], inward[nearest], -outward)


def _move(
    bench: Workbench,
    points: FloatArray,
    normals: FloatArray,
    i: int,
    y: FloatArray,
    reach: float,
    rng: np.random.Generator,
    hand: dict[str, FloatArray] | None,
) -> bool:
    """Move contact i in place to the best of the nearby mesh points, if one is better; return whether it was."""
    cloud, inward, tree = bench.mesh_cloud
    near = np.array(tree.query_ball_point(points[i], reach), dtype=int)
    if not near.size:
        return False
    if near.size > TRIALS:
        near = rng.choice(near, TRIALS, replace=False)
    trial_points = np.repeat(points[None], near.size + 1, axis=0)
    trial_normals = np.repeat(normals[None], near.size + 1, axis=0)
    trial_points[1:, i], trial_normals[1:, i] = cloud[near], inward[near]
    score = _scores(bench, trial_points, trial_normals, y)
    if hand is not None:
        values = {name: np.repeat(v[None], near.size + 1, axis=0) for name, v in hand.items()}
        broken = bench.violations(trial_points, trial_normals, values)
        score = np.where(broken <= max(FEASIBLE, broken[0]), score, -np.inf)
    best = int(np.argmax(score))
    points[i], normals[i] = trial_points[best, i], trial_normals[best, i]
    return best != 0


def _scores(bench: Workbench, points: FloatArray, normals: FloatArray, y: FloatArray) -> FloatArray:
    stack = GraspStack(points, normals, bench.problem.models, bench.problem.origin)
    return screening_score(sampled_ratios(stack, bench.problem.task, y, bench.screening_budget))


def _weakest(
    bench: Workbench, points: FloatArray, normals: FloatArray, known: FloatArray, rng: np.random.Generator
) -> FloatArray:
    grasp = Grasp(points, normals, bench.problem.models, bench.problem.origin)
    return weakest_directions(grasp, bench.problem.task, known[-100:], rng, bench.closure_budget, 60, 25).directions


def _value(bench: Workbench, points: FloatArray, normals: FloatArray, cuts: FloatArray) -> float:
    """Return the score over all cuts: the least ratio, with the tie-break for placements that are not closed."""
    return float(_scores(bench, points[None], normals[None], np.concatenate([screening_directions(bench), cuts]))[0])
