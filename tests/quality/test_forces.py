"""Least finger forces against published numbers and a conic solver, and infeasible wrenches."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.quality import WrenchSet
from tests.memberships import is_pad, slack
from tests.quality.test_mu import least_force
from tests.quick import first
from tests.samples import EVERY as CONTACTS
from tests.samples import closed_ellipsoid_grasp, ellipsoid_grasp


def lobo_grasp():
    """The `grasp` problem of Vanderbei's collection (Lobo, Vandenberghe, Boyd and Lebret 1998)."""
    angles = 2.0 * np.pi * np.arange(1, 6) / 5.0
    points = np.stack([0.3 + np.cos(angles), np.sin(angles), np.zeros(5)], axis=1)
    points[:, 2] = np.sum(points[:, :2] ** 2, axis=1)
    normals = np.stack([-2.0 * points[:, 0], -2.0 * points[:, 1], np.ones(5)], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return ng.Grasp(points, normals, ng.FrictionContact(0.3))


@pytest.mark.parametrize(
    ("budget", "expected"),
    [("per_finger", 0.49108896), ("per_finger_size", 0.512712), ("shared", 1.473970), ("l2", 0.811718)],
)
def test_published_grasp_force_optimisation(budget, expected):
    """The load (0, 0, -1) is held by the wrench (0, 0, 1) of the fingers; no torque about the world's origin."""
    grasp, wrench = lobo_grasp(), [0, 0, 1.0, 0, 0, 0]
    result = ng.finger_forces(grasp, wrench, force_budget=budget)
    assert result.feasible[0]
    assert result.used[0] == pytest.approx(expected, abs=1e-8 if budget == "per_finger" else 5e-7)
    np.testing.assert_allclose(grasp.G @ result.forces[0], wrench, atol=1e-9)
    np.testing.assert_allclose(WrenchSet.of(grasp).project(result.forces), result.forces, atol=1e-8)


@pytest.mark.parametrize("budget", ["per_finger", "per_finger_size", "shared", "l2"])
def test_no_direction_shows_that_less_would_do(budget, rng):
    """Weak duality: <w, y> <= used phi(y) for every y, with equality in some direction."""
    grasp = closed_ellipsoid_grasp(rng)
    wrenches = rng.standard_normal((5, 6))
    used = ng.finger_forces(grasp, wrenches, force_budget=budget).used
    y = rng.standard_normal((20000, 6))
    ratio = wrenches @ y.T / WrenchSet.of(grasp, budget).support(y)[0]
    assert np.all(ratio <= used[:, None] * (1 + 1e-9))
    assert np.all(ratio.max(axis=1) >= 0.3 * used)


def test_joint_torque_limits_are_kept(rng):
    grasp = closed_ellipsoid_grasp(rng, k=3)
    budget = ng.JointTorqueLimits([rng.standard_normal((3, 3)) for _ in range(3)], 1.0)
    result = ng.finger_forces(grasp, rng.standard_normal((4, 6)), force_budget=budget)
    assert result.feasible.all()
    for x, used in zip(result.forces, result.used, strict=True):
        force = grasp.contact_wrenches(x)[:, :3]
        torques = [J.T @ f for J, f in zip(budget.jacobians, force, strict=True)]
        assert np.max(np.abs(torques)) == pytest.approx(used)


@pytest.mark.parametrize("name", [n for n in CONTACTS if n not in ("point", "line", "disc")])
def test_forces_produce_their_wrenches_from_inside_the_cones(name, rng):
    grasp = closed_ellipsoid_grasp(rng)
    grasp = ng.Grasp(grasp.points, grasp.normals, CONTACTS[name])
    wrenches = rng.standard_normal((200, 6))
    result = ng.finger_forces(grasp, wrenches)
    assert result.feasible.all()
    assert np.max(result.residual) <= 1e-9
    np.testing.assert_allclose(result.forces @ grasp.G.T, wrenches, atol=1e-9)
    per_contact = result.forces.reshape(200 * 4, -1)
    if is_pad(CONTACTS[name]):  # no closed form: by a conic program of the test's own
        assert max(slack(CONTACTS[name], x) for x in per_contact[::4]) <= 1e-8
    else:
        np.testing.assert_allclose(CONTACTS[name].project(per_contact), per_contact, atol=1e-9)
    assert np.isnan(result.separating_directions).all()


def test_mixed_contacts(rng):
    grasp = closed_ellipsoid_grasp(rng, k=5)
    grasp = ng.Grasp(grasp.points, grasp.normals, [*list(CONTACTS.values())[:4], CONTACTS["rough disc"]])
    wrenches = rng.standard_normal((50, 6))
    result = ng.finger_forces(grasp, wrenches)
    assert result.feasible.all()
    np.testing.assert_allclose(result.forces @ grasp.G.T, wrenches, atol=1e-9)


def test_forces_are_the_least_by_a_conic_solver(rng):
    grasp = closed_ellipsoid_grasp(rng)
    wrenches = rng.standard_normal((20, 6))
    result = ng.finger_forces(grasp, wrenches)
    expected = [least_force(grasp, w) for w in wrenches]
    np.testing.assert_allclose(result.used, expected, rtol=1e-6)


@pytest.mark.parametrize("seed", first(3, range(10)))
def test_ten_thousand_wrenches_to_1e_9(seed):
    rng = np.random.default_rng(seed)
    grasp = closed_ellipsoid_grasp(rng)
    wrenches = rng.standard_normal((10_000, 6))
    result = ng.finger_forces(grasp, wrenches)
    assert result.feasible.all()
    assert np.max(np.linalg.norm(result.forces @ grasp.G.T - wrenches, axis=1)) <= 1e-9
    assert np.max(result.residual) <= 1e-9


def test_wrenches_out_of_reach_are_said_to_be():
    grasp = ng.Grasp([[1, 0, 0], [-1, 0, 0]], [[-1, 0, 0], [1, 0, 0]], ng.FrictionContact(0.5))
    result = ng.finger_forces(grasp, np.array([[0, 0, 0, 1.0, 0, 0], [0, 0, 1.0, 0, 0, 0]]))
    assert result.feasible.tolist() == [False, True]
    np.testing.assert_allclose(np.abs(result.separating_directions[0]), [0, 0, 0, 1, 0, 0], atol=1e-12)
    assert result.used.tolist() == [np.inf, pytest.approx(np.sqrt(2.5))]


@pytest.mark.parametrize("seed", first(3, range(8)))
def test_feasibility_agrees_with_a_conic_solver_and_is_proven(seed):
    """Grasps that are not closed reach some wrenches only; a separating direction works for the others."""
    rng = np.random.default_rng(seed)
    grasp = ellipsoid_grasp(rng, k=3, friction=0.4)
    wrenches = np.concatenate([rng.standard_normal((12, 6)), np.abs(rng.standard_normal((12, 9))) @ grasp.G.T])
    result = ng.finger_forces(grasp, wrenches)
    expected = np.array([np.isfinite(least_force(grasp, w)) for w in wrenches])
    np.testing.assert_array_equal(result.feasible, expected)
    for w, y in zip(wrenches[~result.feasible], result.separating_directions[~result.feasible], strict=True):
        assert w @ y > 0.0
        assert WrenchSet.of(grasp).support(y[None])[0][0] <= 1e-6


def test_nothing_asked_nothing_used(rng):
    result = ng.finger_forces(closed_ellipsoid_grasp(rng), np.zeros((1, 6)))
    assert result.feasible[0]
    assert not result.forces.any()
    assert ng.finger_forces(closed_ellipsoid_grasp(rng), np.zeros((0, 6))).forces.shape == (0, 12)


@pytest.mark.parametrize("wrenches", [[1.0, 2.0], [[np.nan] * 6], np.zeros((2, 3)), "push"])
def test_wrenches_that_make_no_sense_are_refused(wrenches, rng):
    with pytest.raises(ng.InputError, match="wrenches"):
        ng.finger_forces(closed_ellipsoid_grasp(rng), wrenches)


def test_forces_of_pads_at_the_edge_of_their_friction_are_the_least():
    normal = np.array([0.8819213089994025, 0.4713966532897539, 0.0])
    points = [
        [-0.01476122386767098, -0.006161939065209692, 0.05661694516288713],
        [0.013324363345977842, 0.008850116639865206, 0.056616945162887414],
    ]
    pad = ng.PlaneContact(extents=(0.02, 0.012), friction=0.5, direction=(0, 0, -1))
    grasp = ng.Grasp(points, [normal, -normal], pad, torque_origin=[0.0, 0.0, 0.026857141793390955])
    wrench = [
        *(1.2032314903249768, -2.403701002341299, 4.143232786628172),
        *(-0.005642430163249058, -0.0028795221972666048, 0.0001568557047059856),
    ]
    used = ng.finger_forces(grasp, wrench, force_budget="shared").used[0]
    assert used == pytest.approx(15.885612337, rel=1e-8)  # proved by weak duality
