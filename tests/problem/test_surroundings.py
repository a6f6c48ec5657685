"""Warnings of tables through the body, and of bodies too large or too small for the hand."""

import warnings

import pytest

import nlpgrasp as ng
from nlpgrasp.common import user_warnings as once
from tests.hands.urdf import THREE

BOX = ng.Box([0.08, 0.04, 0.04])
TIPS = dict.fromkeys(("finger_1_tip", "finger_2_tip", "finger_3_tip"), 0.01)


@pytest.fixture(autouse=True)
def clear_warnings(monkeypatch):
    monkeypatch.setattr(once, "_issued", set())


def problem(body=BOX, table=None, hand=None):
    constraints = [] if table is None else [table]
    return ng.GraspProblem(
        body, [ng.FrictionContact(0.6)] * 3, ng.TaskEllipsoid([1.0] * 6), constraints=constraints, hand=hand
    )


def test_a_table_through_the_body():
    message = (
        r"constraints\[0\]: the body reaches 15 mm below the table \(height -0.005 m, lowest point -0.02 m\); .*under"
    )
    with pytest.warns(UserWarning, match=message):
        problem(table=ng.Table(-0.005))


def test_tables_under_the_body_are_usual():
    problem(table=ng.Table(-0.02))
    problem(table=ng.Table(-0.05))
    problem(table=ng.Table(-0.0195))  # a scan that dips into the table by less than a fiftieth of its size


def test_the_table_that_a_body_stands_on():
    assert ng.Table.under(BOX) == ng.Table(-0.02)
    assert ng.Table.under(ng.Sphere(0.03), clearance=0.002) == ng.Table(-0.03, 0.002)
    ball = ng.Implicit(lambda p: p.T @ p - 9e-4, [[-0.05] * 3, [0.05] * 3])
    with pytest.raises(ng.InputError, match=r"Table\.under: got an implicit surface, expected .* ng\.Table\(height\)"):
        ng.Table.under(ball)
    problem(ball, ng.Table(-0.03))  # its box says nothing of where it ends
    square = ng.Polygon([[0.0, 0.01], [0.1, 0.01], [0.1, 0.03], [0.0, 0.03]])
    assert ng.Table.under(square).height == pytest.approx(0.01)


def test_a_body_that_is_beyond_the_hand():
    hand = ng.URDFHand.load(THREE, TIPS)
    message = (
        r"GraspProblem\.body: a body whose shortest side is 0.8 m, for a hand whose fingertips reach 0\.1\d+ m from"
    )
    with pytest.warns(UserWarning, match=message):
        problem(ng.Box([0.9, 0.9, 0.8]), hand=hand)


def test_a_long_body_has_a_side_that_fits():
    problem(ng.Box([0.9, 0.9, 0.04]), hand=ng.URDFHand.load(THREE, TIPS))


def test_a_fingertip_in_millimetres_is_refused():
    with pytest.raises(ng.InputError, match=r"finger_1_tip'\]: got 10 m, expected metres, at most 1: 10 mm are 0.01"):
        ng.URDFHand.load(THREE, {**TIPS, "finger_1_tip": 10})


SPAN = "a hand whose fingertips reach 0.148 m from its palm"


@pytest.mark.parametrize(
    ("size", "hand", "text"),
    [
        (1.0, None, "shortest side is 1 m, for jaws that open to 0.08 m"),
        (0.0012, None, "longest side is 0.0012 m, for jaws that open to 0.08 m"),
        (0.4, THREE, f"shortest side is 0.4 m, for {SPAN}"),
        (0.0012, THREE, f"longest side is 0.0012 m, for {SPAN}"),
        (0.06, None, None),
        (0.006, THREE, None),
    ],
)
def test_sizes_of_body_and_hand_are_compared(size, hand, text):
    robot = ng.ParallelJaw(0.08) if hand is None else ng.URDFHand.load(THREE, TIPS)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        task = ng.TaskEllipsoid([1.0, 1.0, 1.0, *[0.1 * size] * 3])
        ng.GraspProblem(ng.Box([size] * 3), [ng.FrictionContact(0.6)] * robot.count, task, hand=robot, edge_margin=0.0)
    messages = [str(warning.message) for warning in caught if "in metres?" in str(warning.message)]
    expected = f'GraspProblem.body: a body whose {text}; are both in metres? A mesh in millimetres takes unit="mm"'
    assert messages == ([] if text is None else [expected])
