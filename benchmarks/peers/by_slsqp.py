"""Grasps by scipy's SLSQP as a user would write it: mu in random directions, finite differences."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import Bounds, minimize

import nlpgrasp as ng
from benchmarks.peers.answer import Answer, cpu_seconds
from benchmarks.peers.cases import Case
from benchmarks.peers.epsilon import best_of
from benchmarks.peers.random_search import Placement, start_placement
from benchmarks.peers.surface import FaceFunction, face_functions
from nlpgrasp.budgets.l2 import L2Set
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality import WrenchSet

NAME = "scipy SLSQP"
SAMPLED, ITERATIONS = 200, 200
MARGIN = 0.02  # about the bounding box, over the body's size


def answers(case: Case, starts: int, budget: float) -> list[Answer]:
    """Return the grasp of the largest epsilon over all starts.

    ``budget`` is not used.
    """
    del budget
    results = []
    for seed in range(starts):
        start = start_placement(case, seed)
        points, _ = candidate(case, start, np.random.default_rng(seed))
        results.append(Answer(NAME, points, start.faces, cpu_seconds()))
    return [best_of(case, results)]


def candidate(case: Case, start: Placement, rng: np.random.Generator) -> tuple[FloatArray, float]:
    """Maximise t subject to phi(y_j) >= t and the contacts on their faces: points (k, 3), metres, and t.

    Parameters
    ----------
    case : Case
    start : SymbolicCandidate
    rng : Generator
        Of the directions.
    """
    k, size = case.fingers, case.body.size
    functions = face_functions(case.body, start.faces)
    y = rng.standard_normal((SAMPLED, 6))
    y /= np.linalg.norm(y, axis=1, keepdims=True) * case.axes  # phi of the task is 1
    contacts, force_set = case.contacts, L2Set(case.contacts, 3)

    def reach(x: FloatArray) -> FloatArray:
        p = x[: 3 * k].reshape(k, 3)
        n = np.stack([f.values(q)[1] for f, q in zip(functions, p, strict=True)])
        G = ng.GraspStack(p[None] * size, n[None], contacts, torque_origin=case.body.centroid).G[0]
        return np.asarray(WrenchSet(G, force_set).support(y)[0] - x[-1])

    constraints: list[Any] = [
        {"type": "ineq", "fun": reach},
        {"type": "eq", "fun": partial(_distances, functions)},
        {"type": "ineq", "fun": partial(_limit_distances, functions)},
    ]
    if not len(_limit_distances(functions, np.append(start.points.ravel() / size, 0.0))):
        constraints.pop()
    x = np.append(start.points.ravel() / size, 0.0)
    low, high = case.body.bounds / size + [[-MARGIN], [MARGIN]]
    box = Bounds(np.append(np.tile(low, k), 0.0), np.append(np.tile(high, k), np.inf))
    result = minimize(
        _objective, x, method="SLSQP", bounds=box, constraints=constraints, options={"maxiter": ITERATIONS}
    )
    return result.x[:-1].reshape(k, 3) * size, float(result.x[-1])


def _objective(x: FloatArray) -> float:
    """Return the objective -t."""
    return -float(x[-1])


def _distances(functions: list[FaceFunction], x: FloatArray) -> FloatArray:
    """Return the distance of each contact from its face, (k,), in units of the body's size."""
    return np.array([f.values(p)[0] for f, p in zip(functions, x[:-1].reshape(-1, 3), strict=True)])


def _limit_distances(functions: list[FaceFunction], x: FloatArray) -> FloatArray:
    """Return the distances of contacts inside their faces' limits, in units of the body's size.

    A body of one face has no limits.
    """
    return np.concatenate([-f.values(p)[2] for f, p in zip(functions, x[:-1].reshape(-1, 3), strict=True)])
