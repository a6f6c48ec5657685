"""log nu by fixed rays: its value, its derivative by finite differences, and the ascent."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.propose import propose
from nlpgrasp.optimize.trust_region import Linearisation
from nlpgrasp.optimize.volume_ascent import SampledVolume, maximise_volume, sampled_volume

SQUARE = ng.Polygon([[-0.05, -0.05], [0.05, -0.05], [0.05, 0.05], [-0.05, 0.05]])
STEP = 1e-5  # solver units


def compiled_and_candidate(body, count):
    problem = ng.GraspProblem(body, [ng.FrictionContact(0.5)] * count, objective="nu", torque_scale=1.0)
    compiled = CompiledProblem(problem, ng.SolveOptions(workers=1))
    return compiled, propose(compiled, np.random.default_rng(0))[-1]


@pytest.mark.parametrize(
    ("body", "count"),
    [(SQUARE, 3), pytest.param(ng.Ellipsoid([0.05, 0.04, 0.03]), 4, marks=pytest.mark.slow)],
)
def test_the_derivative_of_log_nu_is_that_of_central_differences(body, count):
    compiled, candidate = compiled_and_candidate(body, count)
    grasp = compiled.grasp(candidate)
    sampled = SampledVolume(compiled, grasp, 200)
    linear = Linearisation(compiled, candidate, np.zeros((0, grasp.dimension)))
    gradient = sampled.gradient(candidate, linear.z, sampled.at(grasp))
    differences = [
        (sampled.at(linear.grasp_at(linear.z + e)).log - sampled.at(linear.grasp_at(linear.z - e)).log) / (2.0 * STEP)
        for e in STEP * np.eye(len(linear.z))
    ]
    free = np.abs(gradient) > 0.0
    assert np.count_nonzero(free) > count
    np.testing.assert_allclose(gradient[free], np.array(differences)[free], rtol=1e-4, atol=1e-5)


def test_nu_by_rays_is_nu_and_the_ascent_raises_it():
    compiled, candidate = compiled_and_candidate(SQUARE, 3)
    moved = maximise_volume(compiled, candidate, Deadline())
    before, after = (ng.nu(compiled.grasp(each), rtol=0.002) for each in (candidate, moved))
    assert np.exp(sampled_volume(compiled, compiled.grasp(moved))) == pytest.approx(after.value, rel=0.03)
    assert after.lower > before.upper
    assert compiled.violation(moved) <= 1e-6


def test_without_force_closure_there_is_nothing_to_climb():
    compiled, _ = compiled_and_candidate(SQUARE, 3)
    points, normals = np.array([[-0.05, 0.0], [-0.05, 0.01], [-0.05, -0.01]]), np.tile([1.0, 0.0], (3, 1))
    assert sampled_volume(compiled, compiled.grasp_at(points, normals)) == -np.inf
