"""Warnings of probable input mistakes: sizes, friction, numbers of fingers."""

import warnings

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common import user_warnings as once
from nlpgrasp.common.validation import LONGEST_BODY, SHORTEST_BODY

BALL, DISK = ng.TaskEllipsoid([1.0] * 6), ng.TaskEllipsoid([1.0] * 3)
FINGERS = [ng.FrictionContact(0.5)] * 3
BODIES = {
    "box": lambda s: ng.Box([s, s / 2, s / 2]),
    "sphere": lambda s: ng.Sphere(s / 2),
    "ellipsoid": lambda s: ng.Ellipsoid([s / 2, s / 4, s / 4]),
    "cylinder": lambda s: ng.Cylinder(s / 4, s),
    "prism": lambda s: ng.Prism([[0, 0], [s, 0], [0, s / 2]], s / 2),
    "superquadric": lambda s: ng.Superquadric([s / 2, s / 4, s / 4], [0.5, 0.5]),
    "torus": lambda s: ng.Torus(3 * s / 8, s / 8),
    "polygon": lambda s: ng.Polygon([[0, 0], [s, 0], [0, s / 2]]),
    "planar_implicit": lambda s: ng.PlanarImplicit(
        lambda p: p[0] ** 2 + p[1] ** 2 - (s / 2) ** 2, [[-s / 2] * 2, [s / 2] * 2]
    ),
}


@pytest.mark.parametrize("kind", BODIES)
@pytest.mark.parametrize(("size", "unit"), [(80.0, "smaller"), (8e-5, "larger")])
def test_a_body_of_another_unit_is_asked_about(kind, size, unit):
    body = BODIES[kind](size)
    expected = rf"GraspProblem\.body: got a {kind} with a longest side of {size:g} m, expected .* a {unit} unit"
    with pytest.raises(ng.InputError, match=expected):
        ng.GraspProblem(body, FINGERS, BALL if body.space == 3 else DISK)


@pytest.mark.parametrize("size", [1.001 * SHORTEST_BODY, 0.999 * LONGEST_BODY])
def test_bodies_within_the_limits_are_taken(size):
    assert ng.GraspProblem(ng.Box([size] * 3), FINGERS, BALL).body.size == pytest.approx(size * np.sqrt(3.0) / 2.0)


def test_obstacles_may_be_large():
    wall = ng.Obstacle(ng.Box([80.0, 80.0, 1.0]), 0.0, [0.0, 0.0, -2.0])
    assert ng.GraspProblem(ng.Box([1.0] * 3), FINGERS, BALL, constraints=[wall]).constraints == (wall,)


def test_one_contact_without_a_hand_is_asked_how_many_fingers():
    message = (
        r"GraspProblem\.contacts: got one SoftContact without a hand: how many fingers\?, expected a model for each"
    )
    with pytest.raises(ng.InputError, match=message):
        ng.GraspProblem(ng.Box([1.0] * 3), ng.SoftContact(0.5, 0.01), BALL)
    assert len(ng.GraspProblem(ng.Box([1.0] * 3), [ng.SoftContact(0.5, 0.01)], BALL).models) == 1


def test_much_friction_is_warned_of_once(monkeypatch):
    monkeypatch.setattr(once, "_issued", set())
    contacts = [ng.FrictionContact(2.0), ng.FrictionContact(60.0), ng.SoftContact(70.0, 0.01)]
    words = r"^GraspProblem\.contacts\[1\]\.friction: 60 is above 2; rubber on dry surfaces has about 1$"
    with pytest.warns(UserWarning, match=words) as caught:
        ng.GraspProblem(ng.Box([1.0] * 3), contacts, BALL)
    assert len(caught) == 1
    assert caught[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ng.GraspProblem(ng.Box([1.0] * 3), contacts, BALL)
        ng.GraspProblem(ng.Box([1.0] * 3), [ng.FrictionContact(2.0), ng.PointContact()], BALL)
