"""Squeeze by a hand: torques against virtual work and MuJoCo, commands, limits, files."""

from copy import copy
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.analysis.squeeze import add_squeeze, add_squeezes
from nlpgrasp.common.formatting import format_number
from nlpgrasp.solution.force_records import ForcesNeeded
from nlpgrasp.solution.squeeze_record import JointSqueeze
from tests.hands.urdf import FOLDER, THREE, Mujoco, body_frame, solution_links, three_finger_hand
from tests.verify import honest
from tests.verify.edits import put
from tests.verify.stated import edited


@cache
def grasped():
    """A sphere among three fingertips; the file states no squeeze yet."""
    return ng.GraspSolution.from_dict(honest.fingers(), "f.json")


@cache
def squeezed():
    return add_squeeze(grasped(), three_finger_hand())


def test_torques_do_the_forces_work():
    """Central differences of the contacts' places, which are fixed to links that MuJoCo poses."""
    solution, squeeze = grasped(), ng.squeeze(grasped(), 2.0, 0.2, hand=three_finger_hand())
    links = [t["link"] for t in solution.problem["hand"]["fingertips"]]
    link_frames = solution_links(THREE, solution.hand)
    fixed = [np.linalg.inv(link_frames[link]) @ [*p, 1.0] for link, p in zip(links, solution.grasp.points, strict=True)]

    def places(joint, step):
        moved = {**solution.hand["joint_positions"]}
        moved[joint] += step
        poses = solution_links(THREE, {**solution.hand, "joint_positions": moved})
        return np.array([(poses[link] @ p)[:3] for link, p in zip(links, fixed, strict=True)])

    for joint, tau in squeeze.torques.items():
        work = np.sum(squeeze.forces * (places(joint, 1e-6) - places(joint, -1e-6)) / 2e-6)
        assert tau == pytest.approx(work, abs=1e-7)
    assert max(map(abs, squeeze.torques.values())) > 0.01


def test_torques_are_those_of_mujocos_jacobians():
    solution, squeeze = grasped(), ng.squeeze(grasped(), 2.0, hand=three_finger_hand())
    simulator = Mujoco(THREE)
    simulator.link_poses(solution.hand["joint_positions"])
    mujoco.mj_comPos(simulator.model, simulator.data)
    base = np.linalg.inv(body_frame(solution.hand["palm_pose"]))
    total = np.zeros(simulator.model.nv)
    for tip, p, f in zip(solution.hand["fingertips"], solution.grasp.points, squeeze.forces, strict=True):
        jacobian = np.zeros((3, simulator.model.nv))
        mujoco.mj_jac(
            simulator.model,
            simulator.data,
            jacobian,
            None,
            base[:3, :3] @ p + base[:3, 3],
            simulator.model.body(tip).id,
        )
        total += jacobian.T @ (base[:3, :3] @ f)
    expected = {joint: total[simulator.model.joint(joint).dofadr[0]] for joint in squeeze.torques}
    assert squeeze.torques == pytest.approx(expected, abs=1e-9)


def test_grasps_kept_beside_the_answer_have_their_own():
    alternative = replace(grasped().grasps[0], grasp=copy(grasped().grasp))
    result = add_squeezes(replace(squeezed(), others=(alternative,)), three_finger_hand())
    assert result.others[0].hand["squeeze"]["torques"] == pytest.approx(squeezed().squeeze.torques)
    assert result.hand == squeezed().hand


def test_commands_are_ahead_of_the_grasp_by_torque_over_gain():
    squeeze = ng.squeeze(grasped(), 2.0, gain=4.0, hand=three_finger_hand())
    grasp = grasped().hand["joint_positions"]
    joint, tau = next(iter(squeeze.torques.items()))
    assert squeeze.positions()[joint] == pytest.approx(grasp[joint] + tau / 4.0)
    assert squeeze.positions(1.0)[joint] == pytest.approx(grasp[joint] + tau)
    gains = dict.fromkeys(squeeze.torques, 2.0) | {joint: 8.0}
    assert squeeze.positions(gains)[joint] == pytest.approx(grasp[joint] + tau / 8.0)


def test_efforts_that_are_too_small_are_named():
    weak = edited(honest.fingers(), put(("problem", "hand", "torque_limits", "finger_1_proximal_flexion"), 1e-3))
    squeeze = ng.squeeze(ng.GraspSolution.from_dict(weak, "f.json"), 2.0)
    assert squeeze.joints is None  # the file holds no Jacobians
    data = edited(weak, put(("hand",), dict(squeezed().hand)))
    solution = ng.GraspSolution.from_dict(data, "f.json")
    squeeze = ng.squeeze(solution, 2.0)
    name, share = squeeze.joints.worst
    assert name == "finger_1_proximal_flexion"
    assert share == pytest.approx(abs(squeeze.torques[name]) / 1e-3)
    assert squeeze.joints.exceeded == {name: pytest.approx(abs(squeeze.torques[name]) - 1e-3)}
    assert f"MORE than the effort of {name} (" in squeeze.line()


def test_a_solution_states_no_more_than_weak_joints_can_exert():
    usual = squeezed().squeeze
    name = max(usual.torques, key=lambda joint: abs(usual.torques[joint]))
    effort = abs(usual.torques[name]) / 2.0
    data = edited(honest.fingers(), put(("problem", "hand", "torque_limits"), dict.fromkeys(usual.torques, effort)))
    weak = three_finger_hand(torque_limits=effort)
    squeeze = add_squeeze(ng.GraspSolution.from_dict(data, "f.json"), weak).squeeze
    assert squeeze.joints.worst == (name, pytest.approx(0.98, rel=1e-6))
    assert squeeze.normal_force == pytest.approx(0.98, rel=1e-6)  # half of 2 N, and a little less
    assert squeeze.joints.exceeded == {}
    assert usual.normal_force == 2.0


def test_a_solution_states_no_squeeze_above_max_force():
    usual = squeezed().squeeze
    limit = 0.5 * usual.largest
    solution = add_squeeze(ng.GraspSolution.from_dict(at_most(limit), "f.json"), three_finger_hand())
    assert solution.squeeze.largest == pytest.approx(limit, rel=1e-6)
    assert solution.squeeze.normal_force == pytest.approx(1.0, rel=1e-6)
    assert "max_force" not in solution.squeeze_line()
    line = ng.GraspSolution.from_dict({**at_most(limit), "hand": dict(squeezed().hand)}, "f.json").squeeze_line()
    assert line.endswith(f"; ABOVE max_force = {format_number(limit)} N")


def at_most(limit):
    return edited(honest.fingers(), put(("problem", "max_force"), limit))


def test_print_names_fingers_what_each_presses_and_what_the_task_takes_of_the_joints():
    forces = grasped().grasp.normals * [[3.0], [2.0], [1.0]]
    needed = ForcesNeeded.of(grasped().grasp, np.zeros(6), forces, None, [], ng.Bounds(1.0, 1.0))
    solution = replace(squeezed(), needed=needed)
    text = str(solution)
    pressed = ", ".join(map(format_number, solution.squeeze.normal))
    assert f"a squeeze with at least 2 N a finger (normal forces {pressed} N) needs friction " in text
    for i, tip in enumerate(solution.hand["fingertips"]):
        assert f"contact {i} ({tip}) on " in text
    jacobians = solution.squeeze.joints.jacobians  # MuJoCo's, as another test shows
    torques = sum(jacobians[i, :3].T @ force for i, force in enumerate(forces))
    names, limits = list(solution.squeeze.torques), solution.squeeze.joints.limits
    share, name = max((abs(tau) / limits[joint], joint) for tau, joint in zip(torques, names, strict=True))
    assert f"these forces take at most {100.0 * share:.3g} % of a joint's effort ({name})\n" in text


def test_a_file_holds_the_squeeze_and_makes_others(tmp_path):
    squeezed().save(tmp_path / "held.json")
    again = ng.GraspSolution.load(tmp_path / "held.json")
    assert again.squeeze.to_dict() == squeezed().squeeze.to_dict()
    assert min(again.squeeze.joints.gain.values()) >= 1.0
    assert set(again.squeeze.positions()) == set(again.squeeze.joints.gain) == set(three_finger_hand().loaded_joints)
    assert again.squeeze.line() in str(again)
    by_hand = ng.squeeze(grasped(), 1.0, 0.1, hand=three_finger_hand())
    assert ng.squeeze(again, 1.0, 0.1).torques == pytest.approx(by_hand.torques)
    checks = {check.name: check for check in ng.verify(tmp_path / "held.json", folders=[FOLDER]).checks}
    assert checks["squeeze"].passed
    assert checks["squeeze torques"].passed


def test_contacts_that_cannot_press_are_told_everywhere(tmp_path):
    """The three contacts' normals are turned into a cone about one direction: whatever is pushed goes one way."""
    above = grasped().grasp.normals.mean(axis=0) + np.array([0.0, 0.0, 3.0])
    normals = above / np.linalg.norm(above) + 0.3 * grasped().grasp.normals
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    slippery = [ng.FrictionContact(0.2)] * 3
    open_grasp = ng.Grasp(grasped().grasp.points, normals, slippery, grasped().grasp.torque_origin)
    solution = add_squeeze(replace(grasped(), grasp=open_grasp), three_finger_hand())
    reason_data = solution.hand["no_squeeze"]
    assert reason_data["reason"].startswith("contacts 0, 1, 2 cannot press with friction 0.2")
    assert solution.squeeze is None
    assert f"the hand cannot squeeze the body: {reason_data['reason']}" in str(solution)
    assert "disturbance(force, torque, point)" in solution.squeeze_line()
    with pytest.raises(ng.InputError, match="contacts 0, 1, 2 cannot press"):
        solution.require_squeeze()
    rough = [ng.FrictionContact(1.01 * reason_data["friction"])] * 3
    grown = ng.Grasp(grasped().grasp.points, normals, rough, grasped().grasp.torque_origin)
    assert ng.squeeze(grown).share == pytest.approx(1.0 / 1.01, rel=1e-4)


def test_a_quick_solve_has_none_and_another_keeps_what_is_there():
    assert grasped().squeeze is None
    assert add_squeeze(squeezed(), three_finger_hand()) is squeezed()
    assert add_squeeze(grasped(), None) is grasped()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ng.squeeze(grasped(), hand=ng.Fingertips(3)), "hand: got Fingertips.*a hand with joints"),
        (lambda: ng.squeeze(grasped(), gain=2.0), "gain.*a hand whose joints are known"),
        (lambda: ng.squeeze(squeezed(), gain=0.0), "gain.*greater than 0"),
        (
            lambda: ng.squeeze(squeezed(), gain=dict.fromkeys([*three_finger_hand().loaded_joints, "elbow"], 1.0)),
            "joint elbow, expected joints that move a contact",
        ),
        (lambda: ng.squeeze(squeezed()).positions(), "gain"),
        (lambda: ng.squeeze(squeezed()).positions({"finger_1_proximal_flexion": 1.0}), "gain: got none for finger_"),
    ],
)
def test_bad_input_is_one_sentence(make, message):
    with pytest.raises(ng.InputError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_a_file_whose_joints_the_hand_lacks_is_refused():
    data = edited(squeezed().to_dict(), lambda d: d["hand"]["joint_positions"].pop("finger_1_proximal_flexion"))
    with pytest.raises(ng.InputError, match=r"f.json: hand.squeeze.torques.*joint finger_1_proximal_flexion"):
        ng.GraspSolution.from_dict(data, "f.json")


@pytest.mark.parametrize(
    ("path", "wrong", "message"),
    [
        (("problem", "hand", "torque_limits"), -1.0, "problem.hand.torque_limits.*limits by joint"),
        (("problem", "hand", "torque_limits", "finger_1_proximal_flexion"), 0.0, "finger_1_proximal_flexion.*greater"),
        (("problem", "hand", "torque_limits", "finger_1_proximal_flexion"), "text", "finger_1_proximal_flexion"),
        (("hand", "squeeze", "jacobians", 0), [[1.0]], "hand.squeeze.jacobians"),
        (("hand", "squeeze", "gain"), {}, "gain: got none for finger_1"),
        (("hand", "squeeze", "wrench"), [0.0, 0.0, 0.0], "hand.squeeze.wrench"),
        (("hand", "squeeze", "fingers", 0, "force"), [0.0, 0.0], "hand.squeeze.fingers.force"),
    ],
)
def test_a_file_that_makes_no_sense_is_refused(path, wrong, message):
    with pytest.raises(ng.InputError, match=message):
        ng.GraspSolution.from_dict(edited(squeezed().to_dict(), put(path, wrong)), "f.json")


def test_joints_that_slide_have_forces_and_those_that_turn_torques():
    """What is above the limit of a joint that slides is counted in newtons, whatever turns with the others."""
    jacobians = np.zeros((2, 6, 2))
    jacobians[:, 0, 0] = [1.0, -1.0]  # slides along x
    jacobians[0, :, 1] = [0.0, 0.05, 0.0, 0.0, 0.0, 1.0]  # turns about z, 50 mm away
    wrenches = np.array([[3.0, 2.0, 0, 0, 0, 0], [-3.0, 0, 0, 0, 0, 0]])
    limits, positions = {"slide": 4.0, "turn": 0.01}, {"slide": 0.0, "turn": 0.0}
    squeeze = JointSqueeze.of(("slide", "turn"), wrenches, jacobians, limits, positions, None, ["slide"])
    assert squeeze.torques == pytest.approx({"slide": 6.0, "turn": 0.1})
    assert squeeze.words() == "MORE than the effort of slide (by 2 N), turn (by 0.09 N m)"


def test_a_task_beyond_the_joints_effort_is_said_first():
    """Forces of 3, 2 and 1 N, and of 300 times as much."""
    grasp, forces = grasped().grasp, grasped().grasp.normals * [[3.0], [2.0], [1.0]]
    for times, beyond in ((1.0, False), (300.0, True)):
        needed = ForcesNeeded.of(grasp, np.zeros(6), times * forces, None, [], ng.Bounds(1.0, 1.0))
        solution = replace(squeezed(), needed=needed)
        assert ("but the task takes MORE than the effort of " in solution.title) is beyond
        assert (" N m)" in solution.title) is beyond
