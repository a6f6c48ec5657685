"""Stability with its proof, allowed twists, and the theorems of Section 2."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

import nlpgrasp as ng
from nlpgrasp.quality import WrenchSet
from tests.memberships import inside, is_pad, slack
from tests.samples import EVERY as CONTACTS
from tests.samples import closed_ellipsoid_grasp, ellipsoid_grasp, random_rotation


def test_a_stable_grasp_comes_with_a_ball(rng):
    grasp = closed_ellipsoid_grasp(rng)
    stability = ng.is_stable(grasp)
    assert stability
    assert stability.separating_direction is None
    assert 0.0 < stability.radius.lower <= ng.delta(grasp).upper
    inside = stability.radius.lower * rng.standard_normal((200, 6))
    inside /= np.maximum(np.linalg.norm(inside, axis=1, keepdims=True) / stability.radius.lower, 1e-300)
    assert np.max(ng.finger_forces(grasp, inside).used) <= 1.0


def test_two_hard_contacts_are_never_stable(rng):
    """Torque about their line is out of reach, whatever the friction; several tools say otherwise."""
    for friction in (0.1, 1.0, 10.0, 1e6):
        for _ in range(5):
            points = rng.standard_normal((2, 3))
            line = (points[1] - points[0]) / np.linalg.norm(points[1] - points[0])
            stability = ng.is_stable(ng.Grasp(points, [line, -line], ng.FrictionContact(friction)))
            assert not stability
            y = stability.separating_direction
            assert WrenchSet.of(ng.Grasp(points, [line, -line], ng.FrictionContact(friction))).support(
                np.stack([y, -y])
            )[0] == pytest.approx([0.0, 0.0], abs=1e-6)


@pytest.mark.parametrize(
    ("points", "normals", "contact"),
    [
        ([[0, 0, 1.0]], [[0, 0, -1.0]], ng.SoftContact(1.0, 1.0)),
        ([[0, 0, 1.0]], [[0, 0, -1.0]], ng.PointContact()),
        ([[0, 1.0]], [[0, -1.0]], ng.FrictionContact(1.0)),
        ([[0, 1.0], [0, -1.0]], [[0, -1.0], [0, 1.0]], ng.PointContact()),
        (np.eye(3), -np.eye(3), ng.PointContact()),
    ],
)
def test_too_few_contacts_are_not_stable_and_no_error(points, normals, contact):
    stability = ng.is_stable(ng.Grasp(points, normals, contact))
    assert not stability
    y = stability.separating_direction
    assert np.linalg.norm(y) == pytest.approx(1.0)
    assert WrenchSet.of(ng.Grasp(points, normals, contact)).support(y[None])[0][0] <= 1e-8


def test_bilateral_contacts_are_stable_exactly_with_full_rank(rng):
    """Proposition 2-7; and delta is then the smallest singular value, (3.1-1a)."""
    one = ng.BilateralContact(ng.FrictionContact(0.5))
    points = rng.standard_normal((3, 3))
    normals = np.eye(3)
    three = ng.Grasp(points, normals, one)
    assert ng.is_stable(three)
    bounds = ng.delta(three, rtol=0.005)
    sigma = ng.smallest_singular_value(three)
    assert bounds.lower <= sigma <= bounds.upper * (1 + 1e-9)
    assert bounds.upper == pytest.approx(sigma, rel=1e-4)
    assert not ng.is_stable(ng.Grasp(points[:2], normals[:2], one))


def test_example_2_11():
    """Correction 4: the grasp of Figure 3 is not stable with friction 1, and is with K = R^8."""
    contacts = [ng.PointContact(), ng.FrictionContact(1.0), ng.SoftContact(1.0, 1.0)]
    points, normals = [[0, 0, -1], [-1, 0, 0], [0, -1, 0]], np.eye(3)[[2, 0, 1]]
    stability = ng.is_stable(ng.Grasp(points, normals, contacts))
    assert not stability
    np.testing.assert_allclose(stability.separating_direction, np.array([-1, -1, 0, 0, 0, 0]) / np.sqrt(2.0), atol=1e-4)
    assert ng.is_stable(ng.Grasp(points, normals, [ng.BilateralContact(c) for c in contacts]))


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6))
def test_stability_is_invariant(seed):
    """Theorem 2-10: under body frames and torque origins, on grasps of either kind."""
    rng = np.random.default_rng(seed)
    grasp = ellipsoid_grasp(rng, k=4, friction=0.6)
    A, b = random_rotation(rng), rng.standard_normal(3)
    moved = ng.Grasp(grasp.points @ A.T, grasp.normals @ A.T, grasp.contacts, torque_origin=A @ b)
    original, moved_stability = ng.is_stable(grasp), ng.is_stable(moved)
    assert original.stable == moved_stability.stable
    if not original.stable:
        assert WrenchSet.of(moved).support(moved_stability.separating_direction[None])[0][0] <= 1e-7


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from(sorted(CONTACTS)))
def test_force_domains_are_convex_cones(seed, name):
    """Proposition 2-5 and Corollary 2-6: sums and multiples stay inside."""
    rng = np.random.default_rng(seed)
    contact = CONTACTS[name]
    x, y = contact.project(rng.standard_normal((2, 200, contact.components(3))))
    for z in (x + y, 3.7 * x):
        if is_pad(contact):  # no closed form: by a conic program of the test's own
            assert max(slack(contact, force) for force in z[:10]) <= 1e-9
        else:
            np.testing.assert_allclose(contact.project(z), z, atol=1e-9)


def test_products_of_cones_are_convex_cones(rng):
    """Corollary 2-6: of projections onto K, each part of a sum or a multiple is in its own cone by definition."""
    kinds = [contact for name, contact in CONTACTS.items() if name != "bilateral"]
    k = len(kinds)
    K = WrenchSet.of(ng.Grasp(rng.standard_normal((k, 3)), np.tile([0.0, 0.0, 1.0], (k, 1)), kinds))
    x, y = K.project(rng.standard_normal((2 * 300, K.G.shape[1]))).reshape(2, 300, -1)
    for z in (x, x + y, 3.7 * x):
        for contact, where in zip(kinds, K.ranges, strict=True):
            assert inside(contact, z[:, where], 1e-10).all()


@pytest.mark.parametrize("seed", range(30))
def test_measures_are_positive_for_stable_grasps_alone(seed):
    """Sections 3.1 and 3.3.2: delta > 0 and mu > 0 exactly where wrenches span the plane's, by a linear program."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform(0.0, 2.0 * np.pi, 2 + seed % 2)
    points, mu = np.stack([np.cos(angles), np.sin(angles)], axis=1), rng.uniform(0.2, 1.0)
    grasp = ng.Grasp(points, -points, ng.FrictionContact(mu))
    edges = np.concatenate([grasp.G[:, ::2] + s * mu * grasp.G[:, 1::2] for s in (1.0, -1.0)], axis=1)
    count = edges.shape[1]  # 0 is inside their hull: positive weights, the least of them as large as it may be
    A = np.vstack([np.hstack([edges, np.zeros((3, 1))]), [*np.ones(count), 0.0]])
    least = np.hstack([-np.eye(count), np.ones((count, 1))])
    solution = linprog([*np.zeros(count), -1.0], least, np.zeros(count), A, [0.0, 0.0, 0.0, 1.0])
    closed = solution.status == 0 and -solution.fun > 1e-6 and np.linalg.matrix_rank(edges) == 3
    measures = ng.delta(grasp), ng.mu(grasp, ng.TaskEllipsoid([2.0, 1.0, 0.5]))
    assert bool(ng.is_stable(grasp)) == closed
    assert all((bounds.lower > 0.0) == (bounds.upper > 1e-9) == closed for bounds in measures)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from(["l2", "per_finger", "shared"]))
def test_support_functions_are_those_of_the_image(seed, budget):
    """(3.4-5): phi(y | G(B ∩ K)) = phi(G^T y | B ∩ K), convex and homogeneous."""
    rng = np.random.default_rng(seed)
    grasp = ellipsoid_grasp(rng)
    wrenches = WrenchSet.of(grasp, budget)
    y, z = rng.standard_normal((2, 50, 6))
    phi = wrenches.support(y)[0]
    np.testing.assert_allclose(phi, wrenches.force_set.support(y @ grasp.G)[0])
    np.testing.assert_allclose(wrenches.support(2.5 * y)[0], 2.5 * phi)
    assert np.all(wrenches.support(y + z)[0] <= phi + wrenches.support(z)[0] + 1e-12)


def test_allowed_twists_do_no_work(rng):
    """Theorem 2-1: a hinge of two hard contacts turns about their line and nothing else."""
    grasp = ng.Grasp([[1, 0, 0], [-1, 0, 0]], [[-1, 0, 0], [1, 0, 0]], ng.FrictionContact(0.5))
    twists = ng.allowed_twists(grasp)
    np.testing.assert_allclose(np.abs(twists), [[0, 0, 0, 1, 0, 0]], atol=1e-12)
    wrenches = rng.standard_normal((3, 6)) * np.array([1, 1, 1, 1e-3, 1e-3, 1e-3])
    twists = ng.allowed_twists(wrenches)
    assert twists.shape == (3, 6)
    np.testing.assert_allclose(twists @ wrenches.T, 0.0, atol=1e-12)
    np.testing.assert_allclose(twists @ twists.T, np.eye(3), atol=1e-12)
    assert ng.allowed_twists(np.eye(3)).shape == (0, 3)
    with pytest.raises(ng.InputError, match="rows of length 3"):
        ng.allowed_twists(np.eye(4))
