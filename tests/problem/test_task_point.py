"""Warnings of disturbances without point on bodies whose frame's origin is off the centroid."""

import warnings

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.common import user_warnings as once

CENTRE = [0.0, 0.0, 0.07]
AWAY = trimesh.creation.box([0.04, 0.05, 0.1], transform=trimesh.transformations.translation_matrix(CENTRE))


@pytest.fixture(autouse=True)
def clear_warnings(monkeypatch):
    monkeypatch.setattr(once, "_issued", set())


@pytest.fixture(scope="module")
def foot():
    """A part whose frame begins at its foot."""
    return ng.Mesh(AWAY)


def made(body, task):
    return ng.GraspProblem(body, [ng.FrictionContact(0.6)] * 3, task)


@pytest.mark.parametrize("more", [None, ng.lift(CENTRE, 0.3), ng.gravity(CENTRE, 0.3)])
def test_it_is_said_with_the_cure(foot, more):
    task = ng.disturbance(1.0, 0.02) if more is None else more + ng.disturbance(1.0, 0.02)
    with pytest.warns(UserWarning, match=r"without a point .* 70 mm from the body's centroid: state point=body.cent"):
        problem = made(foot, task)
    turn = np.eye(6)[4:5]  # the force's arm of 70 mm, beside the torque that is stated
    assert problem.task.support(turn)[0] >= 0.0728 - 1e-4


def test_a_point_that_is_stated_is_taken(foot):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        problem = made(foot, ng.disturbance(1.0, 0.02, foot.centroid))
        made(foot, ng.disturbance(1.0, 0.02, [0.0, 0.0, 0.0]))
        made(foot, ng.disturbance(0.0, 0.02))
        made(ng.Box([0.04, 0.05, 0.1]), ng.disturbance(1.0, 0.02))
    torque = np.eye(6)[3:]
    np.testing.assert_allclose(problem.task.support(torque)[0], 0.02, rtol=1e-9)


def test_arms_are_those_about_the_body(foot):
    """A part 1 km off, with a task about its centroid, has no long arm; a point left in millimetres has one."""
    far = ng.Mesh(AWAY.copy().apply_translation([1000.0, 0.0, 0.0]), resolution=8)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made(far, ng.disturbance(1.0, 0.02, far.centroid))
    with pytest.warns(
        UserWarning, match=r"an arm of [67][0-9.]+ m on a body of .*: moments are newton-metres, and points"
    ):
        made(foot, ng.disturbance(1.0, 0.02, [0.0, 0.0, 70.0]))
