"""Validation of grasp problems, and their JSON data."""

import casadi as ca
import numpy as np
import pytest

import nlpgrasp as ng

BALL = ng.TaskEllipsoid([1.0] * 6)
DISK = ng.TaskEllipsoid([1.0] * 3)
BOX = ng.Box([1.0, 1.0, 1.0])
SQUARE = ng.Polygon([[0, 0], [1, 0], [1, 1], [0, 1]])
FINGERS = [ng.FrictionContact(0.5)] * 3


def test_torque_origin_is_the_centroid_by_default():
    problem = ng.GraspProblem(ng.Prism([[0, 0], [3, 0], [0, 3]], 1.0), FINGERS, BALL)
    np.testing.assert_allclose(problem.origin, [1.0, 1.0, 0.0])


def test_one_contact_model_serves_every_fingertip():
    problem = ng.GraspProblem(BOX, ng.FrictionContact(0.5), BALL, hand=ng.Fingertips(4))
    assert len(problem.models) == 4


def test_forbidden_faces_are_left_out():
    contacts = [ng.FrictionContact(0.5, faces=["+x", "+y"]), ng.FrictionContact(0.5), ng.FrictionContact(0.5)]
    problem = ng.GraspProblem(BOX, contacts, BALL, constraints=[ng.Forbid("+x")])
    assert problem.allowed_faces(0) == ("+y",)
    assert problem.allowed_faces(1) == ("-x", "+y", "-y", "+z", "-z")


def test_constraints_in_any_unit_are_judged_by_distance():
    """A row in millimetres is violated by hundreds and still within reach."""
    patch = ng.Constraint("patch mm", lambda p, n: 1e3 * ca.norm_2(p[0] - ca.DM([0.5, 0.1, 0.2])), upper=5.0)
    assert ng.GraspProblem(BOX, FINGERS, BALL, constraints=[patch]).constraints == (patch,)


def test_a_least_distance_that_just_fits_is_accepted():
    wedge = ng.Prism([[0, 0], [1, 0], [1, 0.1]], 0.1)
    contacts = [ng.FrictionContact(0.5, faces="top")] * 2
    assert ng.GraspProblem(wedge, contacts, BALL, constraints=[ng.Spread(min=0.97)], edge_margin=0.0)


def test_problems_are_frozen():
    problem = ng.GraspProblem(BOX, FINGERS, BALL)
    with pytest.raises(AttributeError):
        problem.name = "other"


NAN = ng.Constraint("nan", lambda p, n: p[0][0] * np.nan, 0.0)
ALL_FACES = ng.Forbid(["+x", "-x", "+y", "-y", "+z", "-z"])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ng.GraspProblem("box", FINGERS, BALL), r"GraspProblem\.body"),
        (lambda: ng.GraspProblem(BOX, [], BALL), r"GraspProblem\.contacts"),
        (lambda: ng.GraspProblem(BOX, [0.5] * 3, BALL), r"GraspProblem\.contacts"),
        (lambda: ng.GraspProblem(BOX, FINGERS, DISK), "dimension 6 for this body"),
        (lambda: ng.GraspProblem(SQUARE, FINGERS, BALL), "dimension 3 for this body"),
        (lambda: ng.GraspProblem(SQUARE, [ng.SoftContact(0.5, 0.1)] * 2, DISK), "no torsion"),
        (
            lambda: ng.GraspProblem(BOX, FINGERS, BALL, hand=ng.Fingertips(4)),
            "got 3 contacts, expected 4, one a fingertip",
        ),
        (lambda: ng.GraspProblem(BOX, [ng.FrictionContact(0.5, faces="lid")] * 2, BALL), r"faces of the body: \+x"),
        (lambda: ng.GraspProblem(BOX, FINGERS, BALL, constraints=[ng.Forbid("lid")]), r"faces of the body: \+x"),
        (lambda: ng.GraspProblem(BOX, FINGERS, BALL, constraints=[ALL_FACES]), "no face left for contact 0"),
        (lambda: ng.GraspProblem(BOX, FINGERS, BALL, constraints=["table"]), r"constraints such as ng\.Table"),
        (
            lambda: ng.GraspProblem(BOX, FINGERS, BALL, constraints=[ng.Table(3.0)]),
            r"got table, finger 0: kept nowhere on faces .* \(the nearest misses by \d+ mm\), .* contact 0",
        ),
        (
            lambda: ng.GraspProblem(BOX, FINGERS, BALL, constraints=[ng.Forbid(ng.HalfSpace([0, 0, 1], -2.0))]),
            "forbidden region, finger 0",
        ),
        (
            lambda: ng.GraspProblem(BOX, FINGERS, BALL, constraints=[ng.Forbid(ng.HalfSpace([0, 1], 0.0))]),
            "3 coordinates",
        ),
        (lambda: ng.GraspProblem(BOX, FINGERS, BALL, constraints=[ng.Spread(min=5.0)]), "the body's diagonal"),
        (
            lambda: ng.GraspProblem(
                BOX, [ng.FrictionContact(0.5, faces="+x")] * 3, BALL, constraints=[ng.Spread(min=1.6)]
            ),
            "3 contacts 1.6 m apart",
        ),
        (
            lambda: ng.GraspProblem(BOX, FINGERS, BALL, constraints=[ng.Constraint("bad", lambda p, n: p[7])]),
            r"Constraint 'bad'\.expression: got IndexError",
        ),
        (
            lambda: ng.GraspProblem(BOX, FINGERS, BALL, constraints=[ng.Forbid(lambda p: p[7])]),
            r"Forbid\.region: got .*dimension",
        ),
        (
            lambda: ng.GraspProblem(
                BOX, FINGERS, BALL, constraints=[ng.Constraint("nan", lambda p, n: p[0][0] * np.nan)]
            ),
            "got nan: kept nowhere on faces .*, expected constraints that leave contact 0",
        ),
        (lambda: ng.GraspProblem(BOX, FINGERS, BALL, constraints=5), r"GraspProblem\.constraints: got 5"),
        (lambda: ng.GraspProblem(BOX, ng.FrictionContact(0.5), BALL, hand="hand"), r"GraspProblem\.hand"),
        (lambda: ng.GraspProblem(BOX, FINGERS, BALL, name="a\nb"), r"GraspProblem\.name"),
        (lambda: ng.GraspProblem(BOX, FINGERS, BALL, force_budget="l7"), r"GraspProblem\.force_budget"),
        (lambda: ng.GraspProblem(BOX, FINGERS, BALL, torque_origin=[0.0, 0.0]), r"GraspProblem\.torque_origin"),
    ],
)
def test_problems_that_do_not_fit_together_are_refused(make, message):
    with pytest.raises(ng.InputError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_constraints_from_an_iterator_are_kept_with_the_contacts_of_pads():
    gripper = ng.ParallelJaw(stroke=0.11, pad=(0.02, 0.012))
    body, table = ng.Box([0.06, 0.05, 0.04]), ng.Table(-0.02)
    problem = ng.GraspProblem(body, task=ng.lift(body.centroid, 0.2), hand=gripper, constraints=iter([table]))
    assert problem.constraints == (table,)
    assert [model.extents for model in problem.models] == [(0.02, 0.012)] * 2
    with pytest.raises(ng.InputError, match=r"GraspProblem\.constraints: got 5"):
        ng.GraspProblem(body, task=ng.lift(body.centroid, 0.2), hand=gripper, constraints=5)
