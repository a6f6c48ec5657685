"""Every constraint as numbers, and what is refused."""

import casadi as ca
import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.rows import Placement

POSITIONS = np.array([[0.3, 0.1, 0.4], [-0.2, 0.5, -0.1], [0.0, -0.6, 0.2]])
NORMALS = -POSITIONS / np.linalg.norm(POSITIONS, axis=1, keepdims=True)


def values(constraint, radius=0.0):
    """Return (name, value, lower, upper) of each row at the sample placement."""
    placement = Placement([ca.SX(p) for p in POSITIONS], [ca.SX(n) for n in NORMALS], [radius] * len(POSITIONS), 1.0)
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
    placement = Placement([ca.SX(p) for p in POSITIONS], [ca.SX(n) for n in NORMALS], [0.05] * len(POSITIONS), 1.0)
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
