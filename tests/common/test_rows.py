"""Labels of scalar constraints in reports and files."""

import casadi as ca
import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.scalar_constraints import (
    CLEARANCE,
    ON_FINGERTIP,
    Clearance,
    Label,
    LinkSphere,
    PalmPose,
    ScalarConstraint,
    SymbolicCandidate,
)
from nlpgrasp.hands.tips import SymbolicTouch
from nlpgrasp.nlp import optimal_grasp_program
from nlpgrasp.problem.candidate_constraints import build_candidate_constraints
from tests.hands.urdf import four_finger_hand

BALL = ng.TaskEllipsoid([1.0] * 6)


def placement(k=2, space=3):
    """Return k contacts of a hand with one link and a palm."""
    p = [ca.SX(np.arange(space) + i) for i in range(k)]
    palm = PalmPose(ca.SX.zeros(3), ca.SX.eye(3), ca.SX([0, 0, 1]))
    return SymbolicCandidate(
        p, [ca.SX(np.eye(space)[0])] * k, [0.01] * k, 1.0, [LinkSphere("link/3", p[0], 0.02)], palm
    )


def names(part):
    return [row.name for row in part.rows(placement())]


@pytest.mark.parametrize(
    ("label", "name"),
    [
        (Label("opposed jaws"), "opposed jaws"),
        (Label("table", fingers=(2,)), "table, finger 2"),
        (Label("table", link="link/3"), "table, link/3"),
        (Label("spread", fingers=(0, 1)), "spread, fingers 0 and 1"),
        (Label("workspace", fingers=(1,), part="x"), "workspace, finger 1, x"),
        (Label("workspace", link="palm", part="z"), "workspace, palm, z"),
        (Label(ON_FINGERTIP, fingers=(0,), link="tip", part="x"), "on fingertip tip, finger 0, x"),
        (Label(CLEARANCE, fingers=(1,), link="tip"), "clearance from the body, tip, finger 1"),
        (Label("level", part="[4]"), "level[4]"),
        (
            Label("torque limit", fingers=(1,), part="joint 0, direction 3"),
            "torque limit, finger 1, joint 0, direction 3",
        ),
    ],
)
def test_a_label_written_out(label, name):
    assert label.name == name


@pytest.mark.parametrize(
    ("constraint", "expected"),
    [
        (ng.Table(0.0), ["table, finger 0", "table, finger 1", "table, link/3"]),
        (ng.Spread(0.1), ["spread, fingers 0 and 1"]),
        (ng.Forbid(ng.HalfSpace([1, 0, 0], 0.0)), ["forbidden region, finger 0", "forbidden region, finger 1"]),
        (ng.Forbid("+x"), []),
        (ng.Workspace(ng.HalfSpace([1, 0, 0], 0.0), [1]), ["workspace, finger 1"]),
        (ng.Workspace(ng.BoxRegion([0] * 3, [1] * 3), [0]), [f"workspace, finger 0, {a}" for a in "xyz"]),
        (ng.Workspace(ng.BoxRegion([0] * 3, [1] * 3), palm=True), [f"workspace, palm, {a}" for a in "xyz"]),
        (ng.Symmetric([1, 0], [1, 0, 0]), [f"symmetric, fingers 1 and 0, {a}" for a in "xyz"]),
        (ng.Approach([0, 0, 1], 1.0), ["approach, palm"]),
        (ng.Obstacle(ng.Box([1, 1, 1]), name="wall"), ["wall, finger 0", "wall, finger 1", "wall, link/3"]),
        (ng.Constraint("level", lambda p, n: p[0][2] - p[1][2]), ["level"]),
        (ng.Constraint("both", lambda p, n: p[0][:2]), ["both[0]", "both[1]"]),
    ],
)
def test_constraints_rows(constraint, expected):
    assert names(constraint) == expected


def test_a_constraints_rows_are_of_one_kind():
    assert {row.kind for row in ng.Table(0.0).rows(placement())} == {"table"}
    assert {row.kind for row in ng.Constraint("a, b", lambda p, n: p[0]).rows(placement())} == {"a, b"}
    assert [row.fingers for row in ng.Table(0.0).rows(placement())] == [(0,), (1,), ()]
    assert [row.link for row in ng.Obstacle(ng.Box([1, 1, 1])).rows(placement())] == ["", "", "link/3"]


def test_hands_of_fingertips_and_jaws():
    hand = ng.Fingertips(2, radius=0.01, reach=0.5)
    rows = hand.rows(placement(), {"palm": ca.SX.zeros(3)})
    assert [r.name for r in rows] == ["reach, finger 0", "reach, finger 1", "fingertip distance, fingers 0 and 1"]
    rows = ng.ParallelJaw(0.1).rows(placement(), {})
    assert [r.name for r in rows] == ["opening of the jaws", "opposed jaws", "facing, jaw 0", "facing, jaw 1"]


@pytest.mark.parametrize(
    ("tip", "parts"),
    [
        (ng.SphereTip(0.01), ["x", "y", "z"]),
        (ng.EllipsoidTip([0.01] * 3, facing=[0, 0, 1]), ["x", "y", "z", "within the patch"]),
        (ng.CylinderTip(0.01, [0, 0, 0], [0, 0, 1]), ["x", "y", "z", "across"]),
        (ng.FlatTip([0.01, 0.02]), ["normal x", "normal y", "facing", "plane", "extent x", "extent y"]),
    ],
)
def test_fingertips(tip, parts):
    rows = tip.rows(SymbolicTouch("tip", 3, ca.SX.eye(4), ca.SX([0, 0, 1]), ca.SX([0, 0, 1]), ca.SX(0.5), 1.0))
    assert [r.name for r in rows] == [f"on fingertip tip, finger 3, {part}" for part in parts]
    assert {(r.kind, r.fingers, r.link) for r in rows} == {(ON_FINGERTIP, (3,), "tip")}


def test_a_hand_with_links():
    hand, box = four_finger_hand(), ng.Box([0.08, 0.04, 0.04])
    k = hand.count
    p, n = ([ca.SX.sym(name, 3) for _ in range(k)] for name in "pn")
    rows = build_candidate_constraints(box, [], hand, p, n, hand.symbols(box.bounds)).named
    assert {row.kind for row in rows} == {"palm quaternion of unit length", ON_FINGERTIP}


def test_a_clearance_is_the_row_of_its_distance():
    item = Clearance("wall", ng.Sphere(1.0).distance_function, ca.SX([3, 0, 0]), 0.5, 2.0, fingers=(1,))
    row = item.as_row()
    assert (row.name, row.lower, row.upper, row.scale, row.unit) == ("wall, finger 1", 0.5, np.inf, 2.0, "m")
    assert float(ca.DM(row.expression)) == pytest.approx(2.0)
    assert item.row(None).name == "wall, finger 1"


def test_the_first_argument_of_a_row_may_be_all_of_its_name():
    assert ScalarConstraint("my own rule", ca.SX(1.0), 0.0).name == "my own rule"


@pytest.mark.parametrize(
    ("budget", "expected"),
    [
        ("l2", ["force budget, direction 1"]),
        ("shared", ["force budget, direction 1"]),
        ("per_finger", ["force budget, finger 0, direction 1", "force budget, finger 1, direction 1"]),
        ("per_finger_size", ["force budget, finger 0, direction 1", "force budget, finger 1, direction 1"]),
        (
            ng.JointTorqueLimits([np.eye(3)[:, :1]] * 2, 1.0),
            ["torque limit, finger 0, joint 0, direction 1", "torque limit, finger 1, joint 0, direction 1"],
        ),
        (
            ng.SharedJointTorqueLimits([np.eye(3)[:, :1]] * 2, 1.0, 5.0),
            [
                "torque limit, joint 0, direction 1",
                "force limit, finger 0, direction 1",
                "force limit, finger 1, direction 1",
            ],
        ),
    ],
)
def test_rows_of_budgets_in_a_program(budget, expected):
    problem = ng.GraspProblem(ng.Sphere(0.03), [ng.FrictionContact(0.5)] * 2, BALL, force_budget=budget)
    program = optimal_grasp_program(problem, "vertex", 2)
    kinds = ("force budget", "torque limit", "force limit")
    rows = [b.name for b in program.rows if b.kind in kinds]
    assert [name for name in rows if name.endswith("direction 1")] == expected


def test_blocks_of_a_program_are_found_by_kind_and_index():
    hand = ng.Fingertips(2, reach=0.1)
    problem = ng.GraspProblem(ng.Box([0.1] * 3), [ng.FrictionContact(0.5)] * 2, BALL, hand=hand)
    program = optimal_grasp_program(problem, "support", 3, eliminated=True)
    assert [b.name for b in program.variables] == [
        "position 0",
        "position 1",
        "normal 0",
        "normal 1",
        "hand palm",
        "beta",
    ]
    assert [b.name for b in program.parameters] == ["directions", "reach", "face 0", "face 1"]
    assert program.block("normal", 1) == program.blocks("normal")[1]
    assert program.hand_blocks == [("palm", program.block("hand", "palm"))]
    assert program.constraint_indices("support") == [0, 1, 2]
    assert [program.constraint_name(i) for i in program.constraint_indices("support")] == [
        f"support, direction {j}" for j in range(3)
    ]
    assert [program.constraint_name(i) for i in program.constraint_indices("reach")] == [
        "reach, finger 0",
        "reach, finger 1",
    ]
    assert len(program.constraint_indices("extent of the face")) == 8
