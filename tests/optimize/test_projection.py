"""Projection of candidates onto the constraints."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.projection import TOUCHING, project_onto_constraints

FACES = ("surface",) * 3


def compiled(*constraints):
    task = ng.TaskEllipsoid([1.0] * 6)
    problem = ng.GraspProblem(ng.Sphere(1.0), [ng.FrictionContact(0.5)] * 3, task, constraints=constraints)
    return CompiledProblem(problem, ng.SolveOptions(workers=1))


def close_together(rng):
    points = np.array([0.0, 0.0, 1.0]) + 0.3 * rng.standard_normal((3, 3))
    return GraspCandidate(FACES, points / np.linalg.norm(points, axis=1, keepdims=True))


@pytest.mark.parametrize("seed", range(3))
def test_contacts_on_a_sphere_spread(seed):
    """The distances grow to the constraint's 1.2 and the contacts stay on the sphere."""
    spread = compiled(ng.Spread(1.2, 1.9))
    start = close_together(np.random.default_rng(seed))
    assert spread.violation(start) > 0.1
    projected, violation = project_onto_constraints(spread, start)
    assert violation <= 1e-6
    assert spread.violation(projected) <= 1e-5
    np.testing.assert_allclose(np.linalg.norm(projected.points, axis=1), 1.0, atol=1e-12)
    distances = [np.linalg.norm(projected.points[i] - projected.points[j]) for i, j in ((0, 1), (0, 2), (1, 2))]
    assert np.min(distances) >= 1.2 - 1e-5


def test_infeasible_constraints_are_violated_least(rng):
    """Three points of a unit sphere are at most sqrt(3) apart: 1.9 squared is 0.61 too much, over the row's scale."""
    projected, violation = project_onto_constraints(compiled(ng.Spread(1.9)), close_together(rng))
    assert TOUCHING < violation < 0.62
    np.testing.assert_allclose(np.linalg.norm(projected.points, axis=1), 1.0, atol=1e-12)
