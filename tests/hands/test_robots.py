"""Robot files of example-robot-data: each loads, or the error names the remedy."""

import importlib.util
import re
import shutil

import numpy as np
import pytest

import nlpgrasp as ng
from tests.hands.robots import robot

RIGHT = np.pi / 2.0
QUICK = ng.SolveOptions(workers=1)
PR2 = "pr2_description/urdf/pr2.urdf"
KINOVA = "kinova_description/robots/kinova.urdf"
PSYONIC = "alex_description/urdf/alex_psyonic_hands.urdf"
ANCHORS = [f"Left_{finger}_anchor" for finger in ("thumb", "index", "middle")]

THICKER = "ignore:link .* is thicker than its fingertip:UserWarning"
needs_collada = pytest.mark.skipif(
    importlib.util.find_spec("collada") is None, reason='no pycollada: pip install "nlpgrasp[hands]"'
)


def pad(size, offset, side):
    """A flat pad that faces along -y (side 1) or y (side -1) of its link."""
    return ng.FlatTip([size, size], offset, (side * RIGHT, 0.0, 0.0))


def facing(size, offset):
    """A flat pad that faces along -x of its link."""
    return ng.FlatTip([size, size], offset, (0.0, -RIGHT, 0.0))


def ends(names, radius, offset):
    return {name: ng.SphereTip(radius, offset) for name in names}


# file, palm, fingertips, radius of a sphere to hold, free joints
HANDS = {
    "Unitree G1": (
        "g1_description/urdf/g1_29dof_with_hand_rev_1_0.urdf",
        "left_hand_palm_link",
        dict.fromkeys(["left_hand_thumb_2_link", "left_hand_middle_1_link", "left_hand_index_1_link"]),
        0.03,
        7,
    ),
    "Tiago": (
        "tiago_description/robots/tiago.urdf",
        "hand_palm_link",
        dict.fromkeys([f"hand_{f}_link" for f in ("thumb_flex_2", "index_flex_3", "middle_flex_3")]),
        0.025,
        36,
    ),
    "Tiago Pro": (
        "tiago_pro_description/robots/tiago_pro.urdf",
        "gripper_left_base_link",
        {f"gripper_left_fingertip_{s}_link": facing(0.015, (-0.0115, 0.03, 0)) for s in ("left", "right")},
        0.02,
        1,
    ),
    "Baxter": (
        "baxter_description/urdf/baxter.urdf",
        "left_gripper_base_link",
        {
            "l_gripper_l_finger_tip": pad(0.03, (0, -0.0078, -0.015), 1),
            "l_gripper_r_finger_tip": pad(0.03, (0, 0.0078, -0.015), -1),
        },
        0.02,
        1,
    ),
    "PR2": (
        PR2,
        "r_gripper_palm_link",
        {
            "r_gripper_l_finger_tip_link": pad(0.015, (0.018, -0.0158, 0), 1),
            "r_gripper_r_finger_tip_link": pad(0.015, (0.018, 0.0158, 0), -1),
        },
        0.02,
        1,
    ),
    "SO-100": (
        "so_arm_description/urdf/so100.urdf",
        "gripper",
        ends(["gripper"], 0.008, (0, -0.098, 0)) | ends(["jaw"], 0.008, (-0.002, -0.074, 0)),
        0.02,
        1,
    ),
}
FAST = "SO-100"
SAID = {
    "PR2": "pr2.urdf: taken with the other sign: limits 0 to 0.548 of joint r_gripper_r_parallel_root_joint, which "
    "follows joint r_gripper_l_finger_joint with multiplier -1",
    "SO-100": "so100.urdf: nothing keeps links without a collision shape off the body: gripper, jaw",
}


def load_robot(name):
    path, palm, tips, _, _ = HANDS[name]
    return ng.URDFHand.load(robot(path), tips, palm=palm)


@pytest.mark.filterwarnings("ignore:.*not the visible hand:UserWarning")
@pytest.mark.filterwarnings("ignore:pr2.urdf", "ignore:so100.urdf")
@pytest.mark.parametrize("name", HANDS)
def test_hands_load(name):
    hand = load_robot(name)
    lower, upper = hand.tree.joint_limits
    assert len(lower) == HANDS[name][4]
    assert np.all(lower < upper)
    assert not hand.robot.missing


@pytest.mark.parametrize("name", SAID)
def test_what_is_wrong_with_a_file_is_said(name):
    with pytest.warns(UserWarning, match=r"urdf: (taken|nothing)") as caught:
        load_robot(name)
    assert SAID[name] in [str(warning.message) for warning in caught]


@pytest.mark.filterwarnings("ignore:.*not the visible hand:UserWarning")
@pytest.mark.filterwarnings(THICKER, "ignore:pr2.urdf", "ignore:so100.urdf")
@pytest.mark.parametrize("name", [pytest.param(n, marks=() if n == FAST else pytest.mark.slow) for n in HANDS])
def test_hands_hold_a_sphere(name, tmp_path):
    path, _, tips, radius, _ = HANDS[name]
    contact = ng.SoftContact(0.7, 0.3) if len(tips) == 2 else ng.FrictionContact(0.7)
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, radius, radius, radius])
    problem = ng.GraspProblem(ng.Sphere(radius), contact, task, hand=load_robot(name), edge_margin=0.0)
    solution = ng.solve(problem, starts=1, options=QUICK)
    assert solution.status is ng.Status.SOLVED
    assert solution.mu.lower > 0.3
    solution.save(tmp_path / "grasp.json")
    checked = ng.verify(tmp_path / "grasp.json", folders=[robot(path).parent])
    assert checked.passed, str(checked)


@pytest.mark.slow
@pytest.mark.filterwarnings(THICKER)
def test_talos_holds_a_box():
    """Three flat pads, two of them beside each other; the linkage's rods overlap in most of its positions."""
    inner = ng.FlatTip([0.015, 0.026], (0, -0.005, -0.0155), (RIGHT, 0.0, 0.0))  # the flat part of the pads' mesh
    tips = {f"gripper_left_fingertip_{i}_link": inner for i in (1, 2, 3)}
    path = robot("talos_data/robots/talos_full_v2.urdf")
    hand = ng.URDFHand.load(path, tips, palm="gripper_left_base_link")
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
    problem = ng.GraspProblem(ng.Box([0.1, 0.04, 0.05]), ng.FrictionContact(0.7), task, hand=hand)
    solution = ng.solve(problem, starts=8, options=QUICK)  # of single starts 3 in 8 find a grasp
    assert solution.status is ng.Status.SOLVED


def test_joint_to_follow_that_is_not_there_names_the_one_that_is_meant(tmp_path):
    path = robot(PSYONIC)
    wanted = "joint Left_index_q2 that mimics 'index_q1', expected a moving joint: Left_index_q1"
    with pytest.raises(ng.InputError, match=f"{wanted}$"):
        ng.URDFHand.load(path, ANCHORS, palm="Left_thumb_base")


@pytest.mark.filterwarnings(THICKER, "ignore:.*fitted to those of:UserWarning")
def test_mended_as_told_it_loads(tmp_path):
    path = robot(PSYONIC)
    mended = re.sub(r'mimic joint *= *"(\w+_q1)"', r'mimic joint="Left_\1"', path.read_text())
    folder = tmp_path / "robots" / "alex_description"
    folder.mkdir(parents=True)
    (folder / "meshes").symlink_to(path.parents[1] / "meshes")
    shutil.copy(path, folder / path.name)
    (folder / path.name).write_text(mended)
    hand = ng.URDFHand.load(folder / path.name, ANCHORS, palm="Left_thumb_base")
    assert [j.name for j in hand.robot.free_joints if j.name not in ("Left_thumb_q1", "Left_thumb_q2")] == [
        f"Left_{finger}_q1" for finger in ("index", "middle", "ring", "pinky")
    ]
    assert not hand.robot.missing


@pytest.mark.filterwarnings("ignore:.*beyond the shapes of its link:UserWarning")
@pytest.mark.slow
@needs_collada
def test_collada_is_read():
    hand = ng.URDFHand.load(robot(KINOVA), ["j2s6s200_link_finger_tip_1"])
    mesh = hand.robot.shapes["j2s6s200_link_6"][0].mesh
    np.testing.assert_allclose(mesh.extents, [0.063, 0.1085, 0.1204], atol=1e-4)  # of the file, which is in metres


@pytest.mark.slow
@needs_collada
def test_fixed_fingers_are_named():
    with pytest.raises(ng.InputError, match=r"no movable joints below j2s6s200_link_6 \(fixed: .*expected a hand"):
        ng.URDFHand.load(robot(KINOVA), ["j2s6s200_link_finger_tip_1"], palm="j2s6s200_link_6")


def test_xacro_is_told_from_a_urdf():
    path = robot("hector_description/robots/quadrotor_base.urdf.xacro")
    with pytest.raises(ng.InputError, match=r"got a xacro file.*expected the URDF that it makes: .*xacro quadrotor"):
        ng.URDFHand.load(path, {"base_link": 0.01})


def test_joint_without_a_range():
    path = robot("centauro_description/urdf/centauro.urdf")
    with pytest.raises(ng.InputError, match=r"joint j_wheel_1 without lower and upper in its <limit>, .* continuous"):
        ng.URDFHand.load(path, {"wheel_1": 0.01})
