"""One-sided rates of mu against certified mu a little further, and against a closed form."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.solution.solution import GraspSolution
from tests.hands.urdf import four_finger_hand

ELLIPSOID = ng.Ellipsoid([0.04, 0.03, 0.025])
TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])


def solved(body, points, face, contacts, task, budget="l2", **more):
    """Return a solution that was not searched for."""
    points = np.array(points, float)
    normals = -body.evaluate(face, points)[2]
    problem = ng.GraspProblem(body, contacts, task, force_budget=budget, name="given")
    grasp = ng.Grasp(points, normals, contacts, problem.origin)
    bounds = ng.mu(grasp, task, 1e-3, force_budget=budget)
    return GraspSolution(
        ng.Status.SOLVED, "given", problem.to_dict(), grasp, (face,) * len(points), bounds, task.measure, **more
    )


def on_ellipsoid(seed, budget="l2"):
    rng = np.random.default_rng(seed)
    for _ in range(200):
        points = ELLIPSOID.sample("surface", 4, rng)
        solution = solved(ELLIPSOID, points, "surface", [ng.SoftContact(0.6, 0.004)] * 4, TASK, budget)
        if solution.mu.lower > 0.02:
            return solution
    raise AssertionError("no grasp")


def certified_change(solution, budget, points=None, contacts=None):
    """Return bounds on the change of mu, from two certificates."""
    grasp = solution.grasp
    points = grasp.points if points is None else ELLIPSOID.snap("surface", points)
    normals = -ELLIPSOID.evaluate("surface", points)[2]
    changed = ng.Grasp(points, normals, contacts or list(grasp.contacts), grasp.torque_origin)
    initial, final = (ng.mu(g, TASK, 2e-5, force_budget=budget) for g in (grasp, changed))
    return final.lower - initial.upper, final.upper - initial.lower


def agree(rate, step, change, solution):
    """Assert that the rate times the step is the change, to a twentieth and what the certificates leave open."""
    slack = 0.05 * abs(rate) * step + 1e-4 * solution.mu.upper
    assert change[0] - slack <= rate * step <= change[1] + slack


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow)])
def test_rates_are_those_of_certified_mu(seed):
    solution = on_ellipsoid(seed)
    rates = ng.mu_rates(solution)
    grasp, step = solution.grasp, 1e-4
    for place in ((0, 0), (2, 1)):
        rate = rates.contacts[2 * place[0] + place[1]]
        assert rate.name == f"contact {place[0]} along tangent {place[1]}"
        for sign, slope in ((1.0, rate.more), (-1.0, rate.less)):
            points = np.array(grasp.points)
            points[place[0]] += sign * step * grasp.tangents[place[0], place[1]]
            agree(slope, step, certified_change(solution, "l2", points), solution)
    friction = rates.coefficients[0]
    assert friction.name == "contact 0, friction"
    assert friction.more >= 0.0 >= friction.less
    less = [ng.SoftContact(0.598, 0.004), *[ng.SoftContact(0.6, 0.004)] * 3]
    agree(friction.less, 0.002, certified_change(solution, "l2", contacts=less), solution)


def square(depth):
    """Return two fingers on a square whose side is as long as 2, pushed against each other at this height."""
    body = ng.Polygon([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    points, normals = np.array([[-1.0, depth], [1.0, depth]]), np.array([[1.0, 0.0], [-1.0, 0.0]])
    task = ng.TaskPolytope([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    problem = ng.GraspProblem(
        body, [ng.FrictionContact(0.5)] * 2, task, force_budget="per_finger", torque_origin=[0, 0]
    )
    grasp = ng.Grasp(points, normals, list(problem.models), [0.0, 0.0])
    faces = (body.face_names[3], body.face_names[1])
    bounds = ng.mu(grasp, task, force_budget="per_finger")
    return GraspSolution(ng.Status.SOLVED, "square", problem.to_dict(), grasp, faces, bounds, task.measure)


def test_two_fingers_that_lift_lose_nothing_by_friction_but_its_share():
    """Each finger lifts friction times its unit of normal force, so that mu = 2 friction; the weaker finger counts.

    Its torque is balanced by the other, which cannot lift more than it does: less friction of either costs 2 per unit,
    more friction of one buys nothing. Infinitely many directions are the weakest here.
    """
    solution = square(0.0)
    assert 1.0 in solution.mu
    rates = ng.mu_rates(solution)
    for rate in rates.coefficients:
        assert rate.less == pytest.approx(-2.0, rel=1e-3)
        assert rate.more == pytest.approx(0.0, abs=1e-3)
        assert not rate.smooth


def test_certified_mean_rates_contain_those_of_the_closed_form():
    """Fingers of a square: -1 per metre off each other's line both ways, -2 per unit of lost friction, 0 of more."""
    rates = ng.mu_rates(square(0.0), step=0.04)
    for rate, more, less, step in [(rates.contacts[0], -1.0, -1.0, 0.04), (rates.coefficients[1], 0.0, -2.0, 0.02)]:
        assert rate.step == pytest.approx(step)
        for mean, expected in ((rate.mean_more, more), (rate.mean_less, less)):
            assert expected in mean
            assert mean.upper - mean.lower < 1.1e-3 * 2.0 / step  # two widths of mu near 1, over the step
        assert rate.to_dict()["mean_less"] == {"lower": rate.mean_less.lower, "upper": rate.mean_less.upper}
        assert f"certified over {step:.3g}" in str(rate)


def test_certified_mean_rates_agree_with_sharper_certificates():
    """The mean rate itself is in both intervals."""
    solution = on_ellipsoid(0)
    rates, grasp = ng.mu_rates(solution), solution.grasp
    for index in (0, 3):
        rate, (contact, axis) = rates.contacts[index], divmod(index, 2)
        for sign, mean in ((1.0, rate.mean_more), (-1.0, rate.mean_less)):
            points = np.array(grasp.points)
            points[contact] += sign * rate.step * grasp.tangents[contact, axis]
            low, high = certified_change(solution, "l2", points)
            assert mean.lower <= high / rate.step
            assert mean.upper >= low / rate.step
            assert mean.upper - mean.lower < 0.3  # of rates of 11 and 7 per metre


def test_without_a_step_there_are_no_certified_mean_rates():
    rates = ng.mu_rates(square(0.0), step=None)
    assert all(rate.mean_more is None and rate.mean_less is None for rate in rates.rates)
    assert "certified" not in str(rates)
    assert set(rates.contacts[0].to_dict()) == {"name", "unit", "more", "less"}


def test_mu_at_a_kink_falls_both_ways():
    """Opposite fingers on a disc: whichever way one of them goes, the pair no longer faces each other."""
    body = ng.PlanarImplicit(lambda p: p[0] ** 2 + p[1] ** 2 - 1.0, [[-1.1, -1.1], [1.1, 1.1]])
    contacts, task = [ng.FrictionContact(0.5)] * 2, ng.TaskEllipsoid([1.0, 1.0, 1.0])
    solution = solved(body, [[1.0, 0.0], [-1.0, 0.0]], body.face_names[0], contacts, task)
    rates = ng.mu_rates(solution, body)
    assert all(rate.more < 0.0 and rate.less < 0.0 for rate in rates.contacts)
    assert rates.worst_contact.worst == max(max(-r.more, -r.less) for r in rates.contacts)
    assert set(rates.to_dict()) == {"mu", "contacts", "coefficients", "joints", "directions"}
    assert str(rates).count("\n") == 2 + 2


def test_beside_a_kink_a_rate_has_the_sign_of_the_change():
    """Beside the best place one way is better, though a direction is nearly as weak that loses on both ways."""
    body = ng.PlanarImplicit(lambda p: p[0] ** 2 + p[1] ** 2 - 1.0, [[-1.1, -1.1], [1.1, 1.1]])
    contacts, task, angle = [ng.FrictionContact(0.5)] * 2, ng.TaskEllipsoid([1.0, 1.0, 1.0]), np.pi + 1e-3

    def grasp_at(angle):
        points = [[1.0, 0.0], [np.cos(angle), np.sin(angle)]]
        return solved(body, points, body.face_names[0], contacts, task)

    solution = grasp_at(angle)
    rate = ng.mu_rates(solution, body).contacts[1]
    tied = ng.mu_rates(solution, body, almost=0.01).contacts[1]
    assert tied.more < 0.0
    assert tied.less < 0.0
    assert {rate.more > 0.0, rate.less > 0.0} == {True, False}
    tangent = solution.grasp.tangents[1, 0]
    way = float(np.sign(tangent @ [-np.sin(angle), np.cos(angle)]))
    step = 2e-4
    for sign, slope in ((1.0, rate.more), (-1.0, rate.less)):
        changed = ng.mu(grasp_at(angle + sign * way * step).grasp, task, 1e-6)
        now = ng.mu(solution.grasp, task, 1e-6)
        assert slope * step == pytest.approx(changed.lower - now.lower, rel=0.02)


@pytest.mark.slow
def test_a_joint_carries_its_contact_along():
    """The rate of a joint is that of the contact's own displacement, by the chain rule where mu is smooth."""
    hand, rng = four_finger_hand(), np.random.default_rng(3)
    values = {name: v[0] for name, v in hand.draw(1, np.zeros((1, 3)), rng)[0].items()}
    plain = on_ellipsoid(0)
    posture = hand.describe(values)
    solution = GraspSolution(
        plain.status, plain.name, plain.problem, plain.grasp, plain.faces, plain.mu, plain.kind, hand=posture
    )
    rates = ng.mu_rates(solution, hand=hand, almost=1e-9)
    assert [rate.name for rate in rates.joints] == list(hand.loaded_joints)
    J = hand.contact_jacobians(values, solution.grasp.points)[:, :3]
    y = rates.directions
    assert len(y) == 1  # so that mu is smooth here
    slopes = np.array([rate.more for rate in rates.contacts]).reshape(4, 2)
    moved = np.einsum("ktc,kcm->ktm", solution.grasp.tangents, J)
    expected = np.einsum("kt,ktm->m", slopes, moved)
    np.testing.assert_allclose([rate.more for rate in rates.joints], expected, rtol=1e-3, atol=1e-4)


def test_bad_input_is_one_sentence():
    solution = square(0.0)
    with pytest.raises(ng.InputError, match="solution: got 3, expected a GraspSolution"):
        ng.mu_rates(3)
    with pytest.raises(ng.InputError, match="almost: got 0"):
        ng.mu_rates(solution, almost=0)
    with pytest.raises(ng.InputError, match=r"step: got 1\.0, expected a relative step below 1"):
        ng.mu_rates(solution, step=1.0)
    with pytest.raises(ng.InputError, match=r"hand: got .* expected the hand with joints"):
        ng.mu_rates(solution, hand=3)
    with pytest.raises(ng.InputError, match=r"body: got .* the body of the solution"):
        ng.mu_rates(solution, ng.Sphere(1.0))
    nothing = GraspSolution(ng.Status.NO_GRASP, "none", solution.problem)
    with pytest.raises(ng.InputError, match="solution: got no grasp"):
        ng.mu_rates(nothing)
