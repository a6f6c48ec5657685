"""Stated constraints of parts that cannot be recomputed."""

import pytest

import nlpgrasp as ng
from nlpgrasp.verify.recomputation import constraint_owner, hand_owner, links_owner
from tests.verify import honest
from tests.verify.edits import drop, failures, put
from tests.verify.stated import contacts_on, edited, problem_of, stated_file


def add(name):
    def change(data):
        data["constraints"].append({**data["constraints"][0], "name": name, "value": 0.0, "bound": [None, None]})

    return change


FOREIGN = ["table, finger 3", "reach, finger 0", "on fingertip finger_9_tip, finger 3, x", "ceiling, finger 0", "level"]


@pytest.mark.parametrize("name", FOREIGN)
def test_rows_that_no_unknown_part_may_own_fail(name):
    """Without the URDF, hand and links are unknown."""
    data = honest.fingers()
    assert failures(data) == []
    assert failures(edited(data, add(name))) == ["constraints"]


def test_a_body_of_a_script_hides_no_rows_of_others(rng):
    """Of an obstacle that a script states nothing is known but its name."""
    pole = ng.Implicit(lambda p: p[0] ** 2 + p[1] ** 2 + p[2] ** 2 - 1e-4, [[-0.1] * 3, [0.1] * 3])
    constraints = [ng.Table(-0.1), ng.Obstacle(pole, 0.001, [0.0, -0.2, 0.0], name="pole")]
    problem = problem_of(ng.Box([0.08, 0.04, 0.06]), 2, constraints=constraints)
    data = stated_file(problem, ["+x", "-x"], *contacts_on(problem.body, ["+x", "-x"], rng))
    assert failures(data) == []
    assert failures(edited(data, add("pole, finger 5"))) == ["constraints"]
    assert failures(edited(data, put(("problem", "constraints"), lambda c: c[1:]))) == ["constraints"]
    assert failures(edited(data, drop("table, finger 0"))) == ["constraint 0, table"]


def test_who_owns_what():
    table, level = {"type": "table"}, {"type": "expression", "name": "level (a+b)"}
    assert constraint_owner(table, 3)("table, finger 2")
    assert not constraint_owner(table, 3)("table, finger 3")
    assert constraint_owner(level, 3)("level (a+b)[7]")
    assert not constraint_owner(level, 3)("level (a+b), finger 0")
    assert constraint_owner({"type": "ceiling"}, 3)("ceiling, finger 0")
    assert hand_owner({"type": "urdf"}, 3)("on fingertip thumb, finger 2, normal x")
    assert not hand_owner({"type": "urdf"}, 3)("spread, fingers 0 and 1")
    assert hand_owner({"type": "claw"}, 3)("claws, finger 0")
    of_links = links_owner([table, level, {"type": "obstacle", "name": "post"}])
    for name in ("clearance from the body, palm", "table, palm", "post, palm"):
        assert of_links(name)
    for name in ("self-collision, palm and finger_1", "obstacle, palm", "level (a+b), palm", "table, finger 3"):
        assert not of_links(name)
    assert not links_owner([level])("table, palm")
