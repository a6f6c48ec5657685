"""The paper's own algorithms against the certificates, within the polytope's approximation error."""

import numpy as np
import pytest
from scipy.optimize import linprog

import nlpgrasp as ng
from nlpgrasp.quality import WrenchSet
from nlpgrasp.quality.paper_algorithms import inscribed_polytope, mu_by_steps
from tests.quick import first
from tests.samples import closed_ellipsoid_grasp, square_pair

BUDGETS = ["l2", "per_finger", "shared", "per_finger_size"]


def three_on_a_circle(friction=0.5):
    angles = 2.0 * np.pi * np.arange(3) / 3.0
    points = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return ng.Grasp(points, -points, ng.FrictionContact(friction))


def in_hull(points, p):
    """Whether a linear program finds weights."""
    A = np.concatenate([points.T, np.ones((1, len(points)))])
    return linprog(np.zeros(len(points)), A_eq=A, b_eq=np.append(p, 1.0), method="highs").status == 0


@pytest.mark.parametrize("budget", BUDGETS)
def test_delta_is_between_that_of_the_polytope_and_its_error(budget, rng):
    for grasp, count in ((three_on_a_circle(), 100), (closed_ellipsoid_grasp(rng), 80)):
        polytope, bounds = inscribed_polytope(grasp, count, force_budget=budget), ng.delta(grasp, force_budget=budget)
        assert 0.0 < polytope.delta <= bounds.upper
        assert bounds.lower <= polytope.delta / polytope.share
        assert polytope.delta == polytope.distances[polytope.closest] == polytope.distances.min()


@pytest.mark.parametrize("count", [12, 60, 200])
def test_the_faces_are_those_of_a_polytope_inside(count, rng):
    """Every vertex is a wrench of the set, on the inner side of every face, and on the faces it is said to be on."""
    grasp = three_on_a_circle()
    polytope = inscribed_polytope(grasp, count, 0.5)
    scale = np.array([1.0, 1.0, 2.0])
    forces = ng.finger_forces(grasp, polytope.vertices / scale)
    assert np.max(forces.used) <= 1.0 + 1e-8
    height = polytope.vertices @ polytope.normals.T
    assert np.max(height - polytope.distances) <= 1e-9
    on = np.take_along_axis(height, polytope.members.T, axis=0)
    np.testing.assert_allclose(on, np.tile(polytope.distances, (3, 1)), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(polytope.normals, axis=1), 1.0)
    assert len(polytope.vertices) <= count + 1
    y = rng.standard_normal((20, 3))
    far = WrenchSet.of(grasp).support(y * scale)[1] * scale
    assert all(in_hull(polytope.vertices, (1 - 1e-6) * polytope.share * w) for w in far)


def test_the_error_goes_to_zero():
    """In the plane a smooth set's polytope of m vertices is off by some constant over m."""
    grasp, bounds = three_on_a_circle(), ng.delta(three_on_a_circle(), rtol=1e-5)
    errors, delta_errors = [], []
    for count in (50, 200, 800):
        polytope = inscribed_polytope(grasp, count)
        errors.append(1.0 - polytope.share)
        delta_errors.append(1.0 - polytope.delta / bounds.upper)
    assert errors[0] > 2.5 * errors[1] > 6.0 * errors[2]
    assert errors[2] < 0.01
    assert all(-1e-4 <= o <= e for o, e in zip(delta_errors, errors, strict=True))


@pytest.mark.slow
def test_the_error_goes_down_in_space():
    grasp = closed_ellipsoid_grasp(np.random.default_rng(0))
    shares = [inscribed_polytope(grasp, count).share for count in (60, 200, 600)]
    assert shares[0] + 0.1 < shares[1]
    assert shares[1] + 0.05 < shares[2]
    assert shares[2] > 0.75


@pytest.mark.parametrize("budget", BUDGETS)
@pytest.mark.parametrize("center", first(1, [[0.1, -0.2, 0.05], [0.0, 0.0, 0.0]]))
def test_mu_by_steps_in_the_plane(budget, center):
    grasp, task = three_on_a_circle(), ng.TaskEllipsoid([1.0, 0.5, 0.3], center=center)
    certified = ng.mu(grasp, task, 1e-3, force_budget=budget)
    stepped = mu_by_steps(grasp, task, vertices=400, force_budget=budget)
    assert stepped.bounds.lower <= certified.upper
    assert certified.lower <= stepped.bounds.upper
    assert stepped.bounds.lower > 0.4 * certified.upper
    assert stepped.step <= 1e-3 * stepped.beta
    assert 0.5 < stepped.task_share < 1.0
    used = ng.finger_forces(grasp, (stepped.beta + stepped.step) * stepped.worst, force_budget=budget).used[0]
    assert used / stepped.polytope_share >= 1.0 - 1e-9  # the wrench that left the polytope
    assert used <= (1.0 + 2e-3) / stepped.polytope_share


def test_mu_by_steps_converges():
    """All wrenches of a polytope are looked at: what is left is the inscribed polytope's error, and it vanishes."""
    grasp = three_on_a_circle()
    task = ng.TaskPolytope([[1.0, 0.2, 0.0], [-0.5, 0.8, 0.1], [0.0, -1.0, -0.2], [0.0, 0.0, 0.3]])
    certified = ng.mu(grasp, task, 1e-5)
    errors = []
    for count in (30, 120, 480):
        stepped = mu_by_steps(grasp, task, 1e-5, vertices=count)
        assert stepped.task_share == 1.0
        assert stepped.bounds.lower <= certified.upper
        assert certified.lower <= stepped.bounds.upper
        errors.append(1.0 - stepped.beta / certified.upper)
    assert 0.0 <= errors[2] < 0.01
    assert errors[2] < errors[0] / 3.0


def test_mu_by_steps_in_space(rng):
    grasp, task = closed_ellipsoid_grasp(rng), ng.TaskEllipsoid([1.0, 1.0, 2.0, 0.5, 0.5, 0.5])
    certified, stepped = ng.mu(grasp, task), mu_by_steps(grasp, task, 0.05, vertices=80)
    assert stepped.bounds.lower <= certified.upper
    assert certified.lower <= stepped.bounds.upper
    assert stepped.wrenches == 126


@pytest.mark.parametrize(("pair", "expected"), [("I", 0.3799), ("II", 0.3340), ("III", 0.0), ("IV", 0.0)])
def test_example_3_10_as_the_paper_would_have_computed_it(pair, expected):
    points, normals = square_pair(pair)
    grasp = ng.Grasp(points, normals, ng.FrictionContact(0.5))
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0], center=[0.0, 0.5, 0.0])
    stepped = mu_by_steps(grasp, task, vertices=300)
    assert stepped.bounds.lower <= expected + 1e-4
    assert expected - 1e-4 <= stepped.bounds.upper
    assert (stepped.beta > 0.3) == (expected > 0.0)


def test_a_grasp_that_is_not_closed_has_no_ball_around_the_origin():
    one = ng.Grasp([[0.0, 1.0]], [[0.0, -1.0]], ng.FrictionContact(0.5))
    flat = inscribed_polytope(one)  # a single contact: two dimensions
    assert (flat.delta, flat.share, flat.closest, len(flat.normals)) == (0.0, 0.0, None, 0)
    two = ng.Grasp([[0.0, 1.0], [1.0, 0.0]], [[0.0, -1.0], [-1.0, 0.0]], ng.FrictionContact(0.2))
    grasp = inscribed_polytope(two)
    assert grasp.delta == pytest.approx(0.0, abs=1e-12)
    assert len(grasp.normals) > 3
    assert mu_by_steps(two, ng.TaskEllipsoid([1.0, 1.0, 1.0])).beta == 0.0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda g: inscribed_polytope(g, 5), "vertices: got 5, expected a whole number from 6 to"),
        (lambda g: inscribed_polytope(g, torque_scale=0.0), "torque_scale"),
        (lambda g: inscribed_polytope("grasp"), "grasp: got"),
        (lambda g: mu_by_steps(g, ng.TaskEllipsoid([1.0] * 6)), "task: got dimension 6"),
        (lambda g: mu_by_steps(g, ng.TaskSet(lambda y: np.linalg.norm(y, axis=1), 3)), "a TaskEllipsoid or a TaskPoly"),
        (lambda g: mu_by_steps(g, ng.TaskEllipsoid([1.0] * 3), rtol=0.0), "rtol: got 0"),
    ],
)
def test_what_makes_no_sense_is_refused(make, message):
    with pytest.raises(ng.InputError, match=message):
        make(three_on_a_circle())
