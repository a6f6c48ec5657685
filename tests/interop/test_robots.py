"""Export to MoveIt messages, isaac_grasp files and benchmark arrays."""

import csv
import io
import json
import re
import warnings
from copy import copy
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
import yaml
from scipy.spatial.transform import Rotation

import nlpgrasp as ng
from nlpgrasp.cli.main import command_line
from nlpgrasp.errors import InputError
from nlpgrasp.interop import ExportOptions, benchmark_arrays, dexgraspbench, isaac_grasp, moveit, read_isaac_grasps
from nlpgrasp.interop.contacts_csv import contacts_csv
from nlpgrasp.interop.registry import format_named, formats
from nlpgrasp.simulation.fingertip_scene import mjcf
from tests.hands.robotiq import robotiq_2f85
from tests.hands.robots import GRIPPERS, model
from tests.hands.urdf import GRIPPER, Mujoco, solution_links
from tests.once import solve_once

# github.com/moveit/moveit_msgs: msg/Grasp.msg, msg/GripperTranslation.msg; trajectory_msgs, geometry_msgs, std_msgs,
# builtin_interfaces of ROS 2. Nested messages by field; numbers, names and lists of them are leaves.
VECTOR, HEADER = dict.fromkeys("xyz"), {"frame_id": None}
POSTURE = {"header": HEADER, "joint_names": None, "points": None}
POINT = {
    **dict.fromkeys(["positions", "velocities", "accelerations", "effort"]),
    "time_from_start": dict.fromkeys(["sec", "nanosec"]),
}
TRANSLATION = {"direction": {"header": HEADER, "vector": VECTOR}, "desired_distance": None, "min_distance": None}
GRASP = {
    "id": None,
    "pre_grasp_posture": POSTURE,
    "grasp_posture": POSTURE,
    "grasp_pose": {"header": HEADER, "pose": {"position": VECTOR, "orientation": dict.fromkeys("xyzw")}},
    "grasp_quality": None,
    "pre_grasp_approach": TRANSLATION,
    "post_grasp_retreat": TRANSLATION,
    "post_place_retreat": TRANSLATION,
    "max_contact_force": None,
    "allowed_touch_objects": None,
}


def fields(data, definition):
    """Assert that data have the fields of a message, all of them and no others."""
    assert set(data) == set(definition)
    for name, inner in definition.items():
        if inner is not None:
            fields(data[name], inner)


@pytest.fixture(scope="module")
def held():
    """A box between the pads of a gripper with two sliding joints."""
    from tests.hands.urdf import gripper

    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])
    body, contact = ng.Box([0.05, 0.03, 0.03]), ng.SoftContact(0.7, 0.01)
    problem = ng.GraspProblem(body, contact, task, hand=gripper(), name="held box", max_force=40.0)
    options = ng.SolveOptions(workers=1, rounds=0, global_bound=False, final_rtol=0.05)
    return solve_once(problem, starts=2, options=options)


@pytest.fixture(scope="module")
def jaws():
    """The same between parallel jaws with fingers of 60 mm."""
    hand = ng.ParallelJaw(0.06, 0.002, finger_length=0.06)
    task = ng.TaskEllipsoid([4.0, 4.0, 4.0, 0.08, 0.08, 0.08])
    problem = ng.GraspProblem(ng.Box([0.08, 0.04, 0.06]), ng.SoftContact(0.6, 0.005), task, hand=hand)
    options = ng.SolveOptions(workers=1, rounds=0, global_bound=False, final_rtol=0.05)
    return solve_once(problem, starts=1, options=options)


@pytest.mark.slow
@pytest.mark.parametrize("which", ["held", "jaws"])
def test_messages_have_the_fields_of_moveit(which, request):
    solution = request.getfixturevalue(which)
    (message,) = yaml.safe_load(moveit(solution))
    fields(message, GRASP)
    for posture in ("pre_grasp_posture", "grasp_posture"):
        (point,) = message[posture]["points"]
        fields(point, POINT)
        assert len(point["positions"]) == len(message[posture]["joint_names"])
    assert message["grasp_quality"] == solution.mu.lower
    assert message["max_contact_force"] == (40.0 if which == "held" else 0.0)
    pose = message["grasp_pose"]["pose"]
    assert list(pose["position"].values()) == solution.hand["palm_pose"]["position"]
    assert [pose["orientation"][k] for k in "wxyz"] == solution.hand["palm_pose"]["quaternion_wxyz"]
    approach, back = (message[f"{name}"]["direction"] for name in ("pre_grasp_approach", "post_place_retreat"))
    assert approach["header"]["frame_id"] == back["header"]["frame_id"] == "palm"
    forward = np.array(list(approach["vector"].values()))
    np.testing.assert_array_equal(forward, -np.array(list(back["vector"].values())))
    turn = Rotation.from_quat(solution.hand["palm_pose"]["quaternion_wxyz"], scalar_first=True)
    ahead = solution.grasp.points.mean(axis=0) - solution.hand["palm_pose"]["position"]
    assert turn.apply(forward) @ ahead > 0.9 * np.linalg.norm(ahead)  # towards what is held
    if which == "jaws":
        np.testing.assert_allclose(turn.apply(forward), solution.hand["approach"]["direction"], atol=1e-12)


def test_efforts_are_the_torques_of_the_squeeze(held):
    (message,) = yaml.safe_load(moveit(held, ExportOptions(object="box", gripper="hand")))
    posture, squeeze = message["grasp_posture"], held.squeeze
    efforts = dict(zip(posture["joint_names"], posture["points"][0]["effort"], strict=True))
    assert {name: efforts[name] for name in squeeze.torques} == pytest.approx(squeeze.torques)
    assert posture["points"][0]["positions"] == list(held.hand["joint_positions"].values())
    opened = dict(zip(posture["joint_names"], message["pre_grasp_posture"]["points"][0]["positions"], strict=True))
    assert opened == held.hand["pregrasp"]["joint_positions"]
    assert message["grasp_pose"]["header"]["frame_id"] == "box"
    assert message["pre_grasp_approach"]["direction"]["header"]["frame_id"] == "hand"


def test_jaws_close_with_what_the_pads_press(jaws):
    """Force times the change of the opening is what the joints work, however many share it."""
    for names in (("finger_joint",), ("left", "right")):
        options = ExportOptions(joints=names) if len(names) > 1 else ExportOptions()
        (message,) = yaml.safe_load(moveit(jaws, options))
        posture = message["grasp_posture"]
        (point,) = posture["points"]
        assert tuple(posture["joint_names"]) == names
        assert sum(point["positions"]) == pytest.approx(jaws.hand["opening"])
        assert sum(message["pre_grasp_posture"]["points"][0]["positions"]) == pytest.approx(0.06)
        forces = ng.squeeze(jaws.grasp, jaws.grip.with_margin.upper).forces
        change = 1e-3 / len(names)
        closing = np.array([[-0.5e-3], [0.5e-3]]) * (np.diff(jaws.grasp.points, axis=0) / jaws.hand["opening"])
        assert sum(e * change for e in point["effort"]) == pytest.approx(float(np.sum(forces * closing)), rel=2e-3)


def test_jaws_press_with_the_margin_within_the_limit_and_never_below_the_least_force(jaws):
    least, safe = jaws.grip.force.upper, jaws.grip.with_margin.upper
    assert safe == pytest.approx(1.2 * ng.grip_force(jaws, 1.0, 0.1).with_margin.upper)
    for limit, force in ((None, safe), (0.5 * (least + safe), 0.5 * (least + safe)), (0.5 * least, least)):
        limited = replace(jaws, problem={**jaws.problem, "max_force": limit})
        text = moveit(limited)
        (message,) = yaml.safe_load(text)
        assert message["grasp_posture"]["points"][0]["effort"] == pytest.approx([-force])
        assert text.count(f"# grasp_0: {limited.grip_line()}\n") == 1
        assert limited.is_too_weak == (force == least)


def test_tables_and_isaac_grasps_carry_the_force(jaws):
    grasp = yaml.safe_load(isaac_grasp({"grasp_0": jaws}))["grasps"]["grasp_0"]
    head, *rows = csv.reader(contacts_csv(jaws).splitlines())
    for name, force in (("grip_force", jaws.grip.force), ("grip_force_with_margin", jaws.grip.with_margin)):
        assert grasp[name] == force.upper
        assert [float(row[head.index(name)]) for row in rows] == [force.upper] * 2


def test_jaws_of_an_isaac_grasp_are_on_the_contacts(jaws, tmp_path):
    path = tmp_path / "jaws.yaml"
    path.write_text(isaac_grasp({"grasp_0": jaws}))
    (read,) = read_isaac_grasps(path)
    back = Rotation.from_quat(read.quaternion, scalar_first=True).inv().apply(jaws.grasp.points - read.position)
    half = read.joints["finger_joint"] / 2.0
    np.testing.assert_allclose(back, [[-half, 0.0, 0.06], [half, 0.0, 0.06]], atol=1e-9)
    assert read.open_joints == {"finger_joint": 0.06}


def test_an_isaac_grasp_names_files_and_frames(jaws):
    plain = yaml.safe_load(isaac_grasp({"g": jaws}))
    assert not {"object_file", "object_scale", "gripper_file"} & set(plain)
    assert plain["object_frame"] == plain["object_frame_link"] == "box"
    assert plain["gripper_frame"] == plain["gripper_frame_link"] == "palm"
    assert plain["created_with"] == f"nlpgrasp {ng.__version__}"
    file = yaml.safe_load(isaac_grasp({"g": jaws}, ExportOptions(object="box.usd", gripper="jaws.usd")))
    assert (file["object_file"], file["object_scale"], file["gripper_file"]) == ("box.usd", 1.0, "jaws.usd")
    mesh = replace(jaws, problem={**jaws.problem, "body": {"type": "mesh", "source": "cup.obj", "unit": "mm"}})
    scaled_file = yaml.safe_load(isaac_grasp({"g": mesh}, ExportOptions(object="models/cup.obj")))
    assert (scaled_file["object_file"], scaled_file["object_scale"]) == ("models/cup.obj", 0.001)


def test_arrays_read_back_without_pickles(held, tmp_path):
    path = tmp_path / "held.npz"
    path.write_bytes(benchmark_arrays(held))
    with np.load(path, allow_pickle=False) as data:
        names, rows = data["joint_names"].tolist(), {at: data[f"{at}_qpos"] for at in ("pregrasp", "grasp", "squeeze")}
        assert names == list(held.hand["joint_positions"])
        assert {rows[at].shape for at in rows} == {(1, 7 + len(names))}
        np.testing.assert_array_equal(data["obj_pose"], [[0, 0, 0, 1, 0, 0, 0]])
        np.testing.assert_array_equal(data["mu"], [[held.mu.lower, held.mu.upper]])
        np.testing.assert_array_equal(data["contact_points"], held.grasp.points[None])
        efforts = dict(zip(names, data["squeeze_effort"][0], strict=True))
        assert (str(data["obj_path"]), str(data["gripper_frame"]), data["obj_scale"].tolist()) == ("box", "palm", [1.0])
    assert {name: efforts[name] for name in held.squeeze.torques} == pytest.approx(held.squeeze.torques)
    commands = dict(zip(names, rows["squeeze"][0, 7:], strict=True))
    assert {name: commands[name] for name in held.squeeze.torques} == pytest.approx(held.squeeze.positions())
    pose = rows["grasp"][0]
    posture = {
        "joint_positions": dict(zip(names, pose[7:].tolist(), strict=True)),
        "palm_pose": {"position": pose[:3].tolist(), "quaternion_wxyz": pose[3:7].tolist()},
    }
    ours = solution_links(GRIPPER, held.hand)
    for name, expected in solution_links(GRIPPER, posture).items():  # by MuJoCo
        np.testing.assert_allclose(expected, ours[name], atol=1e-12)


def test_a_row_for_each_grasp_kept_and_joints_in_another_order(held):
    names = list(held.hand["joint_positions"])[::-1]
    quick = {k: v for k, v in held.hand.items() if k != "squeeze"}
    other = replace(held.grasps[0], grasp=copy(held.grasp), hand=quick, start=None)
    with pytest.warns(
        UserWarning, match=r"^grasp_1 states no squeeze, so its .* ng\.analyse\(solution, problem=problem\) adds"
    ):
        file = benchmark_arrays(replace(held, others=(other,)), ExportOptions(joints=tuple(names)))
    with np.load(io.BytesIO(file)) as data:
        assert data["joint_names"].tolist() == names
        np.testing.assert_array_equal(data["grasp_qpos"][0], data["grasp_qpos"][1])
        assert data["grasp_qpos"][0, 7:].tolist() == [held.hand["joint_positions"][name] for name in names]
        assert np.isnan(data["squeeze_qpos"][1, 7:]).all()
        assert np.isnan(data["squeeze_effort"][1]).all()
        assert data["has_squeeze"].tolist() == [True, False]
        lift = held.phases[-1]
        assert data["lift_qpos"][0, 7:].tolist() == [lift.joints[name] for name in names]
        assert data["lift_qpos"][0, :3].tolist() == lift.palm_position.tolist()
        assert data["has_lift"].all()
        assert (data["way_in_free"] == (data["way_in"] == "")).all()
    with pytest.raises(InputError, match=r"--joint: got thumb, expected joints of the hand"):
        benchmark_arrays(held, ExportOptions(joints=("thumb",)))


def test_a_record_of_dexgraspbench(held):
    file = dexgraspbench(held, ExportOptions(object="assets/box"))
    record = np.load(io.BytesIO(file), allow_pickle=True).item()  # as the benchmark reads it
    assert set(record) == {
        *("pregrasp_qpos", "grasp_qpos", "squeeze_qpos", "obj_pose", "obj_scale", "obj_path"),
        *("has_pregrasp", "way_in_free"),
    }
    assert record["has_pregrasp"]
    assert record["way_in_free"]
    assert (record["obj_path"], record["obj_scale"]) == ("assets/box", 1.0)
    with np.load(io.BytesIO(benchmark_arrays(held))) as data:
        for at in ("pregrasp_qpos", "grasp_qpos", "squeeze_qpos"):
            np.testing.assert_array_equal(record[at], data[at][0])
    quick = replace(held, hand={k: v for k, v in held.hand.items() if k != "squeeze"})
    with pytest.raises(InputError, match=r"got no squeeze \(the solve left it out\), expected .*ng\.analyse"):
        dexgraspbench(quick)


@pytest.mark.parametrize("write", [moveit, benchmark_arrays, dexgraspbench])
def test_what_has_no_hand_is_refused(write, jaws):
    with pytest.raises(InputError, match=r"a grasp found with an ng\.URDFHand or, in space, an ng\.ParallelJaw"):
        write(replace(jaws, hand=None))
    with pytest.raises(InputError, match="got no grasp"):
        write(replace(jaws, grasp=None, others=()))


def without(solution, *keys, **more):
    """Return a solution whose hand states less, or something else."""
    return replace(solution, hand={**{k: v for k, v in solution.hand.items() if k not in keys}, **more})


BLOCKED = {"direction": None, "distance": None, "reason": "link palm is in the way"}
SQUEEZES = {
    "left out": (("squeeze",), {}),
    "none": (("squeeze",), {"no_squeeze": {"reason": "contact 0 cannot press"}}),
}


@pytest.mark.parametrize("name", SQUEEZES)
@pytest.mark.filterwarnings("ignore:grasp_0 states no squeeze:UserWarning")
def test_no_array_has_nan_without_a_flag(held, name):
    keys, more = SQUEEZES[name]
    with np.load(io.BytesIO(benchmark_arrays(without(held, *keys, **more)))) as data:
        nan = [key for key in data.files if data[key].dtype.kind == "f" and np.isnan(data[key]).any()]
        assert nan == ["squeeze_qpos", "squeeze_effort"]
        assert data["has_squeeze"].tolist() == [False]
    with np.load(io.BytesIO(benchmark_arrays(held))) as data:
        assert not any(np.isnan(data[key]).any() for key in data.files if data[key].dtype.kind == "f")
        assert [data[key].tolist() for key in ("has_squeeze", "has_pregrasp", "way_in_free")] == [[True]] * 3


def test_a_squeeze_of_joints_that_are_not_chosen_is_no_missing_one(held):
    follower = next(name for name in held.hand["joint_positions"] if name not in held.squeeze.torques)
    with np.load(io.BytesIO(benchmark_arrays(held, ExportOptions(joints=(follower,))))) as data:
        assert data["has_squeeze"].tolist() == [True]
        assert np.isfinite(data["squeeze_qpos"]).all()


@pytest.mark.filterwarnings("error")
def test_only_a_squeeze_that_a_solve_left_out_is_warned_of(held):
    keys, more = SQUEEZES["none"]
    assert "effort: []" in moveit(without(held, *keys, **more))
    with pytest.raises(
        UserWarning, match=r"^grasp_0 states no squeeze, so its grasp_posture has no effort: ng\.analyse"
    ):
        moveit(without(held, "squeeze"))


def test_a_blocked_way_in_is_flagged(held):
    stuck = without(held, approach=BLOCKED)
    with np.load(io.BytesIO(benchmark_arrays(stuck))) as data:
        assert data["way_in_free"].tolist() == [False]
        assert data["has_pregrasp"].tolist() == [True]
    assert not np.load(io.BytesIO(dexgraspbench(stuck)), allow_pickle=True).item()["way_in_free"]
    assert yaml.safe_load(isaac_grasp({"g": stuck}))["grasps"]["g"]["way_in"] == "not free: link palm is in the way"
    assert "way_in" not in yaml.safe_load(isaac_grasp({"g": held}))["grasps"]["g"]
    with pytest.warns(UserWarning, match="the straight way in of grasp_0 is not free, .*: link palm is in the way"):
        text = moveit(stuck)
    assert text.startswith("# grasp_0: way in not free: link palm is in the way\n")
    fields(yaml.safe_load(text)[0], GRASP)


def test_a_pregrasp_or_a_way_in_that_is_not_stated_is_flagged(held):
    closed = without(held, "pregrasp")
    with np.load(io.BytesIO(benchmark_arrays(closed))) as data:
        assert data["has_pregrasp"].tolist() == [False]
        np.testing.assert_array_equal(data["pregrasp_qpos"], data["grasp_qpos"])
    assert "no pregrasp is stated" in yaml.safe_load(isaac_grasp({"g": closed}))["grasps"]["g"]["way_in"]
    older = without(held, "approach")
    assert yaml.safe_load(isaac_grasp({"g": older}))["grasps"]["g"]["way_in"] == "not free: the file states no way in"


def test_the_way_in_of_jaws_is_free_where_it_leads_into_nothing(jaws):
    approach = jaws.hand["approach"]
    deep, thin = {"depth": 0.004}, {"depth": 0.0, "passes_through": True}
    for change, free in (({"depth": 0.0}, True), (deep, False), (thin, False)):
        with np.load(io.BytesIO(benchmark_arrays(without(jaws, approach={**approach, **change})))) as data:
            assert data["way_in_free"].tolist() == [free]
    for change, reason in (
        (
            deep,
            "leads 4 mm deep into the body, a table or an obstacle (clearance included",
        ),
        (thin, "passes through something thin"),
    ):
        stuck = yaml.safe_load(isaac_grasp({"g": without(jaws, approach={**approach, **change})}))
        assert stuck["grasps"]["g"]["way_in"].startswith(f"not free: the gripper's way in {reason}")


def closing_along(jaws, axis):
    """Return the solution of a gripper that closes along another axis of its own frame, its contacts the same."""
    return held_by(jaws, ng.ParallelJaw(0.06, 0.002, finger_length=0.06, closing_axis=axis))


def held_by(jaws, hand):
    """Return the solution of another gripper at the same contacts."""
    posture = hand.at_contacts(jaws.grasp.points, 0.05, lambda points: np.full(len(points), 1.0))
    return replace(jaws, problem={**jaws.problem, "hand": hand.to_dict()}, hand=posture)


PANDA = """
<mujoco><worldbody><body name="hand">
  <body><joint name="left" type="slide" axis="0 1 0"/><geom size="0.001"/><site name="left" pos="0 0 0.06"/></body>
  <body><joint name="right" type="slide" axis="0 -1 0"/><geom size="0.001"/><site name="right" pos="0 0 0.06"/></body>
</body></worldbody></mujoco>
"""


@pytest.mark.parametrize(("axis", "sides"), [("y", ["right", "left"]), ("-y", ["left", "right"]), ("x", None)])
def test_a_gripper_that_closes_along_its_y_has_its_pads_on_the_contacts(jaws, tmp_path, axis, sides):
    """A model as the Franka hand's, in MuJoCo: fingers slide along y and -y of the hand's frame."""
    path = tmp_path / "jaws.yaml"
    path.write_text(isaac_grasp({"grasp_0": closing_along(jaws, axis)}, ExportOptions(joints=("left", "right"))))
    (read,) = read_isaac_grasps(path)
    model = mujoco.MjModel.from_xml_string(PANDA)
    model.body("hand").pos, model.body("hand").quat = read.position, read.quaternion
    data = mujoco.MjData(model)
    for name, position in read.joints.items():
        data.joint(name).qpos = position
    mujoco.mj_kinematics(model, data)
    pads = {side: data.site(side).xpos for side in ("left", "right")}
    if sides is None:  # turned by 90 degrees
        assert np.linalg.norm(pads["left"] - jaws.grasp.points, axis=1).min() > 0.02
    else:
        np.testing.assert_allclose([pads[side] for side in sides], jaws.grasp.points, atol=1e-9)


def pose_in_isaac_grasp(solution, folder):
    """The pose of an isaac_grasp file, and the opening."""
    path = folder / "jaws.yaml"
    path.write_text(isaac_grasp({"grasp_0": solution}))
    (read,) = read_isaac_grasps(path)
    return read.position, read.quaternion, read.joints["finger_joint"]


def pose_in_arrays(solution, folder):
    with np.load(io.BytesIO(benchmark_arrays(solution))) as data:
        (row,) = data["grasp_qpos"]
    return row[:3], row[3:7], row[7]


def pose_in_message(solution, folder):
    (message,) = yaml.safe_load(moveit(solution))
    pose, (point,) = message["grasp_pose"]["pose"], message["grasp_posture"]["points"]
    return *(np.array([pose[key][k] for k in keys]) for key, keys in POSE_KEYS.items()), point["positions"][0]


def pose_in_scene(solution, folder):
    scene = mujoco.MjModel.from_xml_string(mjcf(solution))
    return scene.site("gripper_frame").pos, scene.site("gripper_frame").quat, solution.hand["opening"]


POSE_KEYS = {"position": "xyz", "orientation": "wxyz"}
POSES = [pose_in_isaac_grasp, pose_in_arrays, pose_in_message, pose_in_scene]
TOUCH = 5e-4  # metres


@pytest.mark.parametrize("exported_pose", POSES)
def test_a_model_of_the_panda_gripper_has_its_pads_on_the_contacts(jaws, tmp_path, exported_pose):
    gripper = ng.hands.jaws("panda")
    distances = distances_of_panda_fingers(jaws.grasp.points, *exported_pose(held_by(jaws, gripper), tmp_path))
    assert max(distances) <= TOUCH
    turned = held_by(jaws, replace(gripper, closing_axis="x"))
    assert min(distances_of_panda_fingers(jaws.grasp.points, *exported_pose(turned, tmp_path))) > 10.0 * TOUCH


def distances_of_panda_fingers(points, position, quaternion, opening):
    """Distances of contacts from the fingers of robosuite's model, whose world is the hand's frame, in MuJoCo."""
    file = model(f"{GRIPPERS}/panda_gripper.xml")
    scene = mujoco.MjSpec()
    place = scene.worldbody.add_site(name="palm", pos=position, quat=quaternion)
    scene.attach(mujoco.MjSpec.from_file(str(file)), prefix="gripper_", site=place)
    compiled = scene.compile()
    data = mujoco.MjData(compiled)
    for name, side in (("finger_joint1", 1.0), ("finger_joint2", -1.0)):
        data.joint(f"gripper_{name}").qpos = side * opening / 2.0
    mujoco.mj_kinematics(compiled, data)
    fingers = [finger_mesh(compiled, data, f"gripper_finger{number}_collision") for number in (2, 1)]
    pairs = zip(fingers, points, strict=True)
    return [float(trimesh.proximity.closest_point_naive(finger, point[None])[1][0]) for finger, point in pairs]


def finger_mesh(compiled, data, name):
    """The triangles of a geom in the world frame."""
    shape, geom = compiled.geom(name).dataid[0], data.geom(name)
    start, count = compiled.mesh_vertadr[shape], compiled.mesh_vertnum[shape]
    vertices = compiled.mesh_vert[start : start + count] @ geom.xmat.reshape(3, 3).T + geom.xpos
    start, count = compiled.mesh_faceadr[shape], compiled.mesh_facenum[shape]
    return trimesh.Trimesh(vertices, compiled.mesh_face[start : start + count])


def test_a_model_of_the_robotiq_gripper_has_its_pads_on_the_contacts(jaws, tmp_path):
    """The joints of ROS-Industrial's model, closed as far as the opening: the contacts are on its pads' rectangles."""
    position, quaternion, opening = pose_in_isaac_grasp(held_by(jaws, ng.hands.jaws("robotiq_2f85")), tmp_path)
    kinematics = Mujoco(robotiq_2f85(tmp_path / "robotiq.urdf"))
    turn, sides = Rotation.from_quat(quaternion, scalar_first=True), ("left", "right")
    local = turn.inv().apply(jaws.grasp.points - position)
    low, high = 0.0, 0.81  # radians: open, closed
    for _ in range(40):
        angle = 0.5 * (low + high)
        driven = {"finger_joint": 1, "right_outer_knuckle_joint": 1}
        driven |= {f"{side}_inner_{part}_joint": s for side in sides for part, s in (("finger", -1), ("knuckle", 1))}
        links = kinematics.link_poses({name: sign * angle for name, sign in driven.items()})
        pads = [links[f"{side}_inner_finger_pad"] @ translation(PAD_FACE) for side in sides]
        gap = pads[1][1, 3] - pads[0][1, 3]
        low, high = (angle, high) if gap > opening else (low, angle)
    for pad, point in zip(pads, local, strict=True):
        x, y, z = pad[:3, :3].T @ (point - pad[:3, 3])
        assert abs(y) <= TOUCH  # along the pad's normal
        assert abs(x) <= 0.011
        assert abs(z) <= 0.01875


PAD_FACE = [0.0, -0.003175, 0.0]  # metres, of a pad's link


def translation(offset):
    pose = np.eye(4)
    pose[:3, 3] = offset
    return pose


def test_exports_state_the_axes_of_the_grippers_frame(jaws):
    for axis, axis_vector in (("x", [1.0, 0.0, 0.0]), ("y", [0.0, 1.0, 0.0]), ("-y", [0.0, -1.0, 0.0])):
        turned = closing_along(jaws, axis)
        file = yaml.safe_load(isaac_grasp({"g": turned}))
        assert (file["closing_axis"], file["approach_axis"]) == (axis_vector, [0.0, 0.0, 1.0])
        assert file["tcp"] == [0.0, 0.0, 0.06]
        with np.load(io.BytesIO(benchmark_arrays(turned))) as data:
            assert (data["closing_axis"].tolist(), data["approach_axis"].tolist()) == (axis_vector, [0.0, 0.0, 1.0])
        assert moveit(turned).startswith(f"# closing_axis of the gripper's frame: {axis_vector}\n# approach_axis of ")
        assert "\n# tcp of the gripper's frame: [0.0, 0.0, 0.06]\n" in moveit(turned)
        stated = f"closing axis {axis}, approach axis z, tool centre point [0, 0, 60] mm"
        assert stated in str(turned)
        assert stated in mjcf(turned)
        record = np.load(io.BytesIO(dexgraspbench(turned)), allow_pickle=True).item()
        assert record["closing_axis"].tolist() == axis_vector
        assert record["tcp"].tolist() == [0.0, 0.0, 0.06]
    sideways = ng.ParallelJaw(0.06, finger_length=0.06, closing_axis="y", approach_axis="x")
    (message,) = yaml.safe_load(moveit(replace(jaws, problem={**jaws.problem, "hand": sideways.to_dict()})))
    assert message["pre_grasp_approach"]["direction"]["vector"] == {"x": 1.0, "y": 0.0, "z": 0.0}


UNUSUAL = {"closing_axis": [0.0, 0.0, -1.0], "approach_axis": [1.0, 0.0, 0.0], "tcp": [0.12, 0.01, -0.02]}
AXES_IN_WORDS = "closing axis -z, approach axis x, tool centre point [120, 10, -20] mm"


def axes_in_columns(text):
    """The axes and tool centre point of a table, which are the same in every row."""
    rows = list(csv.DictReader(io.StringIO(text)))
    columns = {name: {tuple(float(row[f"{name}_{c}"]) for c in "xyz") for row in rows} for name in UNUSUAL}
    return {name: list(*values) for name, values in columns.items()}


def axes_in_comments(text):
    """The axes and tool centre point that comment lines state."""
    lines = re.findall(r"^# (\w+) of the gripper's frame: (.*)$", text, re.MULTILINE)
    return {name: json.loads(vector) for name, vector in lines}


def axes_in_arrays(content):
    """The axes and tool centre point of a file of arrays."""
    data = np.load(io.BytesIO(content), allow_pickle=True)
    data = data if hasattr(data, "files") else data.item()
    return {name: data[name].tolist() for name in UNUSUAL}


def axes_in_datasets(content):
    """The axes and tool centre point of an HDF5 file."""
    with pytest.importorskip("h5py").File(io.BytesIO(content)) as file:
        return {name: file[name][()].tolist() for name in UNUSUAL}


def axes_in_mapping(data):
    """The axes and tool centre point under their names."""
    return {name: data[name] for name in UNUSUAL}


STATED_AXES = {
    "isaac_grasp": lambda content: axes_in_mapping(yaml.safe_load(content)),
    "mjcf": lambda content: UNUSUAL if f"own frame: {AXES_IN_WORDS} -->" in content.decode() else {},
    "moveit": lambda content: axes_in_comments(content.decode()),
    "npz": axes_in_arrays,
    "hdf5": axes_in_datasets,
    "dexgraspbench": axes_in_arrays,
    "poses": lambda content: axes_in_columns(content.decode()),
    "poses_json": lambda content: axes_in_mapping(json.loads(content)),
    "trajectory": lambda content: axes_in_columns(content.decode()),
    "trajectory_json": lambda content: axes_in_mapping(json.loads(content)),
}


@pytest.fixture(scope="module")
def unusual(jaws):
    """The solution of a gripper with unusual axes, and its tool centre point off the closing line of its origin."""
    tcp = tuple(UNUSUAL["tcp"])
    return held_by(jaws, ng.ParallelJaw(0.06, finger_length=0.05, closing_axis="-z", approach_axis="x", tcp=tcp))


def test_every_format_with_a_pose_states_the_axes():
    own = [form for form in formats() if form.write.__module__.startswith("nlpgrasp.")]
    assert {form.name for form in own if form.pose} == set(STATED_AXES)
    assert {form.name for form in own if not form.pose} == {"csv", "glb"}


@pytest.mark.parametrize("name", STATED_AXES)
def test_axes_are_stated_in_the_file_and_on_the_command_line(unusual, name, tmp_path, capsys):
    if name == "hdf5":
        pytest.importorskip("h5py")
    file = unusual.save(tmp_path / "unusual.json")
    out = tmp_path / f"out{Path(f'F{format_named(name).ending}').suffix}"
    arguments = ["export", str(file), "--to", name, "--out", str(out)]
    command_line(arguments)(arguments, standalone_mode=False)
    assert STATED_AXES[name](out.read_bytes()) == UNUSUAL
    place = "poses are those of the tool centre point" if name.startswith("poses") else "pose is that of the gripper"
    assert re.search(rf"^the {place}.*: {re.escape(AXES_IN_WORDS)}$", capsys.readouterr().out, re.MULTILINE)


def test_the_stated_tcp_of_a_trajectory_is_between_the_contacts(unusual):
    way = ng.Trajectory.from_dict(json.loads(format_named("trajectory_json").export(unusual)))
    grasp = way.palm_positions[max(i for i, phase in enumerate(way.phases) if phase == "grasp")]
    turn = Rotation.from_quat(way.palm_quaternion, scalar_first=True)
    first, second = unusual.grasp.points
    np.testing.assert_allclose(grasp + turn.apply(way.tcp), 0.5 * (first + second), atol=1e-9)
    closing = (second - first) / np.linalg.norm(second - first)
    np.testing.assert_allclose(turn.apply(way.closing_axis), closing, atol=1e-9)


def test_a_hand_with_joints_states_no_closing_axis(held):
    assert "closing_axis" not in isaac_grasp({"g": held}) + moveit(held)
    with np.load(io.BytesIO(benchmark_arrays(held))) as data:
        assert "closing_axis" not in data.files


NAMED = [
    (
        "x",
        {"gripper": "models/Panda_hand.usd"},
        r'Panda_hand.usd closes along its y axis .* ng\.hands\.jaws\("panda"\)',
    ),
    ("x", {"gripper": "fr3_hand"}, "fr3_hand closes along its y axis"),
    ("x", {"joints": ("panda_finger_joint1", "panda_finger_joint2")}, "panda_finger_joint1 closes along its y axis"),
    ("y", {"gripper": "robotiq_85_base_link"}, 'robotiq_85_base_link closes along its x .*closing_axis="x"'),
    ("x", {"gripper": "robotiq_arg2f_base_link"}, "robotiq_arg2f_base_link closes along its y axis"),
    ("y", {"gripper": "panda_hand.usd"}, None),
    ("-y", {"gripper": "franka.usd"}, None),
    ("x", {"gripper": "jaws.usd"}, None),
]


@pytest.mark.parametrize(("axis", "options", "reason"), NAMED)
def test_a_known_gripper_that_closes_along_another_axis_is_warned_of(jaws, axis, options, reason):
    turned = closing_along(jaws, axis)
    for write in (benchmark_arrays, moveit, lambda solution, options: isaac_grasp({"g": solution}, options)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            write(turned, ExportOptions(**options))
        assert len(caught) == (reason is not None)
        if reason is not None:
            assert re.search(reason, str(caught[0].message))
