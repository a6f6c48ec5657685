"""Regression cases: narrow cones, far origins, tiny scales, overlapping cells."""

import numpy as np
import pytest

import nlpgrasp as ng
from tests.quick import every, first
from tests.samples import EVERY as CONTACTS
from tests.samples import ellipsoid_grasp

TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)


@pytest.mark.parametrize("space", [2, 3])
@pytest.mark.parametrize("friction", every(2, [0.001, 0.01, 0.05]))
def test_forces_from_inside_narrow_cones_are_found_again(space, friction):
    for seed in range(10):
        rng = np.random.default_rng(seed)
        u = rng.standard_normal((space + 1, space))
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        grasp = ng.Grasp(u, -u, ng.FrictionContact(friction))
        x = rng.standard_normal((20, space + 1, space))
        x[..., 0] = np.abs(x[..., 0]) + 0.1
        tangential = x[..., 1:]
        size = np.linalg.norm(tangential, axis=-1, keepdims=True)
        x[..., 1:] = 0.9 * friction * x[..., :1] * tangential / size
        x = x.reshape(20, -1)
        result = ng.finger_forces(grasp, x @ grasp.G.T)
        assert result.feasible.all()
        assert np.all(result.used <= np.linalg.norm(x, axis=1) * (1 + 1e-7))


@pytest.mark.parametrize("name", CONTACTS)
def test_small_bodies_in_si_units(name):
    for seed in range(3):
        rng = np.random.default_rng(seed)
        grasp = ellipsoid_grasp(rng)
        contact = CONTACTS[name]
        grasp = ng.Grasp(0.003 * grasp.points, grasp.normals, contact)
        n = contact.components(3)
        x = contact.project(rng.standard_normal((10, 4, n)) + np.eye(n)[0]).reshape(10, -1)
        assert ng.finger_forces(grasp, x @ grasp.G.T).feasible.all()


@pytest.mark.slow
def test_answers_do_not_depend_on_the_batch():
    n = np.array([[1, 0, 0], [-0.5, 3**0.5 / 2, 0], [-0.5, -(3**0.5) / 2, 0]])
    grasp = ng.Grasp(0.05 * n, -n, ng.SoftContact(0.5, 0.01))
    wrenches = np.random.default_rng(0).standard_normal((3000, 6)) * np.array([1, 1, 1, 0.05, 0.05, 0.05])
    batch = ng.finger_forces(grasp, wrenches)
    assert batch.feasible.all()
    single = [ng.finger_forces(grasp, w).used[0] for w in wrenches[:50]]
    np.testing.assert_allclose(batch.used[:50], single, rtol=1e-7)


def test_torque_rows_that_are_only_rounding():
    angles = 2.0 * np.pi * np.arange(3) / 3.0
    u = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for radius in (0.07, 0.3, 1.0):
        result = ng.finger_forces(ng.Grasp(radius * u, -u, ng.PointContact()), [[1, 1, 0], [1, -1, 0]])
        np.testing.assert_allclose(result.used, 1.632993, rtol=1e-5)


def test_a_far_torque_origin_does_not_undo_stability():
    grasp = ng.Grasp(1e-3 * TETRAHEDRON, -TETRAHEDRON, ng.FrictionContact(0.5), torque_origin=[1000, 300, -200])
    assert ng.is_stable(grasp)
    assert ng.delta(grasp).upper == pytest.approx(6.45e-7, rel=0.01)
    assert ng.is_stable(ng.Grasp(1e-9 * TETRAHEDRON, -TETRAHEDRON, ng.FrictionContact(0.5)))


def test_small_numbers_are_not_zero():
    grasp = ng.Grasp(TETRAHEDRON, -TETRAHEDRON, ng.FrictionContact(0.5))
    weak, strong = (ng.delta(grasp, force_budget=ng.JointTorqueLimits([np.eye(3)] * 4, t)) for t in (1e-9, 1.0))
    assert weak.upper == pytest.approx(1e-9 * strong.upper, rel=0.02)
    assert ng.mu(grasp, ng.TaskEllipsoid([1e9, 1, 1, 1, 1, 1])).lower > 0.0
    assert ng.delta(ng.Grasp(TETRAHEDRON, -TETRAHEDRON, ng.FrictionContact(1e-9))).lower > 0.0
    planar = ng.Grasp([[1, 0], [-0.5, 0.8], [-0.5, -0.8]], [[-1, 0], [0.6, -0.8], [0.6, 0.8]], ng.FrictionContact(0.5))
    assert ng.nu(planar, 1e-10).value == pytest.approx(ng.nu(planar, 1.0).value * 1e10, rel=0.02)


def test_closed_by_no_more_than_rounding():
    """Closed by a margin of 5e-9: no direction is claimed, and no larger ball, however a processor rounds."""
    points, normals = [[-1, 0, 0], [1, 1 - 1e-8, 0]], [[1, 0, 0], [-1, 0, 0]]
    stability = ng.is_stable(ng.Grasp(points, normals, ng.SoftContact(0.5, 0.1)))
    assert stability.separating_direction is None
    assert stability.radius.upper > 0.0
    assert stability.radius.lower < 5e-9
    assert stability.stable == (stability.radius.lower > 0.0)


@pytest.mark.parametrize("origin", [1.0, 100.0, 1000.0])
def test_bilateral_bounds_hold_far_from_the_origin(origin):
    """Against the smallest singular value by inverse iteration in extended precision."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        n = rng.standard_normal((3, 3))
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        contact = ng.BilateralContact(ng.FrictionContact(0.5))
        grasp = ng.Grasp(0.05 * rng.standard_normal((3, 3)), n, contact, torque_origin=[origin, 0, 0])
        bounds = ng.delta(grasp)
        G = grasp.G.astype(np.longdouble)
        sigma = smallest_by_inverse_iteration(G @ G.T)
        assert bounds.lower * (1 - 1e-8) <= sigma <= bounds.upper * (1 + 1e-8)


def smallest_by_inverse_iteration(gram):
    """Return the square root of the smallest eigenvalue of a symmetric positive matrix, without LAPACK."""
    d = len(gram)
    L = np.zeros_like(gram)
    for i in range(d):
        for j in range(i + 1):
            rest = gram[i, j] - np.dot(L[i, :j], L[j, :j])
            L[i, j] = np.sqrt(rest) if i == j else rest / L[j, j]
    x = np.ones(d, dtype=np.longdouble)
    for _ in range(200):
        y = x.copy()
        for i in range(d):
            y[i] = (y[i] - np.dot(L[i, :i], y[:i])) / L[i, i]
        for i in reversed(range(d)):
            y[i] = (y[i] - np.dot(L[i + 1 :, i], y[i + 1 :])) / L[i, i]
        x = y / np.sqrt(np.dot(y, y))
    return float(np.sqrt(np.dot(x, gram @ x)))


@pytest.mark.parametrize("budget", ["shared", "per_finger"])
def test_planar_volumes_of_polytopes(budget):
    """W is a polytope: its hull is exact. Overlapping cells once counted some of it three times."""
    for seed in [*range(150), 219, 7438, 7439, 7855, 9689, 10729, 10929, 11426, 11574, 11987, 13192, 13534]:
        rng = np.random.default_rng(seed)
        k, friction, radius = int(rng.integers(2, 5)), float(10 ** rng.uniform(-1.5, 0.5)), 10 ** rng.uniform(-2, 1)
        rng.random()
        u = rng.standard_normal((k, 2))
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        grasp = ng.Grasp(radius * u, -u, ng.FrictionContact(friction))
        volume = ng.nu(grasp, radius, 0.02, force_budget=budget, seed=seed)
        exact = ng.pyramid_volume(grasp, torque_scale=radius, force_budget=budget)
        assert volume.lower <= exact * (1 + 1e-6)
        assert exact <= volume.upper * (1 + 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("seed", first(1, range(2)))
def test_two_soft_fingers_have_a_volume(seed):
    u = np.random.default_rng(seed).standard_normal((2, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    volume = ng.nu(ng.Grasp(u, -u, ng.SoftContact(0.07, 0.1)), rtol=0.5)
    assert 0.0 < volume.lower <= volume.value <= volume.upper


def test_contacts_a_nanometre_apart_end_with_a_wide_interval():
    """Rounding makes millions of cells of such a grasp's hull: points that would are left out."""
    points = np.array([[-0.986553, -1.482316, -1.642722]] * 2 + [[1.804856, -0.258734, 0.782367]])
    points[1] += 0.757e-9
    normals = np.array(
        [[0.533729, 0.452018, 0.714712], [-0.156903, -0.790861, -0.59154], [-0.756185, 0.654323, -0.006784]]
    )
    models = [ng.FrictionContact(3.0), ng.SoftContact(3.0, 0.01515), ng.PointContact()]
    grasp = ng.Grasp(points, normals / np.linalg.norm(normals, axis=1)[:, None], models)
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.7575, 0.7575, 0.7575])
    bounds = ng.mu(grasp, task)
    assert bounds.lower == 0.0
    assert 0.0 <= bounds.upper < 1e-8
