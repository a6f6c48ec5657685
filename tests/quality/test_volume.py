"""Volume nu: closed form, hulls, certified bounds and frame invariance."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import nlpgrasp as ng
from nlpgrasp.common.spatial import move_torque_origin
from nlpgrasp.quality import WrenchSet
from nlpgrasp.quality.volume import _certify_volume
from tests.samples import CONTACTS, closed_ellipsoid_grasp, ellipsoid_grasp, random_rotation


@pytest.mark.parametrize("scale", [1.0, 0.2])
def test_bilateral_closed_form(scale, rng):
    """(3.2-2): the volume of the unit ball times the singular values."""
    grasp = ng.Grasp(*(getattr(ellipsoid_grasp(rng), n) for n in ("points", "normals")), CONTACTS["bilateral"])
    volume = ng.nu(grasp, torque_scale=scale)
    expected = np.pi**3 / 6.0 * np.sqrt(np.linalg.det(grasp.G @ grasp.G.T)) / scale**3
    assert volume.value == pytest.approx(expected)
    assert expected in volume
    assert volume.upper / volume.lower < 1.0 + 1e-8


@pytest.mark.parametrize("seed", range(3))
def test_the_estimate_agrees_with_the_closed_form(seed):
    """The general way, on K = R^n: a ball of volume pi^3 / 6 after whitening."""
    rng = np.random.default_rng(seed)
    grasp = ng.Grasp(*(getattr(ellipsoid_grasp(rng), n) for n in ("points", "normals")), CONTACTS["bilateral"])
    vectors, values, _ = np.linalg.svd(grasp.G)
    volume = _certify_volume(WrenchSet.of(grasp).transformed((vectors / values).T), 0.01, rng)
    assert np.pi**3 / 6.0 in volume
    assert volume.upper <= 1.05 * volume.lower
    assert abs(volume.value - np.pi**3 / 6.0) <= volume.error <= 0.01 * volume.value


@pytest.mark.parametrize("budget", ["l2", "per_finger", "shared", "per_finger_size"])
def test_planar_volume_is_certified_and_agrees_with_a_hull(budget):
    angles = 2.0 * np.pi * np.arange(3) / 3.0 + 0.2
    points = np.stack([np.cos(angles), 0.7 * np.sin(angles)], axis=1)
    normals = -points / np.linalg.norm(points, axis=1, keepdims=True)
    grasp = ng.Grasp(points, normals, ng.FrictionContact(0.6))
    volume = ng.nu(grasp, rtol=5e-3, force_budget=budget)
    assert volume.gap <= 5.1e-3
    y = np.random.default_rng(0).standard_normal((60000, 3))
    wrenches = WrenchSet.of(grasp, budget).support(y)[1]
    hull = ConvexHull(np.concatenate([wrenches + 1e-9 * y[: len(wrenches)], np.zeros((1, 3))])).volume
    assert volume.lower <= hull * (1 + 1e-3)
    assert hull <= volume.upper * (1 + 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 3, 5])
def test_certified_bounds_contain_the_estimate_and_a_hull(seed):
    rng = np.random.default_rng(seed)
    grasp = closed_ellipsoid_grasp(rng, k=3 + seed % 3) if seed % 2 else ellipsoid_grasp(rng)
    volume = ng.nu(grasp)
    assert volume.lower <= volume.value <= volume.upper
    assert volume.error <= 0.01 * volume.value
    repeated = ng.nu(grasp, seed=seed + 1)
    assert abs(volume.value - repeated.value) <= volume.error + repeated.error
    inner = ConvexHull(
        np.concatenate([WrenchSet.of(grasp).support(rng.standard_normal((150, 6)))[1], np.zeros((1, 6))])
    )
    assert inner.volume <= volume.upper


@pytest.mark.parametrize("seed", range(4))
def test_the_interval_contains_a_volume_known_by_its_hull(seed):
    """Normal forces that add up to one: the hull of their wrenches and the origin."""
    rng = np.random.default_rng(seed)
    points, normals = rng.standard_normal((2, 14, 3))
    grasp = ng.Grasp(points, normals / np.linalg.norm(normals, axis=1, keepdims=True), ng.PointContact())
    volume = ng.nu(grasp, rtol=0.02, force_budget="shared", seed=seed)
    exact = ConvexHull(np.concatenate([grasp.G.T, np.zeros((1, 6))])).volume
    assert exact in volume
    assert volume.upper <= 1.1 * volume.lower
    assert volume.value == pytest.approx(exact, rel=0.02)


def test_rays_say_by_what_chance_they_mislead(rng):
    volume = ng.nu(closed_ellipsoid_grasp(rng, k=4), rtol=0.02)
    assert volume.upper <= 1.1 * volume.lower
    assert volume.trust == "random rays, which mislead in less than one of 1e+09 runs"


@pytest.mark.slow
def test_hit_and_miss_agrees(rng):
    """A box around the set, uniform points in it, and the least force that each needs."""
    grasp = closed_ellipsoid_grasp(rng, k=5, friction=0.8)
    nu = ng.nu(grasp)
    vectors, values, _ = np.linalg.svd(grasp.G)
    white = WrenchSet.of(grasp).transformed((vectors / values).T)
    sides = np.stack([white.support(s * np.eye(6))[0] for s in (1.0, -1.0)])
    u = rng.uniform(-sides[1], sides[0], (200_000, 6))
    inside = ng.finger_forces(grasp, u @ (vectors * values).T).used <= 1.0
    hit = np.mean(inside)
    volume = hit * np.prod(sides.sum(axis=0)) * np.prod(values)
    spread = np.sqrt((1 - hit) / hit / len(u))
    assert volume == pytest.approx(nu.value, rel=4 * spread + 0.01)


@pytest.mark.slow
def test_other_budgets_in_space(rng):
    grasp = closed_ellipsoid_grasp(rng, k=4, friction=0.8)
    shared, fingers = (ng.nu(grasp, rtol=0.05, force_budget=b) for b in ("shared", "per_finger"))
    assert 0.0 < shared.lower <= shared.value <= shared.upper
    assert shared.upper < fingers.lower
    assert shared.value == pytest.approx(ng.pyramid_volume(grasp, edges=24), rel=0.08)


@pytest.mark.slow
def test_hexagonal_prism(rng):
    """Example 3-3 (a) on a regular prism of inradius 1: 6.46 (docs/corrections.md: the paper's dimensions are lost)."""
    values = {}
    for name, sides in {"a": [0, 2, 4], "b": [0, 1, 3]}.items():
        angles = np.pi / 3.0 * np.array(sides)
        points = np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
        values[name] = ng.nu(ng.Grasp(points, -points, ng.FrictionContact(1.0)))
    assert values["a"].value == pytest.approx(6.46, rel=0.012)
    assert values["a"].value - values["a"].error > values["b"].value + values["b"].error


@pytest.mark.slow
def test_nu_is_bi_invariant():
    """Theorem 3-2: neither the body frame nor the torque origin matters; delta is another matter."""
    rng = np.random.default_rng(0)
    grasp = closed_ellipsoid_grasp(rng)
    A, b = random_rotation(rng), rng.standard_normal(3)
    moved = ng.Grasp(grasp.points @ A.T, grasp.normals @ A.T, grasp.contacts, torque_origin=A @ b)
    original, moved_volume = ng.nu(grasp), ng.nu(moved)
    assert abs(original.value - moved_volume.value) <= original.error + moved_volume.error
    assert original.lower <= moved_volume.upper
    assert moved_volume.lower <= original.upper
    assert abs(np.linalg.det(move_torque_origin(b))) == pytest.approx(1.0)


def test_no_rank_no_volume():
    """Two hard contacts span five dimensions of six."""
    grasp = ng.Grasp([[1, 0, 0], [-1, 0, 0]], [[-1, 0, 0], [1, 0, 0]], ng.FrictionContact(0.5))
    volume = ng.nu(grasp)
    assert (volume.lower, volume.value, volume.upper) == (0.0, 0.0, 0.0)


@pytest.mark.slow
def test_a_grasp_that_is_not_closed_has_a_volume_all_the_same():
    """Section 3.2: nu does not reflect stability."""
    points = [[1, 0, 0], [-1, 0.5, 0], [0, -1, 0]]
    grasp = ng.Grasp(points, [[0, 0, 1]] * 3, ng.FrictionContact(0.5))
    assert not ng.is_stable(grasp)
    assert ng.nu(grasp, rtol=0.5).lower > 0.0


def test_a_polytope_of_few_vertices():
    """Seed 671 of the polytopes in test_hard_cases: 24 random directions saw vertices in one plane only."""
    rng = np.random.default_rng(671)
    k, friction, radius = int(rng.integers(2, 5)), float(10 ** rng.uniform(-1.5, 0.5)), 10 ** rng.uniform(-2, 1)
    rng.random()
    u = rng.standard_normal((k, 2))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    grasp = ng.Grasp(radius * u, -u, ng.FrictionContact(friction))
    volume = ng.nu(grasp, radius, 0.02, force_budget="per_finger", seed=671)
    exact = ng.pyramid_volume(grasp, torque_scale=radius, force_budget="per_finger")
    assert volume.lower * (1 - 1e-6) <= exact <= volume.upper * (1 + 1e-6)
