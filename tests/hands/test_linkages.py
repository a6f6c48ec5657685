"""Closed linkages: postures, grasps, files and scenes keep the equalities that MuJoCo recomputes."""

import json
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

import nlpgrasp as ng
from benchmarks.outside import HANDS, MISSING
from nlpgrasp.simulation.robot_hand_scene import mjcf_with_hand
from tests.hands.linkages import CONNECTS, MOTOR, SITES, TOGETHER, errors, fingers, four_bar
from tests.once import GRASP

PADS = ["left_pad", "right_pad"]
TENDONS = (
    '<tendon><fixed name="t"><joint joint="left_crank" coef="1"/><joint joint="left_pad" coef="0.5"/></fixed>'
    '<fixed name="u"><joint joint="right_crank" coef="-0.7"/></fixed></tendon>'
)
SPATIAL = '<tendon><spatial name="t"><site site="left_end"/><site site="left_top"/></spatial></tendon>'
ROBOTIQ = HANDS / "robotiq_2f85_mjcf/2f85.xml"


def write(folder: Path, text: str, name: str = "hand.xml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("equalities", "more"),
    [
        (fingers() + TOGETHER, MOTOR),
        (fingers(SITES) + TOGETHER, ""),
        ('<weld body1="left_pad" body2="left_rocker"/>' + CONNECTS.format("right", "0.02"), ""),
        (fingers() + TOGETHER.replace("0 -1 0", "0.02 -1 0.3"), MOTOR),
        (fingers() + TOGETHER + TOGETHER.replace("right_crank", "right_rocker"), MOTOR),
        ('<connect body1="left_rocker" body2="right_rocker" anchor="0.055 0 0.05"/>', ""),
        ('<tendon tendon1="t" tendon2="u" polycoef="0.01 0.5 0 0 0"/>', TENDONS),
    ],
)
def test_drawn_postures_keep_what_mujoco_holds(tmp_path, equalities, more):
    path = write(tmp_path, four_bar(equalities, more))
    hand = ng.URDFHand.load(path, PADS)
    values, _ = hand.draw(20, np.zeros((20, 3)), np.random.default_rng(0))
    joints = [hand.describe({name: v[i] for name, v in values.items()})["joint_positions"] for i in range(20)]
    assert max(np.max(np.abs(errors(path, positions))) for positions in joints) < 1e-6
    assert np.ptp([positions["right_crank"] for positions in joints]) > 0.3  # and they differ


@pytest.mark.parametrize(
    ("equalities", "more", "match"),
    [
        ('<connect body1="left_pad" anchor="0 0 0"/>', "", "<connect> of bodies left_pad and world, .*not below palm"),
        ('<connect site1="left_end" site2="right_top"/>', "", r"open by 13\.7 mm in the best posture, .*that closes"),
        ('<tendon tendon1="t" tendon2="u" polycoef="0 1 1 0 0"/>', TENDONS, "t that follows u by polycoef .*line"),
        ('<tendon tendon1="t"/>', SPATIAL, "an equality of tendon t, expected fixed tendons"),
        (fingers() + TOGETHER.replace("0 -1", "1.9 -1"), "", "joint left_crank that follows it, .*both can keep"),
    ],
)
def test_what_cannot_be_stated_is_refused(tmp_path, equalities, more, match):
    with pytest.raises(ng.InputError, match=match) as caught:
        ng.URDFHand.load(write(tmp_path, four_bar(equalities, more)), PADS)
    assert "\n" not in str(caught.value)


def test_what_holds_the_palm_is_no_linkage(tmp_path):
    inactive = CONNECTS.format("left", "-0.02").replace("/>", ' active="false"/>')
    path = write(tmp_path, four_bar('<weld body1="palm"/>' + inactive))
    assert ng.URDFHand.load(path, PADS).closed_linkages == ()


def test_joints_without_an_actuator_that_linkages_leave_free_are_named(tmp_path):
    with pytest.warns(UserWarning, match="joints that no actuator moves are taken to be driven: left_crank$"):
        ng.URDFHand.load(write(tmp_path, four_bar(fingers())), PADS)


def test_joints_that_springs_hold_at_a_limit_stay_there(tmp_path):
    hinge = '<joint name="left_rocker" axis="0 1 0" range="-0.9 0.9"'
    text = four_bar(fingers()).replace(hinge, f'{hinge} stiffness="0.1" springref="-2"')
    with pytest.warns(
        UserWarning, match="kept at the limits where springs hold them: left_crank, left_pad, left_rocker$"
    ):
        hand = ng.URDFHand.load(write(tmp_path, text), PADS)
    values, _ = hand.draw(3, np.zeros((3, 3)), np.random.default_rng(0))
    for i in range(3):
        joints = hand.describe({name: v[i] for name, v in values.items()})["joint_positions"]
        assert (joints["left_crank"], joints["left_pad"], joints["left_rocker"]) == (-0.9, 0.9, -0.9)


def test_joint_torques_are_those_of_the_drives(tmp_path):
    hand = ng.URDFHand.load(write(tmp_path, four_bar()), PADS)
    assert hand.loaded_joints == ("right_crank",)
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.01, 0.01, 0.01])
    body = ng.Cylinder(0.02, 0.08)
    with pytest.raises(ng.InputError, match=r'"hand_torques" for a hand with closed linkages .*another budget'):
        ng.GraspProblem(body, ng.SoftContact(0.7, 0.01), task, hand=hand, force_budget="hand_torques")
    values, _ = hand.draw(1, np.zeros((1, 3)), np.random.default_rng(1))
    values = {name: v[0] for name, v in values.items()}
    points = np.array([[0.01, 0.0, 0.02], [-0.01, 0.01, 0.0]])
    jacobians = hand.contact_jacobians(values, points)[:, :, 0]
    # pads of parallelograms do not turn, and move as the cranks' ends do: 0.05 m a radian
    np.testing.assert_allclose(jacobians[:, 3:], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(jacobians[:, :3], axis=1), 0.05, atol=1e-9)


@pytest.mark.parametrize("folder_of_meshes", [False, True])
def test_mjcf_by_its_own_ending(tmp_path, folder_of_meshes):
    text = four_bar()
    if folder_of_meshes:
        import trimesh

        (tmp_path / "parts").mkdir()
        trimesh.creation.box([0.03, 0.03, 0.01]).export(tmp_path / "parts/lid.stl")
        write(tmp_path, '<mujoco><asset><mesh name="lid" file="lid.stl"/></asset></mujoco>', "assets.xml")
        text = text.replace("<worldbody>", '<include file="assets.xml"/><worldbody>')
        text = text.replace('<compiler angle="radian"/>', '<compiler angle="radian" meshdir="parts"/>')
        text = text.replace('<site name="left_top"', '<geom type="mesh" mesh="lid"/><site name="left_top"')
    hands = [ng.URDFHand.load(write(tmp_path, text, name), PADS) for name in ("hand.xml", "hand.mjcf")]
    assert [hand.closed_linkages for hand in hands] == [hands[0].closed_linkages] * 2
    assert hands[0].robot.shapes.keys() == hands[1].robot.shapes.keys()
    np.testing.assert_array_equal(hands[0].tree.joint_limits, hands[1].tree.joint_limits)


def test_the_world_is_a_palm_by_its_name(tmp_path):
    path = write(tmp_path, four_bar(palm="world"))
    with pytest.raises(ng.InputError, match=r"side by side, expected palm=, .* or 'world', if all of them are f"):
        ng.URDFHand.load(path, PADS)
    assert ng.URDFHand.load(path, PADS, palm="world").loaded_joints == ("right_crank",)


@pytest.fixture(scope="module")
def held(tmp_path_factory):
    """A cylinder held by the four-bar gripper, and the gripper's file."""
    twice = '<connect body1="left_pad" body2="left_rocker" anchor="-0.02 0.01 0"/>'  # beside the other: a hinge
    path = write(tmp_path_factory.mktemp("linkage"), four_bar(fingers(SITES) + twice + TOGETHER))
    task = ng.lift([0, 0, 0], 0.1) + ng.disturbance(0.5, 0.005)
    hand = ng.URDFHand.load(path, PADS)
    problem = ng.GraspProblem(ng.Cylinder(0.02, 0.08), ng.SoftContact(0.7, 0.01), task, hand=hand)
    solution = ng.solve(problem, starts=1, options=GRASP)
    return solution, path, solution.save(path.parent / "held.json")


def postures(solution):
    """Joint positions of the grasp, the pregrasp and the phases that are no commands."""
    phases = [phase for phase in solution.hand["phases"] if phase["name"] not in ("squeeze", "lift")]
    return [record["joint_positions"] for record in (solution.hand, solution.hand["pregrasp"], *phases)]


@pytest.mark.slow
def test_a_grasp_keeps_the_linkages_and_is_verified(held):
    solution, path, file = held
    assert solution.success
    assert len(postures(solution)) >= 4
    assert max(np.max(np.abs(errors(path, positions))) for positions in postures(solution)) < 1e-6
    # each finger presses at the end of a crank of 50 mm at most, whose pad does not turn
    (torque,) = solution.squeeze.torques.values()
    assert 0.5 * 0.05 < abs(torque) / solution.squeeze.largest < 2.0 * 0.05
    assert solution.squeeze.joints.amount("right_crank", torque).endswith(" N m")
    assert str(ng.verify(file)).splitlines()[-1].startswith("verified")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("entry", "joint"), [((), "left_rocker"), (("pregrasp",), "right_pad"), (("phases", 1), "left_pad")]
)
def test_an_open_linkage_is_not_verified(held, entry, joint):
    _, _, file = held
    data = json.loads(file.read_text())
    record = data["hand"]
    for key in entry:
        record = record[key]
    record["joint_positions"][joint] += 0.01
    edited = file.with_name("open.json")
    edited.write_text(json.dumps(data))
    text = str(ng.verify(edited))
    assert text.splitlines()[-1].startswith("NOT verified")
    assert re.search(r"FAIL joints: .*connect of (\w+)_pad and \1_rocker closed: 0\.000\d+ is outside", text)


@pytest.mark.slow
def test_a_file_without_an_equation_of_its_linkages_is_not_verified(held):
    _, _, file = held
    data = json.loads(file.read_text())
    rows = [row for row in data["constraints"] if row["name"].startswith("closed linkage")]
    data["constraints"].remove(rows[-1])
    edited = file.with_name("without.json")
    edited.write_text(json.dumps(data))
    text = str(ng.verify(edited))
    assert re.search(rf"FAIL hand: .*closed linkage: {len(rows)} equations, {len(rows) - 1} in the file", text)


@pytest.mark.slow
def test_passive_joints_with_an_actuator_are_not_verified(held):
    _, _, file = held
    data = json.loads(file.read_text())
    data["problem"]["hand"]["passive"].append("right_crank")
    edited = file.with_name("passive.json")
    edited.write_text(json.dumps(data))
    assert "problem.hand.passive: got right_crank, expected joints that no actuator moves" in str(ng.verify(edited))


@pytest.mark.slow
def test_scenes_keep_the_equalities_and_the_hand_holds(held):
    solution, path, _ = held
    scene = mujoco.MjModel.from_xml_string(mjcf_with_hand(solution, path))
    kinds = scene.eq_type.tolist()
    assert (kinds.count(0), kinds.count(2)) == (3, 1)
    assert [scene.actuator(i).name for i in range(scene.nu)][3:] == ["hand_right_crank"]
    outcome = ng.simulate_hand(solution, path)
    assert outcome.held
    assert re.search(r"as solved +(\d+) of \1 wrenches and the lift held", str(outcome))


@pytest.mark.slow
@pytest.mark.skipif(not ROBOTIQ.is_file(), reason=MISSING)
@pytest.mark.filterwarnings("ignore:.*nothing keeps links without a collision shape")
def test_menageries_robotiq_closes_its_linkages():
    with pytest.warns(
        UserWarning, match="kept at the limits where springs hold them: right_coupler_joint, left_coupler"
    ):
        hand = ng.URDFHand.load(ROBOTIQ, PADS)
    assert hand.loaded_joints == ("left_driver_joint",)
    assert hand.robot.stop_positions == {"right_coupler_joint": 0.0, "left_coupler_joint": 0.0}
    task = ng.lift([0, 0, 0], 0.2) + ng.disturbance(1, 0.02)
    problem = ng.GraspProblem(ng.Cylinder(0.03, 0.12), ng.SoftContact(0.6, 0.01), task, hand=hand)
    solution = ng.solve(problem, starts=2, options=GRASP)
    assert solution.success
    assert max(np.max(np.abs(errors(ROBOTIQ, positions))) for positions in postures(solution)) < 1e-4
    outcome = ng.simulate_hand(solution, ROBOTIQ)
    assert outcome.confirmed
    assert re.search(r"as solved +(\d+) of \1 wrenches and the lift held", str(outcome))
