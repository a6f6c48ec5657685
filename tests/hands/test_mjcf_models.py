"""MJCF models of gymnasium-robotics and robosuite: each loads, or the error names the remedy."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.hands.robot_file import read_robot
from nlpgrasp.verify.chain_kinematics import links_in, poses
from tests.hands.mjcf import frames, tree_of
from tests.hands.robots import ADROIT, GRIPPERS, SHADOW, model

RIGHT = np.pi / 2.0
QUICK = ng.SolveOptions(workers=1)
QUIET = ("ignore:.*nothing keeps links", "ignore:.*joints move on their own", "ignore:link .* is thicker")
# file, palm, free joints, joints that follow
HANDS = {
    "Shadow": (SHADOW, "robot0:palm", 22, 0),
    "Shadow with its wrist": (SHADOW, "robot0:hand mount", 24, 0),
    "Adroit": (ADROIT, "palm", 22, 0),
    "Adroit with its wrist": (ADROIT, "forearm", 24, 0),
    "Robotiq 140": (f"{GRIPPERS}/robotiq_gripper_140.xml", None, 2, 4),
    "Robotiq 3-Finger": (f"{GRIPPERS}/robotiq_gripper_s.xml", None, 7, 4),
    "Panda": (f"{GRIPPERS}/panda_gripper.xml", None, 2, 0),
    "Rethink": (f"{GRIPPERS}/rethink_gripper.xml", None, 2, 0),
    "Jaco": (f"{GRIPPERS}/jaco_three_finger_gripper.xml", None, 6, 0),
    "Inspire": (f"{GRIPPERS}/inspire_right_hand.xml", None, 12, 0),
    "Fourier": (f"{GRIPPERS}/fourier_left_hand.xml", None, 11, 0),
    "Spot": (f"{GRIPPERS}/bd_gripper.xml", None, 1, 0),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", HANDS)
def test_bodies_are_where_mujoco_has_them(name, rng):
    file, palm, free_count, following = HANDS[name]
    path = model(file)
    robot = read_robot(path, palm)
    tree = tree_of(robot)
    assert (len(robot.free_joints), sum(j.mimic is not None for j in robot.joints)) == (free_count, following)
    lower, upper = tree.joint_limits
    links = links_in(path, robot.root)
    for q in rng.uniform(lower, upper, (5, free_count)):
        positions = tree.joint_positions(q)
        expected, stacked = frames(path, positions, robot.root), np.hstack(tree.palm_poses(q[None])[0])
        numeric_poses = poses(links, robot.root, np.eye(4), positions)
        for i, link in enumerate(tree.used_links):
            np.testing.assert_allclose(stacked[:, 4 * i : 4 * i + 4], expected[link], atol=1e-12)
            np.testing.assert_allclose(numeric_poses[link], expected[link], atol=1e-12)


@pytest.mark.parametrize(
    ("file", "palm", "match"),
    [
        (f"{GRIPPERS}/robotiq_gripper_85.xml", None, "repeated name .*expected an MJCF file that MuJoCo reads"),
        (f"{GRIPPERS}/xarm7_gripper.xml", None, "unrecognized attribute.*expected an MJCF file that MuJoCo reads"),
        (ADROIT.replace("pen", "model"), "palm", "a part that other files include"),
        (SHADOW, None, "bodies floor0, robot0:hand mount side by side, expected palm="),
        (f"{GRIPPERS}/wiping_gripper.xml", None, "no movable joints .*expected a hand with joints that move"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*not the visible hand:UserWarning")
def test_what_is_refused(file, palm, match):
    with pytest.raises(ng.InputError, match=match):
        ng.URDFHand.load(model(file), {"wiping_gripper": None}, palm=palm)


@pytest.mark.filterwarnings("ignore:.*not the visible hand:UserWarning")
@pytest.mark.filterwarnings("ignore:.*nothing keeps links")
def test_the_shadow_preset_takes_it():
    with pytest.warns(UserWarning, match="joints move on their own where the file couples them: tendon robot0:T_FFJ1c"):
        hand = ng.hands.shadow(model(SHADOW))
    assert [link for link, _ in hand.tips][0::4] == ["robot0:ffdistal", "robot0:thdistal"]
    assert [tip.kind for _, tip in hand.tips] == ["capsule"] * 5  # the file's own
    assert hand.tips[0][1].ends[1] == pytest.approx([0.0, 0.0, 0.024])
    assert hand.torque_limits["robot0:THJ4"] == 2.3722
    assert "robot0:FFJ0" not in hand.torque_limits  # a tendon alone drives it


def held(hand, body, contact, path, folder):
    problem = ng.GraspProblem(body, contact, ng.TaskEllipsoid([1.0] * 3 + [0.03] * 3), hand=hand, edge_margin=0.0)
    solution = ng.solve(problem, starts=2, options=QUICK)
    assert solution.status is ng.Status.SOLVED
    solution.save(folder / "grasp.json")
    checked = ng.verify(folder / "grasp.json", folders=[path.parent])
    assert checked, str(checked)
    return solution


@pytest.mark.slow
@pytest.mark.filterwarnings(*QUIET)
def test_the_panda_gripper_holds_an_ellipsoid(tmp_path):
    path = model(f"{GRIPPERS}/panda_gripper.xml")
    pads = {"leftfinger": 1.0, "rightfinger": -1.0}
    tips = {link: ng.FlatTip([0.0175, 0.0185], [0, 0, 0.04525], [s * RIGHT, 0, 0]) for link, s in pads.items()}
    hand = ng.URDFHand.load(path, tips, tip_overhang=3e-3)  # pads without a shape in the file stand off the finger
    assert held(hand, ng.Ellipsoid([0.03, 0.02, 0.02]), ng.SoftContact(0.7, 0.3), path, tmp_path).mu.lower > 0.4


@pytest.mark.filterwarnings("ignore:.*not the visible hand:UserWarning")
@pytest.mark.slow
@pytest.mark.filterwarnings(*QUIET)
def test_five_capsules_hold_an_ellipsoid(tmp_path):
    path = model(SHADOW)
    hand = ng.hands.shadow(path)
    assert held(hand, ng.Ellipsoid([0.05, 0.035, 0.035]), ng.FrictionContact(0.7), path, tmp_path).mu.lower > 0.8
