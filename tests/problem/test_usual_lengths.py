"""Warnings of lengths in other units than metres, with the probable value."""

import contextlib
import re
import warnings

import pytest

import nlpgrasp as ng
from nlpgrasp.common import user_warnings as once
from tests.hands.urdf import THREE

BOX = ng.Box([0.08, 0.04, 0.04])
TIPS = ("finger_1_tip", "finger_2_tip", "finger_3_tip")


@pytest.fixture(autouse=True)
def clear_warnings(monkeypatch):
    monkeypatch.setattr(once, "_issued", set())


def problem(contact=None, constraints=(), hand=None):
    models = [ng.FrictionContact(0.6) if contact is None else contact] * 3
    return ng.GraspProblem(BOX, models, ng.TaskEllipsoid([1.0] * 6), constraints=constraints, hand=hand)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        (
            {"contact": ng.SoftContact(0.6, 5.0)},
            r"contacts\[0\]: torsional friction: 5 m beside a body of 0.08 m.*0.005",
        ),
        ({"constraints": [ng.Table(-30.0)]}, r"constraints\[0\]: height: -30 m beside a body of 0.08 m.*, -0.03"),
        ({"constraints": [ng.Table(-0.03, 2.0)]}, r"constraints\[0\]: clearance: 2 m .*, 0.002"),
    ],
)
def test_it_is_asked_about(parts, message):
    with warnings.catch_warnings(record=True) as caught, contextlib.suppress(ng.InputError):
        warnings.simplefilter("always")  # a table that leaves no room is refused besides
        problem(**parts)
    (text,) = [str(w.message) for w in caught]
    assert re.match(message, text)


def test_a_fingertip_larger_than_the_body():
    hand = ng.URDFHand.load(THREE, dict.fromkeys(TIPS, 0.99), tip_overhang=1.0)
    with pytest.warns(UserWarning, match="fingertip finger_1_tip: radius: 0.99 m beside a body of 0.08 m.*, 0.00099"):
        problem(hand=hand)


def test_usual_lengths_are_not():
    problem(ng.SoftContact(0.6, 0.005), [ng.Table(-0.3, 0.01)])
    problem(hand=ng.URDFHand.load(THREE, dict.fromkeys(TIPS, 0.0105)))
