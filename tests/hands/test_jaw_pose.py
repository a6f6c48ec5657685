"""Pose and approach of a parallel-jaw gripper: pads on the contacts, clear of body, tables and obstacles."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nlpgrasp as ng
from nlpgrasp.hands import hand_from_dict
from nlpgrasp.hands.parallel_jaw import Jaws
from nlpgrasp.hands.presets import JAWS
from nlpgrasp.motion.distance_fields import build_distance_fields, distance_to_all
from nlpgrasp.solution.obstructions import format_gripper_frame

BODY = ng.Box([0.08, 0.04, 0.06])
PADS = np.array([[0.0, 0.02, 0.0], [0.0, -0.02, 0.0]])
ABOVE = ng.Obstacle(ng.Box([0.2, 0.2, 0.02]), 0.0, [0.0, 0.0, 0.06], name="shelf")


def posture(hand=None, constraints=(), body=BODY, points=PADS, cones=()):
    """The pose of a gripper whose pads are at some points of a body."""
    distance = distance_to_all(build_distance_fields(body, constraints, 2))
    return (hand or ng.ParallelJaw(0.05)).at_contacts(np.asarray(points), body.size, distance, cones)


@pytest.mark.parametrize("turn", [[0.0, 0.0, 0.0], [0.4, -0.3, 0.7], [0.0, np.pi, 0.0]])
def test_the_pads_are_on_the_contacts_in_the_grippers_frame(turn):
    points = Rotation.from_rotvec(turn).apply(PADS) + np.array([0.01, 0.0, 0.02])
    hand_data = posture(ng.ParallelJaw(0.05, finger_length=0.07), body=ng.Sphere(0.025), points=points)
    pose = hand_data["palm_pose"]
    turned = Rotation.from_quat(pose["quaternion_wxyz"], scalar_first=True)
    local = turned.inv().apply(points - np.array(pose["position"]))
    np.testing.assert_allclose(local, [[-0.02, 0.0, 0.07], [0.02, 0.0, 0.07]], atol=1e-12)
    np.testing.assert_allclose(turned.apply([0.0, 0.0, 1.0]), hand_data["approach"]["direction"], atol=1e-12)
    assert hand_data["opening"] == pytest.approx(0.04)


def test_the_approach_is_the_shortest_way_over_the_body():
    """Along y the pads leave the box sooner up than sideways; of up and down down the last axis is taken."""
    np.testing.assert_allclose(posture()["approach"]["direction"], [0.0, 0.0, -1.0], atol=1e-12)
    assert posture()["approach"]["depth"] == pytest.approx(0.0, abs=1e-12)
    lying = posture(body=ng.Box([0.06, 0.04, 0.2]))
    np.testing.assert_allclose(np.abs(lying["approach"]["direction"]), [1.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(("height", "down"), [(0.05, True), (0.06, False)])
def test_straight_down_is_taken_where_it_is_nearly_as_clear(height, down):
    """From aside a gripper is soon clear of a slender box; of one that is a little lower it comes from above."""
    body = ng.Box([0.04, 0.04, height])
    hand_data = posture(constraints=[ng.Table.under(body)], body=body, points=[[0.02, 0, 0], [-0.02, 0, 0]])
    assert (hand_data["approach"]["direction"][2] < -0.999) is down


@pytest.mark.parametrize("height", [-0.031, -0.05])
def test_a_table_is_approached_from_its_free_side(height):
    hand_data = posture(constraints=[ng.Table(height), ng.Spread(0.0, 1.0)])
    assert hand_data["approach"]["direction"][2] < 0.0
    assert hand_data["approach"]["depth"] == pytest.approx(0.0, abs=1e-12)


def test_between_a_table_and_a_shelf_the_gripper_comes_from_the_side():
    hand = ng.ParallelJaw(0.05, finger_length=0.08, finger_thickness=0.008)
    hand_data = posture(hand, [ng.Table(-0.031), ABOVE])
    assert abs(hand_data["approach"]["direction"][2]) < 0.3
    assert hand_data["approach"]["depth"] < 0.02 * BODY.size
    shelf, floor = 0.05, -0.0315  # lower face of the shelf, the table and a thin finger's room
    ends = np.array(PADS) - np.outer([1.0, 1.0], hand_data["approach"]["direction"]) * 0.08
    assert np.all((ends[:, 2] < shelf) & (ends[:, 2] > floor))


def test_what_is_in_the_way_on_all_sides_is_told():
    """In a hollow cube of half-width 0.2 m whose walls are 0.1 m thick, a way of 0.16 m back and up leads into one."""
    walls = [
        ng.Obstacle(ng.Box(np.where(np.eye(3)[i] > 0, 0.02, 0.3)), 0.0, sign * 0.08 * np.eye(3)[i], name=f"{i} {sign}")
        for i in range(3)
        for sign in (-1.0, 1.0)
    ]
    assert posture(constraints=walls)["approach"]["depth"] > 0.005


def corners(jaws, approach, path_length):
    """Corners of both fingers, flat boxes from the pads back."""
    (p, q), closing = jaws.points, jaws.closing
    faces = (p, p - jaws.thickness * closing, q, q + jaws.thickness * closing)
    return np.array([face - back * approach for face in faces for back in (0.0, path_length)])


@pytest.mark.parametrize("seed", range(6))
def test_depth_in_a_table_is_that_of_the_fingers_corners(seed):
    """Boxes of any thickness and length about a ball, in any direction, against the half space and its clearance."""
    rng = np.random.default_rng(seed)
    ball = ng.Sphere(0.02)
    closing = rng.normal(size=3)
    closing /= np.linalg.norm(closing)
    jaws = Jaws(-0.02 * np.outer([1, -1], closing), *rng.uniform([0.03, 0.004], [0.09, 0.03]))
    height, clearance = rng.uniform([-0.06, 0.0], [-0.005, 0.02])
    distance = distance_to_all(build_distance_fields(ball, [ng.Table(height, clearance)], 2))
    directions = jaws.approaches()
    depth, _, through = jaws.march_outwards(directions, ball.size, distance)
    low = [corners(jaws, d, jaws.length + 2.0 * ball.size)[:, 2].min() for d in directions]
    np.testing.assert_allclose(depth, np.maximum(height + clearance - np.array(low), 0.0), atol=1e-8)
    assert np.any(depth > 0.0)
    assert not np.any(through & (depth < 1e-8))


@pytest.mark.parametrize(("above", "depth"), [(5e-3, 0.0), (4.5e-3, 0.0), (1.5e-3, 3e-3)])
def test_a_gripper_that_has_the_room_asked_for_is_not_in_the_tables_way(above, depth):
    """Fingers 20 mm thick beside the part, as far above a table as contacts are to be: no half finger counts there."""
    points, hand = PADS - [0.0, 0.0, 0.025], ng.ParallelJaw(0.05, finger_length=0.06, finger_thickness=0.02)
    table = ng.Table(-0.025 - above, clearance=4.5e-3)
    approach = posture(hand, [table], points=points)["approach"]
    assert approach["depth"] == pytest.approx(depth, abs=1e-9)
    assert approach["direction"][2] < 0.0


def plate(thickness, height):
    return ng.Obstacle(ng.Box([0.4, 0.4, thickness]), 0.0, [0.0, 0.0, height], name="plate")


@pytest.mark.parametrize("thickness", [3e-4, 4e-3, 0.03])
def test_one_walk_finds_depth_and_what_is_passed_through(thickness):
    """Plates on the way from above, at any height: half of them deep, entered however thin; beside them all is free."""
    jaws = Jaws(PADS, 0.05, 0.01)
    for height in np.linspace(0.06, 0.14, 7):
        distance = distance_to_all(build_distance_fields(BODY, [plate(thickness, height)], 2))
        directions = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
        depth, mean, through = jaws.march_outwards(directions, BODY.size, distance)
        np.testing.assert_allclose(depth, [0.5 * thickness, 0.0], atol=1.3e-4)
        assert through.tolist() == [True, False]
        assert mean[1] > 0.0


@pytest.mark.slow
def test_depth_is_that_of_a_dense_walk():
    """Among balls, against points a tenth of a millimetre apart on both fingers and the palm."""
    rng = np.random.default_rng(1)
    radii, centres = rng.uniform(4e-3, 0.02, 12), 0.06 * rng.normal(size=(12, 3))
    balls = [ng.Obstacle(ng.Sphere(r), 0.0, centre) for r, centre in zip(radii, centres, strict=True)]
    distance = distance_to_all(build_distance_fields(BODY, balls, 2))
    jaws = Jaws(PADS, 0.05, 0.01)
    directions = jaws.approaches()[::6]
    path_length = jaws.length + 2.0 * BODY.size
    for direction, depth in zip(directions, jaws.march_outwards(directions, BODY.size, distance)[0], strict=True):
        fingers = (np.arange(0.02, 0.0301, 5e-4), np.arange(0.0, path_length, 1e-4))
        palm = (np.arange(0.0, 0.02, 5e-4), np.arange(jaws.length, path_length, 1e-4))
        grids = [np.stack(np.meshgrid(*places), axis=-1).reshape(-1, 2) for places in (fingers, palm)]
        across, back = np.concatenate(grids).T
        lines = [s * across[:, None] * jaws.closing - back[:, None] * direction for s in (-1.0, 1.0)]
        true = max(0.0, -float(min(distance(points).min() for points in lines)))
        assert true - 1e-3 <= depth <= true + 1e-4


def test_the_palm_does_not_go_through_the_body():
    """Fingers shorter than the body is deep: across its short side there is no room for the palm, along it there is."""
    tall = ng.Box([0.03, 0.04, 0.2])
    hand_data = posture(ng.ParallelJaw(0.05, finger_length=0.03), body=tall)
    np.testing.assert_allclose(np.abs(hand_data["approach"]["direction"]), [1.0, 0.0, 0.0], atol=1e-12)
    deep = posture(ng.ParallelJaw(0.05, finger_length=0.03), body=ng.Box([0.2, 0.04, 0.2]))
    assert deep["approach"]["depth"] == pytest.approx(0.02, abs=2e-3)  # the palm's line is in the middle of 0.04 m


def test_a_planar_body_has_two_sides_to_come_from():
    square = ng.Polygon([[-0.02, -0.02], [0.02, -0.02], [0.02, 0.02], [-0.02, 0.02]])
    hand_data = posture(constraints=[ng.Table(-0.021)], body=square, points=[[0.02, 0.0], [-0.02, 0.0]])
    np.testing.assert_allclose(hand_data["approach"]["direction"], [0.0, -1.0], atol=1e-15)
    assert "palm_pose" not in hand_data


def test_files_of_jaws_without_fingers_still_load():
    old = {"type": "parallel_jaw", "opening": 0.08, "closed": 0.0, "tilt": 0.05}
    assert hand_from_dict(old) == ng.ParallelJaw(0.08)
    with pytest.raises(ng.InputError, match=r"ParallelJaw\.finger_length"):
        ng.ParallelJaw(0.08, finger_length=-0.01)


@pytest.mark.slow
def test_a_solution_states_the_pose_of_its_grasps(tmp_path):
    hand = ng.ParallelJaw(0.05, finger_length=0.04)
    contact, task = ng.SoftContact(0.6, 0.005), ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])
    problem = ng.GraspProblem(BODY, contact, task, hand=hand, constraints=[ng.Table(-0.031)])
    options = ng.SolveOptions(workers=1, rounds=0, final_rtol=0.05)
    solution = ng.solve(problem, starts=1, options=options, keep=3)
    assert solution.success
    for candidate in solution.grasps:
        p, q = candidate.grasp.points
        assert candidate.hand["opening"] == pytest.approx(float(np.linalg.norm(p - q)))
        approach = np.array(candidate.hand["approach"]["direction"])
        np.testing.assert_allclose(candidate.hand["palm_pose"]["position"], (p + q) / 2 - 0.04 * approach, atol=1e-12)
        assert approach[2] < 1e-9
    again = ng.GraspSolution.load(solution.save(tmp_path / "jaws.json"))
    assert again.hand == json.loads(json.dumps(solution.hand))
    checks = {check.name: check for check in ng.verify(again).checks}
    assert checks["gripper"].passed
    assert checks["way in"].passed


@pytest.mark.parametrize("wanted", [[0.6, 0.0, -0.8], [-0.28, 0.0, 0.96], [0.6, 0.48, -0.64]])
def test_the_way_in_is_within_the_cone_that_is_asked_for(wanted):
    """However narrow: of a direction that leans along the closing line the nearest across it."""
    for angle in (0.01, 0.2, 1.0):
        direction = np.array(posture(cones=[(np.array(wanted), angle)])["approach"]["direction"])
        assert abs(direction[1]) < 1e-9
        tilt = np.arccos(np.clip(direction @ wanted, -1.0, 1.0))
        assert tilt <= max(angle, np.arcsin(abs(wanted[1]))) + 1e-6


OPTIONS = ng.SolveOptions(workers=1, global_bound=False)
SOFT = [ng.SoftContact(0.6, 0.005)] * 2


@pytest.mark.slow
def test_contacts_leave_room_for_a_gripper_from_above():
    """Flat, the box is best held by top and bottom; jaws that come down can hold its sides alone."""
    body = ng.Box([0.06, 0.06, 0.04])
    task = ng.TaskEllipsoid([1.0, 1.0, 0.2, 0.03, 0.03, 0.03])
    unconstrained, above = (
        ng.solve(
            ng.GraspProblem(body, SOFT, task, hand=ng.ParallelJaw(0.08), constraints=constraints), 2, options=OPTIONS
        )
        for constraints in ([], [ng.Approach([0, 0, -1], 0.3)])
    )
    closing = np.diff(above.grasp.points, axis=0)[0]
    assert abs(closing[2]) <= np.sin(0.3) * np.linalg.norm(closing) + 1e-6
    assert above.hand["approach"]["direction"][2] <= -np.cos(0.3) + 1e-6
    assert unconstrained.mu.upper >= above.mu.lower
    verification = ng.verify(above)
    assert verification.passed, str(verification)
    data = json.loads(json.dumps(above.to_dict()))
    data["hand"]["approach"]["direction"] = (-np.array(data["hand"]["approach"]["direction"])).tolist()
    lied = ng.verify(ng.GraspSolution.from_dict(data))
    assert not lied.passed
    assert "degrees off a direction that allows 17.2" in str(lied)


@pytest.mark.slow
def test_a_cone_about_the_closing_line_allows_no_way_in_but_half_a_turn_does():
    task, hand = ng.TaskEllipsoid([1.0] * 3 + [0.03] * 3), ng.ParallelJaw(0.08)
    body = ng.Box([0.06, 0.2, 0.2])  # two sides alone are near enough to each other
    for angle, success in ((1.6, True), (0.3, False)):
        problem = ng.GraspProblem(body, SOFT, task, hand=hand, constraints=[ng.Approach([1, 0, 0], angle)])
        assert ng.solve(problem, 2, options=OPTIONS).success is success


@pytest.mark.slow
def test_how_the_gripper_comes_is_said_and_first_of_all_a_way_that_is_not_free():
    body, task = ng.Box([0.06, 0.04, 0.06]), ng.TaskEllipsoid([1.0] * 3 + [0.02] * 3)
    hand = ng.ParallelJaw(0.05, finger_length=0.06, finger_thickness=0.02)
    unobstructed, stuck = (
        ng.solve(ng.GraspProblem(body, SOFT, task, hand=hand, constraints=constraints), 1, options=OPTIONS)
        for constraints in ([], [ABOVE, ng.Approach([0, 0, -1], 0.3)])
    )
    assert "the jaws are 40 mm apart and come in along [" in str(unobstructed)
    assert "way in" not in unobstructed.title
    assert "but the gripper's way in leads " in stuck.title
    assert "clearance included; it takes at least that much" in str(stuck)


SLANTED = (0.6, 0.8, 0.0)
AXES = [("x", "z"), ("y", "z"), ("-y", "z"), ("z", "-x"), (SLANTED, "z"), (SLANTED, (-0.8, 0.6, 0.0))]
LETTERS = {"x": (1, 0, 0), "y": (0, 1, 0), "-y": (0, -1, 0), "z": (0, 0, 1), "-x": (-1, 0, 0)}


@pytest.mark.parametrize(("closing", "approach"), AXES)
def test_the_pose_is_that_of_the_grippers_own_frame(closing, approach):
    """The closing axis of the gripper's model lies along the contacts, its approach axis along the way in."""
    hand = ng.ParallelJaw(0.05, finger_length=0.07, closing_axis=closing, approach_axis=approach)
    points = Rotation.from_rotvec([0.4, -0.3, 0.7]).apply(PADS) + np.array([0.01, 0.0, 0.02])
    hand_data, usual = (
        posture(h, body=ng.Sphere(0.025), points=points) for h in (hand, ng.ParallelJaw(0.05, 0.0, 0.05, 0.07))
    )
    assert {k: v for k, v in hand_data.items() if k != "palm_pose"} == {
        k: v for k, v in usual.items() if k != "palm_pose"
    }
    along, towards = (np.array(LETTERS.get(axis, axis), dtype=float) for axis in (closing, approach))
    pose = hand_data["palm_pose"]
    local = Rotation.from_quat(pose["quaternion_wxyz"], scalar_first=True).inv().apply(points - pose["position"])
    np.testing.assert_allclose(local, [-0.02 * along + 0.07 * towards, 0.02 * along + 0.07 * towards], atol=1e-12)
    again = hand_from_dict(json.loads(json.dumps(hand.to_dict())))
    assert posture(again, body=ng.Sphere(0.025), points=points) == hand_data


def test_axes_and_tool_centre_point_are_stated_by_their_shortest_names():
    plain = ng.ParallelJaw(0.05).to_dict()
    assert (plain["closing_axis"], plain["approach_axis"], plain["tcp"]) == ("x", "z", [0.0, 0.0, 0.0])
    assert ng.ParallelJaw(0.05, closing_axis=[1, 0, 0], approach_axis="+z") == ng.ParallelJaw(0.05)
    sideways = ng.ParallelJaw(0.05, finger_length=0.03, closing_axis="y", approach_axis="-x")
    assert sideways.to_dict()["tcp"] == [-0.03, 0.0, 0.0]
    assert replace(sideways, tcp=[-0.03, 0.0, 0.0]) == sideways
    assert replace(sideways, tcp=[0.0, 0.0, 0.1]).to_dict()["tcp"] == [0.0, 0.0, 0.1]
    assert ng.ParallelJaw(0.05, closing_axis=[0, -1, 0]).to_dict() == {**plain, "closing_axis": "-y"}
    few = ng.ParallelJaw(0.05, closing_axis=[0.70711, 0.70711, 0.0])  # written with few digits
    assert np.linalg.norm(few.to_dict()["closing_axis"]) == pytest.approx(1.0, abs=1e-15)
    assert hash(few) == hash(hand_from_dict(few.to_dict()))


@pytest.mark.parametrize(("closing", "approach"), AXES)
@pytest.mark.parametrize("tcp", [(0.0, 0.0, 0.1034), (0.01, -0.02, 0.05)])
def test_the_tool_centre_point_is_the_middle_between_the_pads(closing, approach, tcp):
    """The palm, and with it the approach, stays a finger's length behind the pads wherever the frame is."""
    hand = ng.ParallelJaw(0.05, finger_length=0.03, closing_axis=closing, approach_axis=approach)
    usual, own = posture(hand), posture(replace(hand, tcp=tcp))
    assert {k: v for k, v in own.items() if k != "palm_pose"} == {k: v for k, v in usual.items() if k != "palm_pose"}
    assert own["palm_pose"]["quaternion_wxyz"] == usual["palm_pose"]["quaternion_wxyz"]
    turn = Rotation.from_quat(own["palm_pose"]["quaternion_wxyz"], scalar_first=True)
    local = turn.inv().apply(PADS - own["palm_pose"]["position"])
    np.testing.assert_allclose(local.mean(axis=0), tcp, atol=1e-12)
    again = hand_from_dict(json.loads(json.dumps(replace(hand, tcp=tcp).to_dict())))
    assert again == replace(hand, tcp=tcp)


def test_presets_of_parallel_grippers_state_axes_and_tool_centre_point():
    panda = ng.hands.jaws("panda")
    assert (panda.closing_axis, panda.approach_axis, panda.tcp) == ("y", "z", (0.0, 0.0, 0.1034))
    text = format_gripper_frame(posture(panda), panda.to_dict())
    assert text.endswith("closing axis y, approach axis z, tool centre point [0, 0, 103.4] mm")
    axes = {name: (jaw.closing_axis, jaw.approach_axis) for name, jaw in JAWS.items()}
    assert axes == {
        "panda": ("y", "z"),
        "robotiq_2f85": ("y", "z"),
        "robotiq_2f140": ("y", "z"),
        "robotiq_hande": ("x", "z"),
        "schunk_wsg50": ("x", "y"),
    }
    with pytest.raises(
        ng.InputError, match=r"hands\.jaws\.name: got leap, expected a parallel gripper: panda, robotiq"
    ):
        ng.hands.jaws("leap")


@pytest.mark.parametrize(
    ("name", "preset"),
    [
        ("2f85", "robotiq_2f85"),
        ("robotiq 2f-85", "robotiq_2f85"),
        ("Robotiq 2F-140", "robotiq_2f140"),
        ("hand-e", "robotiq_hande"),
        ("robotiq_hand_e", "robotiq_hande"),
        ("WSG 50", "schunk_wsg50"),
        ("Franka Hand", "panda"),
        ("fr3_hand", "panda"),
    ],
)
def test_names_of_presets_are_found_as_people_write_them(name, preset):
    assert ng.hands.jaws(name) is JAWS[preset]


@pytest.mark.parametrize("name", ["robotiq", "2f", "", None])
def test_an_unknown_preset_lists_what_there_is(name):
    with pytest.raises(ng.InputError, match=f"expected a parallel gripper: {', '.join(JAWS)}$"):
        ng.hands.jaws(name)


BAD_SIZES = {
    "both names": ({"opening": 0.08, "stroke": 0.1}, "ParallelJaw.stroke: got 0.1 beside opening=0.08, expected one"),
    "stroke": ({"stroke": -0.1}, "ParallelJaw.stroke: got -0.1, expected"),
    "millimetres": ({"stroke": 85}, "ParallelJaw.stroke: got 85 m, expected metres"),
    "closed": ({"stroke": 0.05, "closed": 0.06}, "ParallelJaw.stroke: got 0.05 m, expected more than closed, 0.06 m"),
    "long pad": (
        {"stroke": 0.08, "pad": (0.14, 0.01), "finger": (0.06, 0.01, 0.016)},
        "ParallelJaw.pad: got 0.14 m long, expected at most 0.12 m",
    ),
}


def test_a_finger_is_as_wide_as_a_wider_pad():
    assert ng.ParallelJaw(stroke=0.08, pad=(0.02, 0.02), finger=(0.06, 0.01, 0.016)).finger_width == 0.02
    assert ng.ParallelJaw(stroke=0.08, pad=(0.02, 0.01), finger=(0.06, 0.01, 0.016)).finger_width == 0.016


@pytest.mark.parametrize(("fields", "message"), BAD_SIZES.values(), ids=BAD_SIZES)
def test_sizes_that_contradict_each_other_are_refused(fields, message):
    with pytest.raises(ng.InputError, match=re.escape(message)):
        ng.ParallelJaw(**fields)


@pytest.mark.parametrize("name", JAWS)
def test_a_preset_has_sizes_that_fit_together(name):
    """The pad is on the finger, and the palm ends where the model's base begins: at the origin or behind it."""
    jaws = JAWS[name]
    (length, width), (back, _, finger_width) = jaws.pad, jaws.finger
    assert width <= finger_width
    assert 0.5 * length <= back
    assert jaws.max_force > 0.0
    along = float(jaws.axes[:, 2] @ jaws.tool_centre_point)
    behind = jaws.palm_size[2] - (along - back)  # of the frame's origin
    assert -1e-3 < behind < 0.04


def test_the_pads_of_the_2f140_are_half_open_at_its_tool_centre_point():
    """By the joints of ROS-Industrial's description: outer knuckle, outer finger, inner finger, pad."""

    def pad(angle):
        knuckle = Rotation.from_rotvec([0.5 * np.pi + 0.725 - angle, 0.0, 0.0])
        finger = np.array([0.0, -0.030601, 0.054905]) + knuckle.apply([0.0, 0.01821998610742, 0.0260018192872234])
        inner = finger + knuckle.apply([0.0, 0.0817554015893473, -0.0282203446692936])
        return inner + Rotation.from_rotvec([0.5 * np.pi, 0.0, 0.0]).apply(
            [0.0, 0.0457554015893473, -0.0272203446692936]
        )

    def opening(angle):
        return 2.0 * (-pad(angle)[1] - 0.00375)  # half the pad's thickness

    jaws = ng.hands.jaws("robotiq_2f140")
    half = min(np.linspace(0.0, 0.7, 701), key=lambda angle: abs(opening(angle) - 0.5 * jaws.opening))
    assert pad(half)[2] == pytest.approx(jaws.tcp[2], abs=5e-4)
    assert abs(pad(0.0)[2] - jaws.tcp[2]) < 0.018


BAD_AXES = {
    "a word": ({"closing_axis": "up"}, "ParallelJaw.closing_axis: got up, expected"),
    "two signs": ({"closing_axis": "--y"}, "ParallelJaw.closing_axis: got --y, expected"),
    "empty": ({"approach_axis": ""}, "ParallelJaw.approach_axis: got"),
    "longer": ({"closing_axis": [0, 2, 0]}, "ParallelJaw.closing_axis: got a direction of length 2, expected"),
    "two numbers": ({"closing_axis": [0, 1]}, "ParallelJaw.closing_axis"),
    "not across": ({"closing_axis": "z"}, "ParallelJaw.approach_axis: got 0 degrees off closing_axis, expected"),
    "slanted": (
        {"approach_axis": [0.6, 0.0, 0.8]},
        "got 53.13 degrees off closing_axis, expected a direction at right",
    ),
    "nothing": ({"closing_axis": None}, "ParallelJaw.closing_axis"),
    "a point in millimetres": (
        {"tcp": [0, 0, 103.4]},
        "ParallelJaw.tcp: got 103.4 m, expected metres, at most 2: 103.4",
    ),
    "a point of two numbers": ({"tcp": [0, 0.1]}, "ParallelJaw.tcp: got shape (2,), expected"),
    "no point": ({"tcp": "z"}, "ParallelJaw.tcp: got z, expected"),
    "nowhere": ({"tcp": [0, 0, np.nan]}, "ParallelJaw.tcp"),
}


@pytest.mark.parametrize("name", BAD_AXES)
def test_axes_that_are_none_are_refused(name):
    arguments, message = BAD_AXES[name]
    with pytest.raises(ng.InputError) as caught:
        ng.ParallelJaw(0.05, **arguments)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
