"""Checks of a gripper with stated sizes: clearance, obstructions, pads on their faces."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.optimize.constraint_values import HandFunctions
from nlpgrasp.verify.gripper_solids import _fraction_on_face
from tests.verify.edits import put
from tests.verify.stated import edited, recomputed_file, stated_file

BODY = ng.Box([0.08, 0.04, 0.06])
GRIPPER = ng.ParallelJaw(stroke=0.08, pad=(0.02, 0.012), finger=(0.06, 0.01, 0.016), palm_size=(0.14, 0.06, 0.05))
TASK = ng.TaskEllipsoid([1.0] * 6)
NORMALS = [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]]


def stated_by(height=0.0, table=-0.031, gripper=GRIPPER, constraints=()):
    """Return the file of a grasp of two sides of a box, at a height above its middle."""
    all_constraints = [ng.Table(table, clearance=0.0), *constraints]
    problem = ng.GraspProblem(BODY, task=TASK, hand=gripper, constraints=all_constraints, edge_margin=0.0)
    points = np.array([[0.01, 0.02, height], [0.01, -0.02, height]])
    data = stated_file(problem, ["+y", "-y"], points, NORMALS)
    return {**data, "hand": HandFunctions(problem).at_contacts(points)}


@pytest.fixture(scope="module")
def data():
    return stated_by()


def test_an_honest_file_passes(data):
    checks = recomputed_file(data)
    for name in ("gripper", "way in", "pads"):
        assert checks[name].passed, checks[name]
    assert data["hand"]["pads"] == pytest.approx([1.0, 1.0])
    assert data["hand"]["approach"]["direction"] == pytest.approx([0.0, 0.0, -1.0])
    assert data["hand"]["approach"]["clearance"] == pytest.approx(0.02)


def test_a_pad_over_an_edge_is_stated_and_said():
    """The pad reaches 10 mm up from contacts 4 mm below the upper edge: 14 of its 20 mm are on the face."""
    data = stated_by(height=0.026)
    assert data["hand"]["pads"] == pytest.approx([0.7, 0.7])
    solution = ng.GraspSolution.from_dict(data)
    assert "70 % of the pad on the face" in solution.caveats
    assert not solution.has_free_way
    assert "70 % and 70 % of the pads on their faces" in str(solution)
    assert recomputed_file(data)["pads"].passed


def test_a_blocked_way_names_what_blocks_it():
    """A table 5 mm below the contacts: the fingers' tips are 5 mm inside it from above, the palm more from the side."""
    data = stated_by(table=-0.005)
    assert data["hand"]["approach"]["blocked_by"] == pytest.approx({"the table": 0.005})
    solution = ng.GraspSolution.from_dict(data)
    assert any("5 mm deep into the table" in words for words in solution.caveats)
    assert recomputed_file(data)["way in"].passed
    lie = edited(data, lambda d: (d["hand"]["approach"].pop("blocked_by"), d["hand"]["approach"].update(depth=0.0)))
    assert "inside the table" in recomputed_file(lie)["way in"].detail


LIES = {
    "way in": [
        put(("hand", "approach", "clearance"), 0.05),
        put(("hand", "approach", "opened"), 0.2),
        put(("hand", "approach", "depth"), 0.003),
        lambda d: d["grasp"]["contacts"][0]["tangents"].reverse(),
    ],
    "pads": [put(("hand", "pads"), [1.0, 0.8]), lambda d: d["hand"].pop("pads")],
}


@pytest.mark.parametrize(("name", "lie"), [(name, lie) for name, lies in LIES.items() for lie in lies])
def test_lies_fail(data, name, lie):
    checks = recomputed_file(edited(data, lie))
    assert any(check.failed for key, check in checks.items() if key in (name, "way in")), checks


def test_a_wall_in_the_way_that_is_not_stated_is_found(data):
    wall = ng.Obstacle(ng.Box([0.2, 0.01, 0.2]), 0.0, [0.0, 0.028, 0.05], name="wall")
    walled = edited(data, lambda d: d["problem"]["constraints"].append(wall.to_dict()))
    assert "inside wall" in recomputed_file(walled)["way in"].detail


def test_contacts_default_to_the_pads():
    problem = ng.GraspProblem(BODY, task=TASK, hand=replace(GRIPPER, pad_friction=0.3))
    model = ng.PlaneContact(extents=(0.02, 0.012), friction=0.3, direction=(0.0, 0.0, -1.0))
    assert problem.models == (model, model)
    assert problem.margin == pytest.approx(0.4 * 0.012)
    sideways = ng.GraspProblem(BODY, task=TASK, hand=GRIPPER, constraints=ng.Approach([1.0, 0.0, 0.0], 0.1))
    assert sideways.models[0].direction == (1.0, 0.0, 0.0)
    with pytest.raises(ng.InputError, match="contact models"):
        ng.GraspProblem(BODY, task=TASK, hand=ng.ParallelJaw(0.08))


def test_a_gripper_with_pads_lies_flat():
    assert (ng.ParallelJaw(0.08).tilt, GRIPPER.tilt) == (0.05, 0.002)


def test_other_contacts_leave_every_turn():
    soft = ng.GraspProblem(BODY, ng.SoftContact(0.5, 0.004), TASK, hand=GRIPPER, edge_margin=0.0)
    points = np.array([[0.01, 0.02, 0.0], [0.01, -0.02, 0.0]])
    wall = ng.Obstacle(ng.Box([0.3, 0.3, 0.01]), 0.0, [0.0, 0.0, 0.06], name="lid")
    hand = HandFunctions(replace(soft, constraints=(wall,))).at_contacts(points)
    assert abs(hand["approach"]["direction"][2]) < 0.99
    assert "blocked_by" not in hand["approach"]


def test_without_the_body_way_in_and_pads_are_not_checked(data):
    lost = edited(data, lambda d: d["problem"].update(body={"type": "mesh", "source": "lost.stl"}))
    checks = recomputed_file(lost)
    assert [checks[name].made for name in ("way in", "pads")] == [False, False]


def test_a_pad_partly_inside_the_part_is_on_its_face_with_the_rest():
    """A block on a plate of 80 mm: the pad's lower 5 mm are inside the plate."""
    plates = [trimesh.creation.box([0.08, 0.08, 0.01]), trimesh.creation.box([0.03, 0.03, 0.02])]
    plates[1].apply_translation([0.0, 0.0, 0.01])
    body = ng.Mesh(trimesh.boolean.union(plates))
    points = np.array([[-0.015, 0.0, 0.01], [0.015, 0.0, 0.01]])
    problem = ng.GraspProblem(body, task=TASK, hand=GRIPPER, edge_margin=0.0)
    shares = HandFunctions(problem).at_contacts(points)["pads"]
    assert shares == pytest.approx([0.75, 0.75], abs=1e-6)  # from 0 to 20 mm, of which the plate takes 5
    frame = np.column_stack([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    own = _fraction_on_face(body.clearance, points[0], frame[:, 0], frame, GRIPPER.pad, 5e-4)
    assert own == pytest.approx(0.75, abs=0.03)
