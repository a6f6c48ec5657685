"""Where a start begins: random placements over the body, screened by the fast support function."""

from __future__ import annotations

from itertools import combinations_with_replacement, product

import numpy as np

from nlpgrasp.directions import directions
from nlpgrasp.grasp_stack import GraspStack
from nlpgrasp.quality.screening import sampled_ratios, screening_score
from nlpgrasp.solve.workbench import FEASIBLE, Workbench
from nlpgrasp.validation import FloatArray

ENUMERATE_BELOW = 64


def draw_start(bench: Workbench, rng: np.random.Generator) -> tuple[tuple[str, ...], FloatArray]:
    """Return the best of the screened placements.

    Face assignments are enumerated where there are few, so that each gets its share of the candidates, and
    sampled where there are many. Candidates that violate a constraint come after all that do not.

    Returns
    -------
    faces : tuple of k str
    points : (k, space) array
    """
    count = bench.options.candidates
    assignments = _assignments(bench, count, rng)
    points = np.stack([_place(bench, faces, rng) for faces in assignments])
    normals = _normals(bench, assignments, points)
    stack = GraspStack(points, normals, bench.problem.models, bench.problem.origin)
    ratios = sampled_ratios(stack, bench.problem.task, screening_directions(bench), bench.screening_budget)
    score = screening_score(ratios) * bench.scaling.beta
    violation = bench.violations(points, normals, bench.hand_start(points, normals))
    best = int(np.argmax(np.where(violation <= FEASIBLE, score, -1.0 - violation)))
    return assignments[best], points[best]


def screening_directions(bench: Workbench) -> FloatArray:
    """Return well-spread directions in wrench space, round in the solver's units, (m, d)."""
    return directions(bench.problem.dimension, 2) * bench.scaling.wrench


def _assignments(bench: Workbench, count: int, rng: np.random.Generator) -> list[tuple[str, ...]]:
    problem = bench.problem
    allowed = [tuple(n for n in problem.allowed_faces(i) if n in bench.cloud) for i in range(len(problem.models))]
    same = all(m == problem.models[0] for m in problem.models) and all(a == allowed[0] for a in allowed)
    total = np.prod([float(len(a)) for a in allowed])
    if total <= 4096:
        every = list(combinations_with_replacement(allowed[0], len(allowed))) if same else list(product(*allowed))
        if len(every) <= ENUMERATE_BELOW:
            start = int(rng.integers(len(every)))
            return [every[(start + i) % len(every)] for i in range(count)]
    drawn = [tuple(str(rng.choice(names)) for names in allowed) for _ in range(count)]
    return [tuple(sorted(faces, key=allowed[0].index)) for faces in drawn] if same else drawn


def _place(bench: Workbench, faces: tuple[str, ...], rng: np.random.Generator) -> FloatArray:
    return np.stack([bench.cloud[f][rng.integers(len(bench.cloud[f]))] for f in faces])


def _normals(bench: Workbench, assignments: list[tuple[str, ...]], points: FloatArray) -> FloatArray:
    result = np.empty_like(points)
    names = np.array(assignments)
    for name in np.unique(names):
        where = names == name
        result[where] = -bench.problem.body.evaluate(str(name), points[where])[2]
    return result
