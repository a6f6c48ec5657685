"""Weakest directions of grasps with known quality on a square."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.budgets import L2Budget
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.cutting_planes import missed_directions, weakest_directions_of
from nlpgrasp.quality.containment import make_containment
from nlpgrasp.quality.ratio_minimisation import random_directions
from nlpgrasp.quality.weakest_directions import QUICK, THOROUGH, weakest_directions
from nlpgrasp.quality.wrench_set import WrenchSet, central_differences
from tests.optimize.squares import BALL, BEST_OF_THREE, BEST_OF_TWO, THREE, TWO, compiled_square
from tests.quick import first


@pytest.mark.parametrize("descents", [THOROUGH, QUICK], ids=["thorough", "quick"])
@pytest.mark.parametrize(("candidate", "expected"), [(TWO, BEST_OF_TWO), (THREE, BEST_OF_THREE)], ids=["two", "three"])
def test_the_least_ratio_is_the_quality(candidate, expected, descents, rng):
    compiled = compiled_square(len(candidate.points))
    weakest = weakest_directions_of(compiled, candidate, rng, descents=descents)
    assert weakest.value == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("candidate", [TWO, THREE], ids=["two", "three"])
def test_directions_have_unit_reach_and_come_weakest_first(candidate, rng):
    compiled = compiled_square(len(candidate.points))
    weakest = weakest_directions_of(compiled, candidate, rng)
    np.testing.assert_allclose(BALL.support(weakest.directions)[0], 1.0, rtol=1e-12)
    ratios = compiled.wrench_set(candidate).support(weakest.directions)[0]
    assert ratios[0] == pytest.approx(weakest.value, rel=1e-9)
    assert np.all(np.diff(ratios) >= -1e-9)


def test_known_directions_are_begun_from(rng):
    """With hardly a fresh direction the search still finds what it was told of."""
    compiled = compiled_square(3)
    known = weakest_directions_of(compiled, THREE, rng).directions[:1]
    again = weakest_directions_of(compiled, THREE, rng, known=known, descents=QUICK)
    assert again.value <= compiled.wrench_set(THREE).support(known)[0][0] + 1e-12


def test_a_grasp_that_resists_nothing_has_value_zero(rng):
    """Both contacts push the same way."""
    candidate = GraspCandidate((TWO.faces[0],) * 2, np.array([[-0.5, -1.0], [0.5, -1.0]]))
    assert weakest_directions_of(compiled_square(2), candidate, rng).value == pytest.approx(0.0, abs=1e-9)


TASKS = {
    "thin": ng.TaskEllipsoid([1.0, 0.1, 0.1, 0.003, 0.03, 0.001]),
    "off-centre": ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.01, 0.01, 0.01], center=[0.5, 0.2, 0.0, 0.0, 0.0, 0.003]),
    "sum": ng.lift([0.0, 0.0, 0.0], 0.3) + ng.disturbance(1.0, 0.01),
}


@pytest.mark.slow
@pytest.mark.parametrize("task", first(1, TASKS))
def test_descents_agree_with_certificates(task):
    """Gradients alone were off by 5 % in the middle of thin tasks, by far more at the worst."""
    task, rng = TASKS[task], np.random.default_rng(3)
    axes, off = np.array([0.05, 0.03, 0.04]), []
    for _ in range(60):
        u = rng.standard_normal((4, 3))
        u /= np.linalg.norm(u, axis=1)[:, None]
        normals = -u / axes / np.linalg.norm(u / axes, axis=1)[:, None]
        grasp = ng.Grasp(u * axes, normals, [ng.FrictionContact(0.7)] * 4)
        bounds = ng.mu(grasp, task, 0.005)
        weakest = weakest_directions(grasp, task, L2Budget(), rng).value
        assert weakest >= bounds.lower * (1.0 - 1e-9)
        if bounds.lower > 1e-3:
            off.append(weakest / bounds.upper - 1.0)
    assert len(off) > 20
    assert np.median(off) < 1e-3
    assert np.mean(np.array(off) > 0.01) <= 0.05


def test_a_polytope_finds_what_descents_missed():
    compiled = compiled_square(3)
    weakest, _ = missed_directions(compiled, THREE, 1.3 * BEST_OF_THREE)
    assert weakest is not None
    assert weakest.value == pytest.approx(BEST_OF_THREE, rel=0.01)
    np.testing.assert_allclose(BALL.support(weakest.directions)[0], 1.0, rtol=1e-12)
    assert missed_directions(compiled, THREE, BEST_OF_THREE)[0] is None


def test_the_curvature_is_the_change_of_the_support_squared(rng):
    """Against central differences of the gradient ``G P_K(G^T y)``."""
    u = rng.standard_normal((4, 3))
    u /= np.linalg.norm(u, axis=1)[:, None]
    contacts = [ng.FrictionContact(0.6), ng.PointContact(), ng.SoftContact(0.5, 0.1), ng.FrictionContact(0.3)]
    wrenches = WrenchSet.of(ng.Grasp(u, -u, contacts), "l2")
    y, h = rng.standard_normal((30, 6)), 1e-6

    def gradient(y):
        return wrenches.project(y @ wrenches.G) @ wrenches.G.T

    expected = np.stack([(gradient(y + e) - gradient(y - e)) / (2.0 * h) for e in h * np.eye(6)], axis=2)
    error = np.max(np.abs(wrenches.curvature(y) - expected), axis=(1, 2))
    assert np.sum(error > 1e-6) <= 1  # one of thirty may be at a kink


@pytest.mark.parametrize("budget", ["l2", "per_finger"])
def test_the_hessian_of_the_ratio_is_the_change_of_its_gradient(budget, rng):
    """Against central differences of the ratio's gradient, also along the direction itself."""
    u = rng.standard_normal((4, 3))
    u /= np.linalg.norm(u, axis=1)[:, None]
    grasp = ng.Grasp(u, -u, [ng.FrictionContact(0.6), ng.SoftContact(0.5, 0.1)] * 2)
    containment = make_containment(WrenchSet.of(grasp, budget), ng.gravity([0, 0, 0], 0.3) + ng.disturbance(1.0, 0.2))[
        0
    ]
    y = random_directions(30, 6, rng)
    error = np.max(np.abs(containment.hessian(y) - central_differences(containment.ratio, y)), axis=(1, 2))
    assert np.sum(error > 1e-5 * np.max(np.abs(containment.hessian(y)))) <= 1  # one of thirty may be at a kink
