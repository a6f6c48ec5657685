"""Manipulability against closed forms, least squares and MuJoCo's kinematics."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.analysis.manipulability import Transmission, body_transmission, contact_jacobian
from nlpgrasp.solution.solution import GraspSolution
from tests.hands.urdf import four_finger_hand

KINDS = [ng.PointContact(), ng.FrictionContact(0.5), ng.SoftContact(0.5, 0.01)]


def two_links(l1, l2, q1, q2):
    """Return the Jacobian of a planar finger with two turning joints, (2, 2)."""
    a, b = q1, q1 + q2
    return np.array(
        [[-l1 * np.sin(a) - l2 * np.sin(b), -l2 * np.sin(b)], [l1 * np.cos(a) + l2 * np.cos(b), l2 * np.cos(b)]]
    )


@pytest.mark.parametrize("q2", [0.3, 1.0, 2.0, -1.2])
def test_two_links_have_yoshikawas_measure(q2):
    finger = Transmission(two_links(0.05, 0.03, 0.7, q2), 1.0, 2)
    assert finger.measure == pytest.approx(0.05 * 0.03 * abs(np.sin(q2)), rel=1e-12)


def test_two_links_are_isotropic_where_salisbury_and_craig_say():
    """Lengths sqrt(2) and 1, the second joint at 135 degrees."""
    finger = Transmission(two_links(np.sqrt(2.0), 1.0, 0.2, 0.75 * np.pi), 1.0, 2)
    assert finger.isotropy == pytest.approx(1.0)
    assert finger.condition == pytest.approx(1.0)
    straight = Transmission(two_links(1.0, 1.0, 0.2, 0.0), 1.0, 2)
    assert straight.measure == 0.0
    assert straight.condition == np.inf
    assert straight.rank == 1


def test_a_straight_finger_bears_what_is_along_it():
    straight = Transmission(two_links(0.05, 0.03, 0.0, 0.0), 1.0, 2)
    assert straight.velocity_ratio([1.0, 0.0]) == 0.0
    assert straight.force_ratio([1.0, 0.0]) == np.inf
    assert straight.force_ratio([0.0, 1.0]) == pytest.approx(1.0 / np.hypot(0.08, 0.03))
    assert straight.velocity_ratio([0.0, 1.0]) == pytest.approx(np.hypot(0.08, 0.03))
    assert np.isinf(straight.force_axes).any()
    assert straight.velocity_axes.shape == (2, 2)


def free_fingers(seed, kind=1, k=3):
    """Return a random grasp, and the Jacobians of fingers whose joints move each contact along all three axes."""
    rng = np.random.default_rng(seed)
    points = 0.03 * rng.standard_normal((k, 3))
    normals = rng.standard_normal((k, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    jacobians = np.zeros((k, 6, 3 * k))
    for i in range(k):
        jacobians[i, :3, 3 * i : 3 * i + 3] = np.eye(3)
    return ng.Grasp(points, normals, KINDS[kind]), jacobians


@pytest.mark.parametrize("seed", range(4))
def test_fingers_that_move_freely_move_the_body_as_the_grasp_map_says(seed):
    """J_h is orthogonal, so that rates of size 1 are the twists with |G^T nu| <= 1."""
    grasp, jacobians = free_fingers(seed)
    body = body_transmission(grasp, contact_jacobian(grasp, jacobians), 0.03)
    scaled = grasp.G / np.array([1, 1, 1, 0.03, 0.03, 0.03])[:, None]
    np.testing.assert_allclose(body.singular_values, 1.0 / np.linalg.svd(scaled)[1][::-1], rtol=1e-9)


@pytest.mark.parametrize("kind", [0, 1, 2])
@pytest.mark.parametrize("seed", range(3))
def test_least_torques_are_those_of_least_squares(seed, kind):
    """All contact forces x and torques J_h^T x that exert a wrench: the least of them by the normal equations."""
    rng = np.random.default_rng(seed)
    grasp, _ = free_fingers(seed, kind)
    J_h = contact_jacobian(grasp, 0.05 * rng.standard_normal((3, 6, 9)))
    body = body_transmission(grasp, J_h, 0.03)
    inner = np.linalg.svd(grasp.G)[2][np.linalg.matrix_rank(grasp.G) :].T
    for _ in range(5):
        wrench = grasp.G @ rng.standard_normal(grasp.G.shape[1])
        x = np.linalg.pinv(grasp.G) @ wrench
        if inner.shape[1]:
            x = x - inner @ np.linalg.lstsq(J_h.T @ inner, J_h.T @ x, rcond=None)[0]
        assert 1.0 / body.force_ratio(wrench) == pytest.approx(np.linalg.norm(J_h.T @ x), rel=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_twists_of_the_ellipsoid_are_reached_with_all_contacts_kept(seed):
    rng = np.random.default_rng(seed)
    grasp, _ = free_fingers(seed)
    J_h = contact_jacobian(grasp, 0.05 * rng.standard_normal((3, 6, 8)))  # fewer joints than components: mobility 5
    body = body_transmission(grasp, J_h, 0.03)
    assert body.rank == 5
    twist = body.matrix @ rng.standard_normal(body.matrix.shape[1])
    rates, *_ = np.linalg.lstsq(J_h, grasp.G.T @ twist, rcond=None)
    np.testing.assert_allclose(J_h @ rates, grasp.G.T @ twist, atol=1e-9)
    assert 1.0 / body.velocity_ratio(twist) == pytest.approx(np.linalg.norm(rates), rel=1e-6)
    assert body.velocity_ratio(rng.standard_normal(6)) == 0.0


@pytest.fixture(scope="module")
def hand_and_solution():
    """Return a hand and a solution with its contacts where the hand's fingertips are, not searched for."""
    hand = four_finger_hand()
    values = {name: v[0] for name, v in hand.draw(1, np.zeros((1, 3)), np.random.default_rng(5))[0].items()}
    points = hand.draw(1, np.zeros((1, 3)), np.random.default_rng(5))[1][0]
    normals = -points / np.linalg.norm(points, axis=1)[:, None]
    grasp = ng.Grasp(points, normals, ng.FrictionContact(0.5))
    return hand, GraspSolution(ng.Status.SOLVED, "held", {}, grasp, hand=hand.describe(values))


def test_a_hand_moves_the_body(hand_and_solution):
    hand, solution = hand_and_solution
    measures = ng.manipulability(solution, hand)
    assert measures.mobility == 6
    assert measures.manipulable
    assert measures.hand_jacobian.shape == (12, len(hand.loaded_joints))
    assert measures.measure > 0.0
    assert 0.0 < measures.isotropy < 1.0
    for finger in measures.fingers:
        assert len(finger.joints) == 4
        J = finger.velocity.matrix
        assert finger.measure == pytest.approx(np.sqrt(np.linalg.det(J @ J.T)), rel=1e-9)
    twist = np.array([0.3, -0.2, 0.5, 1.0, -2.0, 0.7])
    rates, *_ = np.linalg.lstsq(measures.hand_jacobian, solution.grasp.G.T @ twist, rcond=None)
    np.testing.assert_allclose(measures.hand_jacobian @ rates, solution.grasp.G.T @ twist, atol=1e-9)
    assert 1.0 / measures.body.velocity_ratio(twist) == pytest.approx(np.linalg.norm(rates), rel=1e-6)
    assert measures.internal == len(measures.joints) - np.linalg.matrix_rank(measures.hand_jacobian)
    assert "the joints move the body in 6 of 6 ways" in str(measures)
    assert measures.to_dict()["mobility"] == 6


def test_single_directions_do_not_depend_on_the_torque_scale(hand_and_solution):
    hand, solution = hand_and_solution
    small, large = (ng.manipulability(solution, hand, torque_scale=scale) for scale in (0.01, 1.0))
    w = [1.0, 2.0, 3.0, 0.01, 0.02, 0.03]
    assert small.body.force_ratio(w) == pytest.approx(large.body.force_ratio(w), rel=1e-9)
    assert small.body.velocity_ratio(w) == pytest.approx(large.body.velocity_ratio(w), rel=1e-6)
    assert small.mobility == large.mobility
    assert small.isotropy != large.isotropy


def test_free_fingertips_move_the_body_as_far_as_their_rates_allow(hand_and_solution):
    """Twists with ``|G^T nu| <= 1``: the polar of the ellipsoid of wrenches of (3.2-2)."""
    _, solution = hand_and_solution
    free = ng.manipulability(solution, torque_scale=0.05)
    assert free.manipulable
    assert (free.fingers, free.internal, len(free.joints)) == ((), 0, 12)
    scaled = np.diag([1, 1, 1, 20, 20, 20]) @ solution.grasp.G
    np.testing.assert_allclose(free.body.singular_values, 1.0 / np.linalg.svd(scaled)[1][::-1], rtol=1e-9)


def test_bad_input_is_one_sentence(hand_and_solution):
    hand, solution = hand_and_solution
    with pytest.raises(ng.InputError, match="solution: got 3, expected a GraspSolution"):
        ng.manipulability(3, hand)
    with pytest.raises(ng.InputError, match=r"hand: got ParallelJaw.* expected a hand with joints"):
        ng.manipulability(solution, ng.ParallelJaw(0.08))
    with pytest.raises(ng.InputError, match="torque_scale: got 0"):
        ng.manipulability(solution, hand, torque_scale=0)
    without = GraspSolution(ng.Status.SOLVED, "held", {}, solution.grasp)
    with pytest.raises(ng.InputError, match="solution: got no hand in its grasp"):
        ng.manipulability(without, hand)
    three = ng.Grasp(solution.grasp.points[:3], solution.grasp.normals[:3], ng.FrictionContact(0.5))
    fewer = GraspSolution(ng.Status.SOLVED, "held", {}, three, hand=solution.hand)
    with pytest.raises(ng.InputError, match="hand: got 4 fingertips, expected 3"):
        ng.manipulability(fewer, hand)
    with pytest.raises(ng.InputError, match=r"wrench: .* other than zero"):
        ng.manipulability(solution, hand).body.force_ratio(np.zeros(6))
