"""Equality constraints: candidates and solutions on the set of feasible placements."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.propose import propose
from tests.quick import first

QUICK = ng.SolveOptions(workers=1)
RECTANGLE = ng.Polygon([[-1.0, -0.5], [1.0, -0.5], [1.0, 0.5], [-1.0, 0.5]])
TASK = ng.TaskEllipsoid([1.0, 1.0, 0.5], center=[0.0, 0.5, 0.0])


def level_problem(tolerance):
    """Return a problem of two fingers at one horizontal position, on any sides."""
    level = ng.Constraint("level", lambda p, n: p[0][0] - p[1][0], -tolerance, tolerance)
    return ng.GraspProblem(RECTANGLE, [ng.FrictionContact(0.5)] * 2, TASK, constraints=[level])


@pytest.mark.parametrize("tolerance", first(1, [0.0, 1e-4]))
def test_starts_keep_an_equality_and_resist(tolerance):
    compiled = CompiledProblem(level_problem(tolerance), QUICK)
    for seed in range(2):
        candidate = propose(compiled, np.random.default_rng(seed))[0]
        assert compiled.violation(candidate) <= FEASIBLE
        assert set(candidate.faces) == {
            "edge0",
            "edge2",
        }  # on one vertical side the equality holds, and nothing resists


@pytest.mark.slow
def test_an_equality_on_any_face_is_solved_like_one_on_named_faces():
    solution = ng.solve(level_problem(0.0), starts=1, options=QUICK)
    # brute force: bottom and top at one x
    x = np.linspace(-0.999, 0.999, 41)
    normals = [[0.0, 1.0], [0.0, -1.0]]
    best = max(
        ng.mu(ng.Grasp([[a, -0.5], [a, 0.5]], normals, ng.FrictionContact(0.5)), TASK, rtol=0.02).lower for a in x
    )
    assert solution.mu.upper >= best
    assert solution.mu.lower == pytest.approx(0.3777, abs=2e-3)
    assert abs(solution.grasp.points[0, 0] - solution.grasp.points[1, 0]) <= 1e-5
