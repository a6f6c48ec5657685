"""Balanced forces of least friction: closed forms, a linear program, contact models, infeasible cases."""

import numpy as np
import pytest
from scipy.optimize import linprog

import nlpgrasp as ng
from nlpgrasp.quality.least_friction import TOTAL_LIMIT, balanced_forces

ROUGH = ng.FrictionContact(0.5)
ANGLES = 2.0 * np.pi / 3.0 * np.arange(3)
CIRCLE = np.stack([np.cos(ANGLES), np.sin(ANGLES), np.zeros(3)], axis=1)
OPPOSING = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])


def wedge(half_angle, contact=ROUGH):
    c, s = np.cos(half_angle), np.sin(half_angle)
    return ng.Grasp(0.03 * OPPOSING, [[-c, s, 0.0], [c, s, 0.0]], contact)


@pytest.mark.parametrize("grasp", [ng.Grasp(OPPOSING, -OPPOSING, ROUGH), ng.Grasp(CIRCLE, -CIRCLE, ROUGH)])
def test_opposing_fingers_need_no_friction(grasp):
    result = ng.squeeze(grasp, 3.0)
    np.testing.assert_allclose(result.normal, 3.0, rtol=1e-6)
    assert result.friction_needed < 1e-6
    assert result.share < 1e-5
    assert result.residual < 1e-12
    assert result.joints is None


@pytest.mark.parametrize("half_angle", [0.1, 0.3, 0.45])
def test_a_wedge_needs_the_tangent_of_its_half_angle(half_angle):
    result = ng.squeeze(wedge(half_angle), 2.0)
    assert result.friction_needed == pytest.approx(np.tan(half_angle), rel=1e-5)
    assert result.share == pytest.approx(np.tan(half_angle) / 0.5, rel=1e-5)
    np.testing.assert_allclose(result.normal, 2.0, rtol=1e-6)


@pytest.mark.parametrize("model", ["box", "elliptic"])
def test_two_soft_fingers_carry_half_the_weight_each(model):
    grasp = ng.Grasp(0.03 * OPPOSING, -OPPOSING, ng.SoftContact(0.6, 0.01, model=model))
    result = ng.squeeze(grasp, 2.0, gravity=0.3)
    half = 0.5 * 0.3 * 9.81
    np.testing.assert_allclose(result.forces[:, 2], half, rtol=1e-9)  # up, on the body
    np.testing.assert_allclose(result.wrench, [0.0, 0.0, 2.0 * half, 0.0, 0.0, 0.0])
    # friction 0.6 takes half / 0.6 of each finger at least, and twice that is what the fingers may press
    np.testing.assert_allclose(result.normal, TOTAL_LIMIT * half / 0.6, rtol=1e-5)
    assert result.friction_needed == pytest.approx(0.3, rel=1e-5)
    sideways = ng.squeeze(grasp, 2.0, gravity=0.3, up=[0.0, 2.0, 0.0])
    np.testing.assert_allclose(sideways.forces[:, 1], half, rtol=1e-9)
    stated = ng.squeeze(grasp, 2.0, gravity=result.wrench)
    np.testing.assert_allclose(stated.forces, result.forces, atol=1e-9)


def least_ratio(grasp, wrench, normal_force):
    """The least ratio in the plane, where cones are two half-planes: bisection of linear programs by HiGHS."""
    k, n = len(grasp), grasp.G.shape[1]
    press = np.eye(n)[::2]

    def feasible(ratio, total=np.inf, cost=None):
        across = np.eye(n)[1::2]
        rows = [across - ratio * press, -across - ratio * press, -press, press.sum(axis=0)[None]]
        right = [np.zeros(2 * k), np.full(k, -normal_force), [min(total, 1e9)]]
        c = np.zeros(n) if cost is None else cost
        return linprog(c, np.concatenate(rows), np.concatenate(right), grasp.G, wrench, (None, None))

    least = feasible(grasp.contacts[0].friction, cost=press.sum(axis=0))
    low, high = 0.0, grasp.contacts[0].friction
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if feasible(middle, TOTAL_LIMIT * least.fun).status == 0 else (middle, high)
    return high


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("weight", [0.0, 3.0])
def test_the_ratio_is_that_of_linear_programs(seed, weight):
    rng = np.random.default_rng(seed)
    angles = np.array([0.0, 0.35, 0.7]) * 2.0 * np.pi + rng.uniform(-0.3, 0.3, 3)
    points = 0.03 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    normals = -points / 0.03 + 0.2 * rng.standard_normal((3, 2))
    grasp = ng.Grasp(points, normals / np.linalg.norm(normals, axis=1)[:, None], ng.FrictionContact(0.9))
    wrench = np.array([0.0, weight, 0.0])
    balance = balanced_forces(grasp, wrench, 2.0)
    assert balance.share * 0.9 == pytest.approx(least_ratio(grasp, wrench, 2.0), abs=1e-5)
    np.testing.assert_allclose(grasp.G @ balance.x, wrench, atol=1e-9)


@pytest.mark.parametrize(
    "contact",
    [
        ROUGH,
        ng.SoftContact(0.5, 0.004),
        ng.SoftContact(0.5, 0.004, model="elliptic"),
        ng.LineContact(0.02, 0.5, direction=[0.0, 0.0, 1.0]),
        ng.LineContact(0.02, 0.5, direction=[0.0, 0.0, 1.0], model="box"),
        ng.PlaneContact(extents=[0.02, 0.01], friction=0.5, direction=[0.0, 0.0, 1.0]),
        ng.PlaneContact(radius=0.01, friction=0.5),
    ],
)
def test_forces_are_in_the_cones_with_that_share_of_friction(contact, rng):
    directions = CIRCLE[[0, 1, 2, 0]] * [1.0, 1.0, 1.0] + 0.3 * rng.standard_normal((4, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    grasp, wrench = ng.Grasp(0.03 * directions, -directions, contact), np.array([0.2, 0.0, 1.0, 0.0, 0.01, 0.0])
    balance = balanced_forces(grasp, wrench, 1.5)
    least = contact.with_friction(balance.share * (1.0 + 1e-5) + 1e-6)
    parts = balance.x.reshape(4, -1)
    np.testing.assert_allclose(least.project(parts), parts, atol=1e-5)
    assert np.min(parts[:, 0]) >= 1.5 - 1e-9
    np.testing.assert_allclose(grasp.G @ balance.x, wrench, atol=1e-9)
    less = contact.with_friction(0.99 * balance.share)
    assert np.max(np.abs(less.project(parts) - parts)) > 1e-5


def test_contacts_without_friction_and_that_pull():
    grasp = ng.Grasp(CIRCLE, -CIRCLE, [ng.PointContact(), ng.BilateralContact(ROUGH), ROUGH])
    result = ng.squeeze(grasp, 1.0)
    np.testing.assert_allclose(result.normal, 1.0, rtol=1e-6)
    assert result.available == (None, None, 0.5)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: ng.squeeze(wedge(0.6)),
            r"contacts 0, 1 cannot press.*friction at least 1.37 times as large \(0.684 in",
        ),
        (
            lambda: ng.squeeze(
                ng.Grasp([[1, 0, 0], [0, 1, 0], [-1, 0, 0]], [[-1, 0, 0], [0, -1, 0], [1, 0, 0]], ng.PointContact())
            ),
            "contact 1 cannot press, expected a grasp whose contacts balance",
        ),
        (
            lambda: ng.squeeze(ng.Grasp(OPPOSING, -OPPOSING, ROUGH), gravity=[0, 0, 0, 1, 0, 0]),
            "none that carry the wrench",
        ),
        (lambda: ng.squeeze(wedge(0.1), 0.0), "normal_force.*greater than 0"),
        (lambda: ng.squeeze(wedge(0.1), gravity=[1.0, 0.0]), r"gravity.*shape \(6,\)"),
        (lambda: ng.squeeze(wedge(0.1), gravity=-1.0), "gravity.*at least 0"),
        (lambda: ng.squeeze(wedge(0.1), gravity=1.0, up=[0, 0, 0]), "up.*a direction"),
        (lambda: ng.squeeze(wedge(0.1), gain=2.0), "gain.*a hand whose joints are known"),
        (lambda: ng.squeeze(wedge(0.1)).positions(2.0), "no joints"),
    ],
)
def test_what_is_impossible_is_one_sentence(make, message):
    with pytest.raises(ng.InputError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)
