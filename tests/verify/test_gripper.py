"""Checks of the pose and the approach of parallel jaws."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nlpgrasp as ng
from nlpgrasp.motion.distance_fields import build_distance_fields, distance_to_all
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.solution.obstructions import approach_obstructions
from tests.verify.stated import edited, problem_of, recomputed_file, stated_file

BODY = ng.Box([0.08, 0.04, 0.06])
CONSTRAINTS = [
    ng.Table(-0.031),
    ng.Obstacle(ng.Box([0.2, 0.2, 0.02]), 0.0, [0.0, 0.0, 0.06]),
    ng.Constraint("level", lambda p, n: p[0][2] - p[1][2], 0.0, 0.0),
]


def stated_by(constraints=CONSTRAINTS, **axes):
    hand = ng.ParallelJaw(0.05, finger_length=0.04, finger_thickness=0.02, **axes)
    points, normals = np.array([[0.01, 0.02, 0.0], [0.01, -0.02, 0.0]]), [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]]
    problem = problem_of(BODY, 2, hand=hand, constraints=constraints)
    found = stated_file(problem, ["+y", "-y"], points, normals)
    return {
        **found,
        "hand": hand.at_contacts(points, BODY.size, distance_to_all(build_distance_fields(BODY, constraints, 2))),
    }


@pytest.fixture(scope="module")
def data():
    return stated_by()


AXES = {"closing_axis": "y"}, {"closing_axis": "-y", "approach_axis": "x"}, {"closing_axis": (0.6, 0.8, 0.0)}
POINTS = (0.0, 0.0, 0.1034), (0.02, -0.01, 0.05)


@pytest.mark.parametrize("axes", AXES)
def test_the_pose_of_a_gripper_with_other_axes(axes, data):
    own = stated_by(**axes)
    assert recomputed_file(own)["gripper"].passed, recomputed_file(own)["gripper"]
    for hand, pose in ((data["problem"]["hand"], own["hand"]), (own["problem"]["hand"], data["hand"])):
        lie = edited(own, lambda d, hand=hand, pose=pose: (d["problem"].update(hand=hand), d.update(hand=pose)))
        check = recomputed_file(lie)["gripper"]
        assert check.failed
        assert "along the closing line and " in check.detail


@pytest.mark.parametrize("tcp", POINTS)
def test_the_pose_of_a_gripper_with_another_tool_centre_point(tcp, data):
    own = stated_by(tcp=tcp, closing_axis="y")
    assert recomputed_file(own)["gripper"].passed, recomputed_file(own)["gripper"]
    moved_by_little = edited(own, lambda d: d["problem"]["hand"]["tcp"].__setitem__(0, tcp[0] + 1e-5))
    for lie in (moved_by_little, edited(own, lambda d: d["problem"]["hand"].pop("tcp"))):
        check = recomputed_file(lie)["gripper"]
        assert check.failed
        assert "tool centre point is not the middle between the contacts" in check.detail


def test_a_file_without_axes_and_tool_centre_point_passes(data):
    older = edited(data, lambda d: [d["problem"]["hand"].pop(key) for key in ("closing_axis", "approach_axis", "tcp")])
    assert recomputed_file(older)["gripper"].passed
    assert ng.GraspSolution.from_dict(older).gripper_frame_line() == ""
    stated = "closing axis x, approach axis z, tool centre point [0, 0, 40] mm"
    assert ng.GraspSolution.from_dict(data).gripper_frame_line().endswith(stated)


@pytest.mark.parametrize(
    "axes", [{"closing_axis": "u"}, {"closing_axis": [0, 2, 0]}, {"closing_axis": "z"}, {"tcp": [0.0, "far", 0.0]}]
)
def test_axes_that_are_none_fail(axes, data):
    assert recomputed_file(edited(data, lambda d: d["problem"]["hand"].update(axes)))["gripper"].failed


def test_an_honest_pose_passes(data):
    checks = recomputed_file(data)
    assert checks["gripper"].passed, checks["gripper"]
    assert checks["way in"].passed, checks["way in"]
    assert "gripper" not in recomputed_file({**data, "hand": None})  # files of earlier versions


def turned(hand):
    quaternion = Rotation.from_quat(hand["palm_pose"]["quaternion_wxyz"], scalar_first=True)
    other = (quaternion * Rotation.from_rotvec([0.0, 0.0, 1e-3])).as_quat(scalar_first=True).tolist()
    return {**hand, "palm_pose": {**hand["palm_pose"], "quaternion_wxyz": other}}


def moved(hand):
    return {**hand, "palm_pose": {**hand["palm_pose"], "position": [0.0, 0.0, 0.04]}}


def way(hand, **lie):
    return {**hand, "approach": {**hand["approach"], **lie}}


LIES = {
    "another opening": (lambda hand: {**hand, "opening": 0.041}, "gripper", "opening 0.041 m stated"),
    "a longer direction": (lambda hand: way(hand, direction=[0.0, 0.0, -1.1]), "gripper", "no unit direction"),
    "along the line": (lambda hand: way(hand, direction=[0.0, 1.0, 0.0]), "gripper", "not at right angles"),
    "elsewhere": (moved, "gripper", "not the middle"),
    "turned": (turned, "gripper", "other axes"),
    "freer": (lambda hand: way(hand, depth=hand["approach"]["depth"] + 1e-3), "way in", "found"),
    "through the shelf": (lambda hand: way(hand, direction=[0.0, 0.0, -1.0]), "way in", "found"),
    "through the table": (lambda hand: way(hand, direction=[0.0, 0.0, 1.0]), "way in", "found"),
}


@pytest.mark.parametrize("name", LIES)
def test_lies_about_the_gripper(name, data):
    change, check_name, message = LIES[name]
    check = recomputed_file(edited(data, lambda d: d.update(hand=change(d["hand"]))))[check_name]
    assert check.failed
    assert message in check.detail


@pytest.mark.parametrize("thickness", [1e-4, 3e-4])
@pytest.mark.parametrize("height", [0.05, 0.0637, 0.09])
def test_a_thin_plate_that_is_left_out_is_found(thickness, height):
    plate = ng.Obstacle(ng.Box([0.4, 0.4, thickness]), 0.0, [0.0, 0.0, height], name="plate")
    data = stated_by([plate])
    assert recomputed_file(data)["way in, thin things"].passed
    down = edited(data, lambda d: d["hand"]["approach"].update(direction=[0.0, 0.0, -1.0], depth=0.0))
    checks = recomputed_file(down)
    assert checks["way in"].passed
    assert checks["way in, thin things"].failed


def test_without_the_body_the_way_in_is_not_judged(data):
    """Of a mesh that is not there the pose is checked, its way in is not."""
    mesh = {"type": "mesh", "source": "gone.stl", "unit": "m", "sha256": "0" * 64}
    checks = recomputed_file(edited(data, lambda d: d["problem"].update(body=mesh)))
    assert checks["gripper"].passed
    assert not checks["way in"].made


FLAT, HANDED = ng.Box([0.08, 0.04, 0.012]), ng.ParallelJaw(0.05, finger_length=0.04, finger_thickness=0.02)


@pytest.fixture(scope="module")
def flat():
    """Jaws on a flat part from above and below: the lower finger, 20 mm thick, is 15.5 mm deep in a table."""
    points, normals = np.array([[0.03, 0.0, 0.006], [0.03, 0.0, -0.006]]), [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]
    around = [ng.Table(-0.011, 5e-4), ng.Obstacle(ng.Box([0.02, 0.02, 0.02]), 0.0, [0.2, 0.0, 0.3], name="far post")]
    problem = problem_of(FLAT, 2, hand=HANDED, constraints=around)
    functions = CompiledProblem(problem, ng.SolveOptions()).hand_functions
    posture = functions.name_obstacles(points, functions.at_contacts(points))
    return {**stated_file(problem, ["+z", "-z"], points, normals), "hand": posture}


def test_what_blocks_the_way_is_named_with_its_depth(flat):
    assert flat["hand"]["approach"]["blocked_by"] == {"the table": pytest.approx(0.0155, abs=1e-6)}
    text = approach_obstructions(flat["hand"])[0]
    assert text.startswith("the gripper's way in leads 16 mm deep into the table (clearance included")
    check = recomputed_file(flat)["way in, what blocks it"]
    assert check.passed, check
    assert "the table by 15.5 mm" in check.detail


@pytest.mark.parametrize("lie", [{"the table": 0.004}, {}, {"far post": 0.0155}, {"the body": 0.0155}])
def test_another_name_or_depth_of_what_blocks_it_is_a_lie(flat, lie):
    stated = edited(flat, lambda d: d["hand"]["approach"].update(blocked_by=lie))
    check = recomputed_file(stated)["way in, what blocks it"]
    assert check.failed
    assert "the table" in check.detail
