"""Tasks given by support functions, mu_1 and the constants of (3.3-8)."""

import gc
import json
from copy import deepcopy

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common import user_warnings
from nlpgrasp.common.spatial import move_torque_origin, rotate_body_frame
from nlpgrasp.tasks import task_from_dict
from tests.samples import closed_ellipsoid_grasp, random_rotation


def ellipsoid_support(task):
    return lambda y: task.support(y)[0]


def box_support(half):
    return lambda y: (np.abs(y) @ half, np.sign(y) * half)


@pytest.mark.parametrize("with_maximisers", [True, False])
def test_an_ellipsoid_by_its_support_function(with_maximisers, rng):
    grasp = closed_ellipsoid_grasp(rng)
    task = ng.TaskEllipsoid(
        [1, 2, 1, 0.5, 1, 1], center=0.2 * rng.standard_normal(6), directions=random_rotation(rng, 6)
    )
    task_set = ng.TaskSet(task.support if with_maximisers else ellipsoid_support(task))
    bounds, set_bounds = ng.mu(grasp, task), ng.mu(grasp, task_set)
    assert bounds.lower <= set_bounds.upper
    assert set_bounds.lower <= bounds.upper
    assert set_bounds.gap <= 0.0101


def test_a_box_of_wrenches_by_its_corners(rng):
    """Each corner, times the lower bound, needs force at most 1; times the upper bound some corner needs more."""
    grasp, half = closed_ellipsoid_grasp(rng), rng.uniform(0.2, 1.0, 6)
    bounds = ng.mu(grasp, ng.TaskSet(box_support(half)))
    corners = half * np.array(np.meshgrid(*[[1, -1]] * 6)).reshape(6, -1).T
    largest = np.max(ng.finger_forces(grasp, corners).used)
    assert bounds.lower <= 1.0 / largest <= bounds.upper * (1 + 1e-9)
    assert bounds.gap <= 0.0101


def test_mu_1_rescales_about_a_point(rng):
    """(3.3-9): b + lambda (C - b), C a ball about c, is a ball about b + lambda (c - b) of lambda times its size."""
    grasp = closed_ellipsoid_grasp(rng)
    c, b = 0.1 * rng.standard_normal((2, 6))
    ball = ng.TaskEllipsoid([1.0] * 6, center=c)
    expected = ng.mu(grasp, ng.TaskEllipsoid([0.7] * 6, center=b + 0.7 * (c - b)))
    bounds = ng.mu_1(grasp, ball, b, scale=0.7)
    assert bounds.lower <= expected.upper
    assert expected.lower <= bounds.upper
    assert bounds.gap <= 0.0101


def test_mu_1_of_a_box(rng):
    grasp, half = closed_ellipsoid_grasp(rng), rng.uniform(0.5, 1.0, 6)
    bounds = ng.mu_1(grasp, ng.TaskSet(box_support(half)), np.zeros(6), scale=2.0)
    scaled = ng.mu(grasp, ng.TaskSet(box_support(2.0 * half)))
    assert bounds.lower <= scaled.upper
    assert scaled.lower <= bounds.upper


def test_mu_1_is_homogeneous_and_invariant(rng):
    """(3.3-6), (3.3-7a) and (3.3-7b) of a box of wrenches about b, as Example 3-7 says."""
    angles = 2.0 * np.pi * np.arange(3) / 3.0
    points = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    grasp, half, b = ng.Grasp(points, -points, ng.FrictionContact(0.5)), np.array([1.0, 0.5, 0.3]), np.full(3, 0.1)
    box = ng.TaskPolytope(b + half * np.array(np.meshgrid(*[[1, -1]] * 3)).reshape(3, -1).T)
    pose, origin = np.eye(3), np.array([0.4, -0.3])
    pose[:2, :2], pose[:2, 2] = random_rotation(rng, 2), [0.2, 0.5]
    about = ng.Grasp(points, -points, grasp.contacts, origin)
    bounds = ng.mu_1(grasp, box, b, 0.8, 1e-3)
    assert bounds.lower > 0.0
    for transformed, factor in (
        (ng.mu_1(grasp.scaled(2.5), box, b, 0.8, 1e-3), 2.5),
        (ng.mu_1(grasp.in_frame(pose), box.in_frame(pose), rotate_body_frame(pose[:2, :2]) @ b, 0.8, 1e-3), 1.0),
        (ng.mu_1(about, box.given_about([0.0, 0.0]), move_torque_origin(origin) @ b, 0.8, 1e-3), 1.0),
    ):
        assert max(factor * bounds.lower, transformed.lower) <= min(factor * bounds.upper, transformed.upper) * (
            1 + 1e-9
        )


@pytest.mark.parametrize("seed", range(5))
def test_constants_of_3_3_8(seed):
    """K_1 mu_tilde <= mu <= K_2 mu_tilde, for grasps and off-centre tasks at random."""
    rng = np.random.default_rng(seed)
    axes, R = rng.uniform(0.3, 1.5, 6), random_rotation(rng, 6)
    c = rng.standard_normal(6)
    task = ng.TaskEllipsoid(axes, center=0.6 * rng.random() * c / np.linalg.norm(c / axes[0]), directions=R)
    K1, K2 = ng.equivalence_constants(task)
    centred = ng.TaskEllipsoid(axes, directions=R)
    assert ng.equivalence_constants(centred) == (1.0, 1.0)
    assert 0.0 <= K1 < 1.0 < K2
    for _ in range(3):
        grasp = closed_ellipsoid_grasp(rng)
        mu, tilde = ng.mu(grasp, centred), ng.mu_tilde(grasp, task)
        assert K1 * tilde.lower <= mu.upper
        assert mu.lower <= K2 * tilde.upper


def test_constants_where_the_origin_is_outside():
    assert ng.equivalence_constants(ng.TaskEllipsoid([1.0] * 6, center=[0, 0, 3.0, 0, 0, 0])) == (
        0.0,
        pytest.approx(4.0),
    )
    flat = ng.TaskEllipsoid([1, 1, 1, 0, 0, 0], center=[0, 0, 0, 1.0, 0, 0])
    assert ng.equivalence_constants(flat) == (0.0, float("inf"))


def test_maximisers_by_differences_are_in_the_set_at_kinks():
    """Along e_4 a simplex is attained by a face, of which central differences give a point outside."""
    corners = np.concatenate([np.zeros((1, 6)), np.eye(6)])
    simplex = ng.TaskSet(lambda y: np.max(y @ corners.T, axis=1))
    values, maximisers = simplex.support(-np.eye(6))
    assert np.max(np.abs(values)) == 0.0
    assert np.min(maximisers) >= -1e-6
    assert np.max(maximisers.sum(axis=1)) <= 1.0 + 1e-6


def test_another_function_of_the_same_values_is_another_task(rng, monkeypatch):
    monkeypatch.setattr(user_warnings, "_issued", set())  # another test may have been told already
    wrenches = rng.standard_normal((40, 3))
    task = ng.TaskSet(lambda y: np.max(y @ wrenches.T, axis=1), 3)
    stored = json.loads(json.dumps(task.to_dict()))
    more = np.vstack([wrenches, 0.01 * wrenches[:1]])  # inside the others: no value shows it
    other = ng.TaskSet(lambda y: np.max(y @ more.T, axis=1), 3)
    assert other.to_dict()["values"] == stored["values"]
    assert task_from_dict(stored).to_dict() == stored
    del task
    gc.collect()
    with pytest.warns(UserWarning, match="make the same TaskSet in this process"):
        assert task_from_dict(stored).is_sampled
    assert not task_from_dict(other.to_dict()).is_sampled


def test_a_file_finds_the_function_of_this_process(rng):
    """Moved about another point it is the same set again, to rounding; without the function, a warning and a hull."""
    half = rng.uniform(0.5, 1.0, 6)
    box = ng.TaskSet(box_support(half))
    moved, y = box.given_about([0, 0, 0]).at([0.1, 0.0, -0.2]), rng.standard_normal((50, 6))
    data = json.loads(json.dumps((moved + ng.TaskEllipsoid([1.0] * 6).given_about([0.1, 0.0, -0.2])).to_dict()))
    read = task_from_dict(data)
    np.testing.assert_allclose(read.support(y)[0], moved.support(y)[0] + np.linalg.norm(y, axis=1), rtol=1e-12)
    stored = json.loads(json.dumps(box.to_dict()))
    sent = deepcopy(box)  # as by pickle
    del box, moved, read
    assert task_from_dict(stored).support(y)[0] == pytest.approx(sent.support(y)[0])
    del sent
    gc.collect()
    with pytest.warns(UserWarning, match="the hull of 60 wrenches is taken for the task"):
        hull = task_from_dict(stored)
    assert hull.is_sampled
    assert hull.to_dict() == stored
    assert "hull of 60 wrenches" in repr(hull)
    exact = np.abs(y) @ half
    assert np.all(hull.support(y)[0] <= exact * (1.0 + 1e-12))
    assert np.all(hull.support(y)[0] >= 0.5 * exact)
    with pytest.raises(ng.InputError, match="directions, then their opposites"):
        task_from_dict({**stored, "directions": [[1.0] * 6] * 60})


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ng.TaskSet(3), "a function of directions"),
        (lambda: ng.TaskSet(lambda y: y), "a value a direction"),
        (lambda: ng.TaskSet(lambda y: (y[:, 0], y[:, :2])), "shapes"),
        (lambda: ng.TaskSet(lambda y: np.sum(y**2, axis=1)), "positively homogeneous"),
        (lambda: ng.TaskSet(lambda y: np.full(len(y), np.nan)), "not finite"),
        (lambda: ng.TaskSet(box_support(np.ones(6)), dimension=7), "dimension"),
        (lambda: ng.TaskSet(lambda y: np.where(y[:, 0] > 0.0, np.inf, 0.0)), "a bounded set of wrenches"),
        (
            lambda: ng.TaskSet(lambda y: (np.linalg.norm(y, axis=1), 2.0 * y)),
            "a convex function, with maximisers in its set",
        ),
        (lambda: ng.TaskSet(lambda y: np.abs(y[:, 0]) - 0.2 * np.abs(y[:, 1])), "a convex function"),
        (
            lambda: ng.mu_1(ng.Grasp([[0, 0]], [[0, 1.0]], ng.PointContact()), ng.TaskEllipsoid([1.0] * 6), [0] * 3),
            "task",
        ),
        (
            lambda: ng.mu_1(ng.Grasp([[0, 0]], [[0, 1.0]], ng.PointContact()), ng.TaskEllipsoid([1.0] * 3), [0] * 2),
            "center",
        ),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(ng.InputError, match=message):
        make()
