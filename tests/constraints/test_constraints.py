"""Values of every constraint, and invalid input."""

import casadi as ca
import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.scalar_constraints import LinkSphere, PalmPose, SymbolicCandidate

POSITIONS = np.array([[0.3, 0.1, 0.4], [-0.2, 0.5, -0.1], [0.0, -0.6, 0.2]])
NORMALS = -POSITIONS / np.linalg.norm(POSITIONS, axis=1, keepdims=True)


def values(constraint, radius=0.0):
    """Return (name, value, lower, upper) of each row at the sample placement."""
    placement = SymbolicCandidate(
        [ca.SX(p) for p in POSITIONS], [ca.SX(n) for n in NORMALS], [radius] * len(POSITIONS), 1.0
    )
    return [(r.name, float(ca.DM(r.expression)), r.lower, r.upper) for r in constraint.rows(placement)]


def test_table_is_about_the_lowest_point_of_the_tip():
    rows = values(ng.Table(-0.3, clearance=0.01), radius=0.02)
    for i, (name, value, lower, upper) in enumerate(rows):
        tip = POSITIONS[i] - 0.02 * NORMALS[i]
        assert name == f"table, finger {i}"
        assert value == pytest.approx(tip[2] - 0.02)
        assert (lower, upper) == (pytest.approx(-0.29), np.inf)


def test_forbidden_half_space_is_positive_inside():
    rows = values(ng.Forbid(ng.HalfSpace([0.0, 0.0, 2.0], 0.4)))
    np.testing.assert_allclose([r[1] for r in rows], POSITIONS[:, 2] - 0.2)
    assert all(r[3] == 0.0 for r in rows)


def test_forbidden_box_is_positive_inside_only():
    region = ng.BoxRegion([0.2, 0.0, 0.3], [0.5, 0.2, 0.5])
    assert [r[1] > 0.0 for r in values(ng.Forbid(region))] == [True, False, False]


def test_forbidden_expression():
    rows = values(ng.Forbid(lambda p: 0.5 - ca.norm_2(p)))
    np.testing.assert_allclose([r[1] for r in rows], 0.5 - np.linalg.norm(POSITIONS, axis=1))


def test_forbidden_faces_have_no_rows():
    assert values(ng.Forbid("+x")) == []
    assert ng.Forbid(["+x", "-x"]).forbidden_faces() == ("+x", "-x")


def test_spread_is_over_every_pair():
    rows = values(ng.Spread(0.1, 0.9))
    assert [r[0] for r in rows] == ["spread, fingers 0 and 1", "spread, fingers 0 and 2", "spread, fingers 1 and 2"]
    assert rows[0][1] == pytest.approx(np.sum((POSITIONS[0] - POSITIONS[1]) ** 2))
    assert rows[0][2:] == (pytest.approx(0.01), pytest.approx(0.81))


def test_user_constraint_sees_positions_and_normals():
    rows = values(ng.Constraint("opposed", lambda p, n: ca.dot(n[0], n[1]), upper=-0.5))
    assert rows == [("opposed", pytest.approx(NORMALS[0] @ NORMALS[1]), -np.inf, -0.5)]


def test_user_constraint_with_several_elements():
    rows = values(ng.Constraint("level", lambda p, n: [p[0][2] - p[1][2], p[1][2] - p[2][2]], [-1, -2], [1, 2]))
    assert [(r[0], r[2], r[3]) for r in rows] == [("level[0]", -1.0, 1.0), ("level[1]", -2.0, 2.0)]


def test_matrix_limits_belong_to_their_elements():
    """CasADi's vec runs down the columns."""
    upper = [[1, 2], [3, 4], [5, 6]]
    rows = values(ng.Constraint("both", lambda p, n: ca.horzcat(p[0], p[1]), -1, upper))
    assert [r[3] for r in rows] == [1.0, 3.0, 5.0, 2.0, 4.0, 6.0]


def test_fingertips_rows():
    hand = ng.Fingertips(3, radius=0.05, spread=1.0, reach=0.8)
    placement = SymbolicCandidate(
        [ca.SX(p) for p in POSITIONS], [ca.SX(n) for n in NORMALS], [0.05] * len(POSITIONS), 1.0
    )
    rows = hand.rows(placement, {"palm": ca.SX([0.0, 0.0, 0.1])})
    tips = POSITIONS - 0.05 * NORMALS
    assert float(rows[0].expression) == pytest.approx(np.sum((tips[0] - [0, 0, 0.1]) ** 2))
    assert rows[0].upper == pytest.approx(0.64)
    assert rows[3].name == "fingertip distance, fingers 0 and 1"
    assert (rows[3].lower, rows[3].upper) == (pytest.approx(0.01), pytest.approx(1.0))
    np.testing.assert_allclose(hand.start(tips)["palm"], tips.mean(axis=0))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ng.Table("low"), r"Table\.height"),
        (lambda: ng.Table(0.0, clearance=-1.0), r"Table\.clearance"),
        (lambda: ng.Spread(), "a least or a greatest distance"),
        (lambda: ng.Spread(0.5, 0.2), r"Spread\.max"),
        (lambda: ng.Forbid([]), r"Forbid\.faces_or_region"),
        (lambda: ng.Forbid(3), r"Forbid\.faces_or_region"),
        (lambda: ng.HalfSpace([0, 0, 0], 1.0), "non-zero vector"),
        (lambda: ng.BoxRegion([0, 0, 0], [1, 0, 1]), "lower corner below"),
        (lambda: ng.Constraint("", lambda p, n: p[0]), "non-empty name"),
        (lambda: ng.Constraint("x", lambda p, n: p[0], 1.0, 0.0), "lower limits below"),
        (lambda: ng.Constraint("x", "p[0] > 0"), "a function of"),
        (lambda: ng.Constraint("x", lambda p, n: p[0], "low"), "limits that are numbers"),
        (lambda: ng.Constraint("x", lambda p, n: p[0], [0, 0], [1, 1, 1]), "one shape"),
        (lambda: ng.Fingertips(0), r"Fingertips\.count"),
        (lambda: ng.Fingertips(3, radius=-1.0), r"Fingertips\.radius"),
        (lambda: ng.Fingertips(3, spread=(0.2, 0.1)), r"Fingertips\.spread"),
        (lambda: ng.Fingertips(3, reach=0.0), r"Fingertips\.reach"),
    ],
)
def test_bad_constraints_are_refused(make, message):
    with pytest.raises(ng.InputError, match=message):
        make()


def test_workspace_box_is_a_row_a_coordinate():
    rows = values(ng.Workspace(ng.BoxRegion([-1.0, -2.0, 0.0], [1.0, 2.0, 0.5]), fingers=[2]))
    assert [r[0] for r in rows] == [f"workspace, finger 2, {a}" for a in "xyz"]
    np.testing.assert_allclose([r[1] for r in rows], POSITIONS[2])
    assert rows[2][2:] == (0.0, 0.5)


def test_workspace_of_an_expression():
    rows = values(ng.Workspace(lambda p: p[0] - p[1]))
    np.testing.assert_allclose([r[1] for r in rows], POSITIONS[:, 0] - POSITIONS[:, 1])
    assert all(r[2:] == (0.0, np.inf) for r in rows)


def test_spread_of_some_fingers():
    assert [r[0] for r in values(ng.Spread(max=0.5, fingers=[0, 2]))] == ["spread, fingers 0 and 2"]


def test_symmetric_compares_with_the_mirror_image():
    rows = values(ng.Symmetric([0, 1], [2.0, 0.0, 0.0], offset=0.05))
    image = POSITIONS[0] * [-1.0, 1.0, 1.0] + [0.1, 0.0, 0.0]
    np.testing.assert_allclose([r[1] for r in rows], image - POSITIONS[1], atol=1e-15)


def test_obstacle_keeps_tips_off_another_body():
    """A box turned by 90 degrees about z and moved: against the distance to the box by hand."""
    turn = [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]
    obstacle = ng.Obstacle(ng.Box([0.4, 0.2, 2.0]), 0.01, [0.5, 0.0, 0.0], turn, name="wall")
    for i, (name, value, lower, upper) in enumerate(as_rows(obstacle, radius=0.02)):
        tip = POSITIONS[i] - 0.02 * NORMALS[i]
        excess = np.maximum(np.abs(tip - [0.5, 0.0, 0.0]) - [0.1, 0.2, 1.0], 0.0)
        assert name == f"wall, finger {i}"
        assert value == pytest.approx(np.linalg.norm(excess))
        assert (lower, upper) == (pytest.approx(0.03), np.inf)


def as_rows(constraint, radius):
    placement = SymbolicCandidate([ca.SX(p) for p in POSITIONS], [ca.SX(n) for n in NORMALS], [radius] * 3, 1.0)
    rows = [c.as_row() for c in constraint.rows(placement)]
    return [(r.name, float(ca.DM(r.expression)), r.lower, r.upper) for r in rows]


def test_approach_and_palm_workspace_are_about_the_palm():
    palm = PalmPose(ca.SX([0.1, 0.2, 0.3]), ca.SX.eye(3), ca.SX([0.0, 0.6, -0.8]))
    placement = SymbolicCandidate([ca.SX(p) for p in POSITIONS], [ca.SX(n) for n in NORMALS], [0.0] * 3, 1.0, palm=palm)
    (row,) = ng.Approach([0.0, 0.0, -2.0], np.pi / 3.0).rows(placement)
    assert float(ca.DM(row.expression)) == pytest.approx(0.8)
    assert row.lower == pytest.approx(0.5)
    above = ng.Workspace(ng.HalfSpace([0.0, 0.0, 1.0], 0.25), palm=True).rows(placement)
    assert [float(ca.DM(r.expression)) for r in above] == pytest.approx([0.05])


@pytest.mark.parametrize(("rise", "allowed"), [(0.0, True), (0.5, True), (0.6, False)])
def test_jaws_leave_room_for_an_approach_across_their_closing_line(rise, allowed):
    """A line that leans out of the level by less than the angle: atan(0.5) is 26.6 degrees, atan(0.6) 31."""
    line = ca.SX([1.0, 0.0, rise])
    placement = SymbolicCandidate(
        [ca.SX([0, 0, 0]), line], [ca.SX(n) for n in NORMALS[:2]], [0.0] * 2, 1.0, closing=line
    )
    (row,) = ng.Approach([0.0, 0.0, -1.0], np.radians(28.0)).rows(placement)
    assert (float(ca.DM(row.expression)) <= row.upper) is allowed
    assert ng.Approach([0.0, 0.0, -1.0], np.pi / 2.0).rows(placement) == []


def test_table_sees_the_links_and_a_fingertip_once():
    spheres = [LinkSphere("finger/0", ca.SX([0, 0, 0.5]), 0.1)]
    placement = SymbolicCandidate([ca.SX(POSITIONS[0])], [ca.SX(NORMALS[0])], [0.1], 1.0, spheres)
    rows = ng.Table(0.0).rows(placement)
    assert [r.name for r in rows] == ["table, finger 0", "table, finger/0"]
    assert float(ca.DM(rows[1].expression)) == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: ng.Obstacle("table"), "Obstacle.body"),
        (lambda: ng.Obstacle(ng.Sphere(1.0), -1.0), "Obstacle.clearance"),
        (lambda: ng.Obstacle(ng.Sphere(1.0), position=[0, 0]), "Obstacle.position"),
        (lambda: ng.Obstacle(ng.Sphere(1.0), quaternion=[0, 0, 0, 0]), "Obstacle.quaternion"),
        (lambda: ng.Workspace(3), "Workspace.region"),
        (lambda: ng.Workspace(ng.HalfSpace([1, 0, 0], 0.0), fingers=[0, 0]), "Workspace.fingers"),
        (lambda: ng.Approach([0, 0, 0], 1.0), "Approach.direction"),
        (lambda: ng.Approach([0, 0, 1], 4.0), "Approach.angle"),
        (lambda: ng.Symmetric([0], [1, 0, 0]), "Symmetric.fingers"),
        (lambda: ng.Symmetric([0, 1], [0, 0, 0]), "Symmetric.normal"),
        (lambda: ng.Symmetric([0, 1], [1, 0, 0], tolerance=0.0), "Symmetric.tolerance"),
        (lambda: ng.Spread(max=1.0, fingers=[-1, 0]), "Spread.fingers"),
        (lambda: ng.ParallelJaw(0.0), "ParallelJaw.opening"),
        (lambda: ng.ParallelJaw(0.1, tilt=2.0), "ParallelJaw.tilt"),
    ],
)
def test_bad_constraints_of_hands(make, match):
    with pytest.raises(ng.InputError, match=match):
        make()


@pytest.mark.parametrize(
    ("constraint", "match"),
    [
        (ng.Obstacle(ng.Polygon([[0, 0], [1, 0], [0, 1]])), "a body of 2 dimensions"),
        (ng.Workspace(ng.HalfSpace([1, 0], 0.0)), "2 coordinates"),
        (ng.Workspace(ng.HalfSpace([1, 0, 0], -9.0), fingers=[3]), "fingers 0 to 2"),
        (ng.Workspace(ng.HalfSpace([1, 0, 0], -9.0), palm=True), "a hand with a palm"),
        (ng.Symmetric([0, 5], [1, 0, 0]), "fingers 0 to 2"),
        (ng.Symmetric([0, 1], [1, 0]), "3 numbers"),
    ],
)
def test_constraints_that_do_not_fit_the_problem(constraint, match):
    with pytest.raises(ng.InputError, match=match):
        ng.GraspProblem(
            ng.Sphere(1.0), [ng.FrictionContact(0.5)] * 3, ng.TaskEllipsoid([1.0] * 6), constraints=[constraint]
        )
