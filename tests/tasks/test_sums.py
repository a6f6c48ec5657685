"""Polytopes, Minkowski sums and changes of origin."""

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.tasks import task_from_dict
from tests.samples import closed_ellipsoid_grasp

WRENCHES = np.array([[0, 0, 5, 0, 0, 0], [0, 2, 1, 0.5, 0, 0], [1, 0, 0, 0, 0, 1], [-3, 0, 0, 0, 0, -1.0]])


def overlap(first, second):
    return first.lower <= second.upper * (1 + 1e-9) and second.lower <= first.upper * (1 + 1e-9)


def test_a_polytope_is_resisted_where_its_wrenches_are(rng):
    """The least force that makes each wrench, by other code: mu-tilde is one over the largest."""
    grasp = closed_ellipsoid_grasp(rng)
    task = ng.TaskPolytope(WRENCHES)
    bounds = ng.mu(grasp, task)
    largest = np.max(ng.finger_forces(grasp, WRENCHES).used)
    assert bounds.lower <= 1.0 / largest <= bounds.upper * (1 + 1e-9)
    assert bounds.gap <= 0.0101


@pytest.mark.parametrize("count", [1, 2])
def test_few_wrenches(count, rng):
    grasp = closed_ellipsoid_grasp(rng)
    bounds = ng.mu(grasp, ng.TaskPolytope(WRENCHES[:count]))
    largest = np.max(ng.finger_forces(grasp, WRENCHES[:count]).used)
    assert bounds.lower <= 1.0 / largest <= bounds.upper * (1 + 1e-9)


def test_supports_add(rng):
    parts = [ng.TaskPolytope(WRENCHES), ng.TaskEllipsoid([1, 2, 1, 0.1, 0.2, 0.3]), ng.TaskPolytope(-WRENCHES[:2])]
    total = parts[0] + parts[1] + parts[2]
    y = rng.standard_normal((50, 6))
    values, maximisers = total.support(y)
    np.testing.assert_allclose(values, np.sum([part.support(y)[0] for part in parts], axis=0))
    np.testing.assert_allclose(np.sum(maximisers * y, axis=1), values)


def test_sums_take_their_simplest_form():
    point, hull, ball = ng.TaskPolytope(WRENCHES[:1]), ng.TaskPolytope(WRENCHES), ng.TaskEllipsoid([1.0] * 6)
    translated = ball + point
    assert isinstance(translated, ng.TaskEllipsoid)
    np.testing.assert_allclose(translated.center, WRENCHES[0])
    doubled = hull + hull
    assert isinstance(doubled, ng.TaskPolytope)
    assert len(doubled.wrenches) == 16
    assert isinstance(ball + ball, ng.TaskSum)
    assert isinstance(ball + ball + ball, ng.TaskSum)
    assert len((ball + ball + ball).tasks) == 3


def test_a_point_moves_from_either_side():
    point, ball = ng.TaskPolytope(WRENCHES[:1]), ng.TaskEllipsoid([1.0] * 6)
    assert point + ball == ball + point == ng.TaskEllipsoid([1.0] * 6, center=WRENCHES[0])
    assert np.array_equal((point + ng.TaskPolytope(WRENCHES)).wrenches, WRENCHES[0] + WRENCHES)


def test_large_polytopes_add_up_to_a_sum(rng):
    large = ng.TaskPolytope(rng.standard_normal((21, 6)))
    assert isinstance(large + large, ng.TaskSum)
    assert isinstance(large + ng.TaskPolytope(large.wrenches[:19]), ng.TaskPolytope)  # 399 wrenches


def test_a_sum_of_sums_is_flat_and_keeps_their_order(rng):
    balls = [ng.TaskEllipsoid([size] * 6) for size in (1.0, 2.0, 3.0, 4.0)]
    total = (balls[0] + balls[1]) + (balls[2] + balls[3])
    assert list(total.tasks) == balls


def test_an_ellipsoid_twice_is_twice_the_ellipsoid(rng):
    grasp, ball = closed_ellipsoid_grasp(rng), ng.TaskEllipsoid([1, 1, 1, 0.5, 0.5, 0.5])
    single, doubled, scaled = ng.mu(grasp, ball), ng.mu(grasp, ball + ball), ng.mu(grasp, 2.0 * ball)
    assert overlap(doubled, scaled)
    assert doubled.lower <= 0.5 * single.upper * (1 + 1e-9)
    assert 0.5 * single.lower <= doubled.upper * (1 + 1e-9)


@pytest.mark.parametrize(
    "task",
    [
        ng.TaskPolytope(WRENCHES),
        ng.TaskEllipsoid([1, 1, 1, 0.5, 0.5, 0.5], center=[0, 0, 0.2, 0, 0, 0]),
        ng.TaskEllipsoid([1, 1, 1, 0.5, 0.5, 0.5]) + ng.TaskPolytope(WRENCHES),
    ],
    ids=["polytope", "ellipsoid", "sum"],
)
def test_mu_does_not_depend_on_the_torque_origin(task, rng):
    """(3.3-7b): task and grasp moved to another origin together."""
    grasp, origin = closed_ellipsoid_grasp(rng), np.array([0.3, -0.2, 0.4])
    given = task.given_about(grasp.torque_origin)
    other = ng.Grasp(grasp.points, grasp.normals, grasp.contacts, origin)
    assert overlap(ng.mu(grasp, given), ng.mu(other, given.at(origin)))
    again = given.at(origin).at(grasp.torque_origin)
    y = rng.standard_normal((20, 6))
    np.testing.assert_allclose(again.support(y)[0], given.support(y)[0], rtol=1e-12)


def test_moments_about_another_point():
    """A force of 2 N along z at x = 0.5 turns about y by -1 N m about the frame's origin, by nothing about there."""
    task = ng.TaskPolytope([[0.0, 0.0, 2.0, 0.0, -1.0, 0.0]])
    np.testing.assert_allclose(task.at([0.5, 0.0, 0.0]).wrenches, [[0, 0, 2, 0, 0, 0]])


def test_planar_tasks_move_too():
    task = ng.TaskPolytope([[0.0, 2.0, 1.0]])
    np.testing.assert_allclose(task.at([0.5, 0.0]).wrenches, [[0, 2, 0]])


def test_a_problem_moves_the_task_to_its_own_origin():
    task = ng.press([0.0, 0.0, -0.1], [1.0, 0.0, 0.0], 4.0, sideways=0.0)
    problem = ng.GraspProblem(ng.Sphere(0.05), [ng.FrictionContact(0.5)] * 3, task, torque_origin=[0.0, 0.0, -0.1])
    np.testing.assert_allclose(problem.task.center, [2, 0, 0, 0, 0, 0], atol=1e-12)
    about_middle = ng.GraspProblem(ng.Sphere(0.05), [ng.FrictionContact(0.5)] * 3, task)
    np.testing.assert_allclose(about_middle.task.center, [2, 0, 0, 0, -0.2, 0], atol=1e-12)


@pytest.mark.parametrize(
    "task",
    [ng.TaskPolytope(WRENCHES), ng.TaskEllipsoid([1.0] * 6) + ng.TaskPolytope(WRENCHES)],
    ids=["polytope", "sum"],
)
def test_json_round_trip(task, rng):
    again = task_from_dict(task.to_dict())
    assert again.to_dict() == task.to_dict()
    y = rng.standard_normal((9, 6))
    np.testing.assert_array_equal(again.support(y)[0], task.support(y)[0])


def test_is_centred():
    assert ng.TaskPolytope(np.concatenate([WRENCHES, -WRENCHES])).is_centred
    assert not ng.TaskPolytope(WRENCHES).is_centred
    assert (ng.TaskEllipsoid([1.0] * 6) + ng.TaskPolytope(np.concatenate([WRENCHES, -WRENCHES]))).is_centred


def test_measures_move_a_task_to_the_grasps_origin(rng):
    """The same task, stated about a point of its own, on grasps with two torque origins."""
    grasp = closed_ellipsoid_grasp(rng)
    other = ng.Grasp(grasp.points, grasp.normals, grasp.contacts, [0.3, 0.1, 0.0])
    task = ng.press([0.0, 0.0, -0.09], [0.0, 0.0, -1.0], 15.0)
    assert overlap(ng.mu(grasp, task), ng.mu(other, task))
    assert overlap(ng.mu(other, task), ng.mu(other, task.at([0.3, 0.1, 0.0])))


def test_sums_that_were_scaled_or_moved_still_add_up(rng):
    tool = ng.press([0.0, 0.0, -0.09], [0.0, 0.0, -1.0], 15.0) + ng.turn([0.0, 0.0, 1.0], 0.4)
    weight = ng.gravity([0.0, 0.0, 0.1], 1.0)
    y = rng.standard_normal((20, 6))
    expected = 2.0 * tool.support(y)[0] + weight.support(y)[0]
    np.testing.assert_allclose((2.0 * tool + weight).support(y)[0], expected)
    np.testing.assert_allclose((weight + 2.0 * tool).support(y)[0], expected)
    moved = (tool.at([1.0, 0.0, 0.0]) + weight).at([0.0, 0.0, 0.0])
    np.testing.assert_allclose(moved.support(y)[0], tool.support(y)[0] + weight.support(y)[0])
    retold = tool.given_about([1.0, 0.0, 0.0])
    both = (retold + weight).at([0.0, 0.0, 0.0]).support(y)[0]
    np.testing.assert_allclose(both, retold.at([0.0, 0.0, 0.0]).support(y)[0] + weight.support(y)[0])
    assert tool.torque_origin.tolist() == [0.0, 0.0, 0.0]


def test_a_large_symmetric_polytope_is_centred(rng):
    half = rng.standard_normal((1500, 6))
    assert ng.TaskPolytope(np.concatenate([half, -half])).is_centred
    assert not ng.TaskPolytope(np.concatenate([half, -half[1:]])).is_centred


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ng.TaskPolytope([]), "TaskPolytope.wrenches"),
        (lambda: ng.TaskPolytope(np.zeros((3, 6))), "not zero"),
        (lambda: ng.TaskPolytope(np.eye(6) * 1e-200), "not zero"),
        (lambda: ng.TaskSum(5), "at least one task"),
        (lambda: ng.TaskPolytope([[1.0, np.nan, 0, 0, 0, 0]]), "no NaN"),
        (lambda: ng.TaskPolytope(np.ones((2, 9))), "length 3 or 6"),
        (lambda: ng.TaskPolytope([[1.0, 0, 0]]) + ng.TaskEllipsoid([1.0] * 6), "dimensions 3 and 6"),
        (lambda: ng.turn([0, 0, 1], 1.0) + ng.TaskEllipsoid([1.0] * 6), "given_about"),
        (lambda: -1.0 * ng.TaskEllipsoid([1.0] * 6), "greater than 0"),
        (lambda: ng.TaskEllipsoid([1.0] * 6).at([0.0, 1.0]), "origin"),
        (lambda: ng.TaskSum([]), "at least one task"),
        (lambda: task_from_dict({"type": "polytope"}), "what schema 1 says"),
        (lambda: task_from_dict(None), "one of ellipsoid, polytope, set, sum"),
        (lambda: ng.TaskSet(lambda y: y, 3.0), "3 .planar. or 6"),
    ],
)
def test_bad_input_is_one_sentence(call, message):
    with pytest.raises(ng.InputError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_a_task_and_a_number_do_not_add():
    with pytest.raises(TypeError):
        ng.TaskEllipsoid([1.0] * 6) + 1.0
    with pytest.raises(ng.InputError, match="factor"):
        np.ones(6) * ng.TaskEllipsoid([1.0] * 6)


OFF = np.array([0.1, 0.02, 0.05])  # m, of a body's centroid from its frame's origin


def off_centre_box():
    """Return a problem whose body's centroid is off the frame's origin; its task states no torque origin."""
    box = trimesh.creation.box([0.08, 0.05, 0.04])
    box.apply_translation(OFF)
    task = ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03])
    return ng.GraspProblem(ng.Mesh(box), [ng.FrictionContact(0.5)] * 3, task)


@pytest.fixture(scope="module")
def off_centre():
    """A solved problem, and its contacts about the frame's origin."""
    solution = ng.solve(off_centre_box(), starts=1, options=ng.SolveOptions(extras=False))
    found = solution.grasp
    return solution, ng.Grasp(found.points, found.normals, found.contacts)


def test_a_task_of_a_problem_carries_its_torque_origin():
    problem = off_centre_box()
    np.testing.assert_allclose(problem.task.torque_origin, OFF, atol=1e-12)
    assert problem.stated_task.torque_origin is None
    with pytest.warns(UserWarning, match=r"task: its moments stay about \[0.1, 0.02, 0.05\] m, the torque origin of"):
        other = ng.GraspProblem(ng.Sphere(0.03), [ng.FrictionContact(0.5)] * 3, problem.task)
    np.testing.assert_allclose(other.task.at(OFF).axes, problem.task.axes, atol=1e-12)
    assert not np.allclose(other.task.axes, problem.task.axes)


def test_the_task_of_a_solution_is_measured_about_its_own_point(off_centre, tmp_path):
    """Contacts about another point: .41, and not .12, as the same numbers about that point would give."""
    solution, other = off_centre
    loaded = ng.GraspSolution.load(solution.save(tmp_path / "box.json"))
    for task in (solution.task, loaded.task):
        assert overlap(ng.mu(other, task), solution.mu)
        assert overlap(ng.mu_tilde(other, task), solution.mu)
        stack = ng.GraspStack(other.points[None], other.normals[None], other.contacts)
        assert overlap(ng.mu(stack, task)[0], solution.mu)
        assert ng.measure(stack, task, ["mu"])["mu_lower"][0] == pytest.approx(solution.mu.lower, rel=0.06)
        assert ng.screen(stack, task)[0] == pytest.approx(solution.mu.upper, rel=0.05)
        used = ng.finger_forces(other, task).used
        np.testing.assert_allclose(used, ng.finger_forces(solution.grasp, task).used, rtol=1e-6)
    assert json.loads((tmp_path / "box.json").read_text())["problem"]["task"]["torque_origin"] == pytest.approx(OFF)


def test_a_problem_with_another_body_says_where_its_moments_stay():
    fingers, task = [ng.FrictionContact(0.6)] * 3, ng.TaskEllipsoid([1, 1, 1, 0.1, 0.1, 0.1])
    problem = replace(ng.GraspProblem(ng.Box([0.1, 0.06, 0.04]), fingers, task), contacts=fingers[:2])
    with pytest.warns(UserWarning, match=r"its moments stay about \[0, 0, 0\] m.* with task=problem.stated_task"):
        moved = replace(problem, body=off_centre_box().body)
    assert moved.task != problem.task
    again = replace(problem, body=off_centre_box().body, task=problem.stated_task)
    np.testing.assert_array_equal(again.task.torque_origin, again.origin)
    assert again.task == problem.task == task


def test_two_unstated_torque_origins_are_said(off_centre, monkeypatch):
    """Neither the grasp nor its task states one, and the contacts are far from the frame's origin."""
    monkeypatch.setattr("nlpgrasp.common.user_warnings._issued", set())
    solution, other = off_centre
    with pytest.warns(UserWarning, match="neither task nor grasp states one"):
        assert ng.mu(other, off_centre_box().stated_task).upper < 0.5 * solution.mu.lower


def test_support_functions_are_converted(off_centre):
    """A user's function, and a sum of tasks about different points, on grasps about two points."""
    solution, other = off_centre
    half = np.array([1, 1, 1, 0.03, 0.03, 0.03])
    box = ng.TaskSet(lambda y: np.abs(y) @ half).given_about(OFF)
    both = box + ng.gravity([0.0, 0.0, 0.0], 0.2)
    np.testing.assert_array_equal(both.torque_origin, OFF)
    for task in (box, both):
        assert overlap(ng.mu(other, task), ng.mu(solution.grasp, task))
        moved = ng.GraspProblem(ng.Sphere(0.05), [ng.FrictionContact(0.5)] * 3, task)
        assert overlap(ng.mu(other, moved.task), ng.mu(solution.grasp, task))


def test_variations_of_an_experiment_keep_a_task_as_it_was_stated():
    """Without a torque origin it is about the centroid of each body; with one it is converted."""
    base = off_centre_box()
    stated = replace(base, task=base.stated_task.given_about(OFF))
    softer = replace(base, contacts=[ng.FrictionContact(0.3)] * 3)
    for problem, center in ((base, np.zeros(3)), (softer, np.zeros(3)), (stated, OFF)):
        experiment = ng.Experiment(problem, {"sphere": {"body": ng.Sphere(0.03)}})
        varied = experiment.case("sphere").problem
        np.testing.assert_allclose(varied.task.at(center).axes, np.diag([1, 1, 1, 0.03, 0.03, 0.03]), atol=1e-12)
