"""Forward kinematics against MuJoCo; collision shapes; links thicker than their fingertips."""

import re

import casadi as ca
import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.hands.collision_shapes import CollisionShape
from nlpgrasp.hands.inspection import inspect
from tests.hands.urdf import (
    FOUR,
    GRIPPER,
    PADS,
    THREE,
    THREE_TIPS,
    Mujoco,
    four_finger_hand,
    gripper,
    three_finger_hand,
)
from tests.quick import first

HANDS = {"four": (four_finger_hand, FOUR), "three": (three_finger_hand, THREE), "gripper": (gripper, GRIPPER)}


@pytest.mark.parametrize("name", HANDS)
def test_links_are_where_mujoco_says(name, rng):
    make, path = HANDS[name]
    hand, simulator = make(), Mujoco(path)
    lower, upper = hand.tree.joint_limits
    for _ in range(10):
        q = rng.uniform(lower, upper)
        expected = simulator.link_poses(hand.tree.joint_positions(q))
        stacked = np.hstack(hand.tree.palm_poses(q[None])[0])
        at_palm = {"palm_position": ca.DM.zeros(3), "palm_quaternion": ca.DM([1, 0, 0, 0]), "joints": ca.DM(q)}
        symbolic = hand.tree.poses(at_palm, hand.tree.used_links)
        for i, link in enumerate(hand.tree.used_links):
            if link != hand.robot.root:
                np.testing.assert_allclose(stacked[:, 4 * i : 4 * i + 4], expected[link], atol=1e-9)
            np.testing.assert_allclose(stacked[:, 4 * i : 4 * i + 4], ca.DM(symbolic[link]), atol=1e-12)


def test_axes_that_are_not_unit_and_joints_without_one(tmp_path, rng):
    """URDF's default axis is x, and a scaled axis is the same axis."""
    text = (
        FOUR.read_text().replace('<axis xyz="0 1 0"/>', '<axis xyz="0 3 0"/>').replace('    <axis xyz="1 0 0"/>\n', "")
    )
    (tmp_path / "hand.urdf").write_text(text)
    hand = ng.URDFHand.load(tmp_path / "hand.urdf", {"thumb_tip": 0.011})
    q = rng.uniform(*hand.tree.joint_limits)
    np.testing.assert_allclose(hand.tree.palm_poses(q[None]), four_finger_hand().tree.palm_poses(q[None]), atol=1e-12)


def test_mimic_joint_follows_and_narrows_the_limits(tmp_path):
    text = GRIPPER.read_text().replace('multiplier="1" offset="0"', 'multiplier="2" offset="0.01"')
    (tmp_path / "hand.urdf").write_text(text)
    hand = ng.URDFHand.load(tmp_path / "hand.urdf", {"left_pad": PADS["left_pad"]})
    assert hand.tree.joint_positions(np.array([0.015])) == pytest.approx({"left_slide": 0.015, "right_slide": 0.04})
    np.testing.assert_allclose(hand.tree.joint_limits, [[0.0], [0.02]])  # 2 q + 0.01 <= 0.05


def test_palm_is_any_link_and_what_is_above_is_left_out():
    hand = ng.URDFHand.load(FOUR, {"index_tip": 0.011}, palm="index_knuckle")
    assert hand.robot.root == "index_knuckle"
    assert [j.name for j in hand.robot.free_joints] == [f"index_{n}_flexion" for n in ("proximal", "middle", "distal")]


def test_rows_of_the_hand_have_the_derivatives_they_claim(rng):
    """Every row of hand and clearances against central differences."""
    hand = four_finger_hand()
    body = ng.Ellipsoid([0.06, 0.03, 0.03])
    problem = ng.GraspProblem(
        body,
        ng.FrictionContact(0.7),
        ng.TaskEllipsoid([1.0] * 6),
        hand=hand,
        constraints=[
            ng.Table(-0.1),
            ng.Approach([1, 0, 0], 1.0),
            ng.Obstacle(ng.Box([0.1, 0.1, 0.1]), 0.0, [0.2, 0, 0]),
        ],
    )
    from nlpgrasp.nlp import optimal_grasp_program
    from nlpgrasp.nlp.derivatives import ProgramFunctions

    program = optimal_grasp_program(problem, "support", 2, eliminated=True)
    jacobian = ProgramFunctions(program).jacobian
    theta = rng.standard_normal(program.theta.shape[0])
    values, _tips = hand.draw(1, np.zeros((1, 3)), rng)
    z = 0.3 * rng.standard_normal(program.z.shape[0])
    for name, value in values.items():
        block = program.block("hand", name)
        z[block.range] = value[0] / block.scale
    J = np.asarray(jacobian(z, theta)[1].full())
    h = 1e-6
    numeric = np.stack(
        [
            (jacobian(z + h * e, theta)[0].full() - jacobian(z - h * e, theta)[0].full()).ravel() / (2.0 * h)
            for e in np.eye(len(z))
        ],
        axis=1,
    )
    scale = np.maximum(np.max(np.abs(numeric), axis=1, keepdims=True), 1.0)
    assert np.max(np.abs(J - numeric) / scale) < 1e-5


def test_missing_extra_names_the_command(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "adam.casadi", None)
    with pytest.raises(ng.NlpgraspError, match=re.escape('pip install "nlpgrasp[hands]"')):
        ng.URDFHand.load(THREE, THREE_TIPS)  # not after a solve has begun


def test_quaternion_is_the_rotation_it_says(rng):
    from scipy.spatial.transform import Rotation

    from nlpgrasp.hands.kinematics import rotation_matrix

    rotation = Rotation.random(rng=rng)
    matrix = ca.DM(rotation_matrix(ca.DM(rotation.as_quat(scalar_first=True))))
    np.testing.assert_allclose(matrix.full(), rotation.as_matrix(), atol=1e-12)


CHAIN = """<robot name="chain"><link name="palm"/><link name="a"/><link name="tip">
<collision><geometry><sphere radius="0.01"/></geometry></collision></link>
<joint name="first" type="{0}"><parent link="palm"/><child link="a"/><origin xyz="0.1 -0.2 0.3" rpy="{1}"/>
<axis xyz="{2}"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="second" type="{3}"><parent link="a"/><child link="tip"/><origin xyz="0 0.1 0" rpy="0.3 0.2 -0.5"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
@pytest.mark.parametrize("other", ["revolute", "prismatic"])
@pytest.mark.parametrize("rpy", ["0 0 0", "0 0 1", "0.7 -1.1 2.3"])
@pytest.mark.parametrize("axis", first(1, ["1 2 0.5", "1 0 0", "0 -3 0"]))
def test_every_kind_of_joint_with_every_origin_and_axis(tmp_path, kind, other, rpy, axis, rng):
    path = tmp_path / "chain.urdf"
    path.write_text(CHAIN.format(kind, rpy, axis, other).replace('name="a"/>', 'name="a">' + SPHERE_AT_A + "</link>"))
    hand = ng.URDFHand.load(path, {"tip": 0.01})
    q = rng.uniform(-1.0, 1.0, 2)
    expected = Mujoco(path).link_poses(hand.tree.joint_positions(q))
    stacked = np.hstack(hand.tree.palm_poses(q[None])[0])
    for i, link in enumerate(hand.tree.used_links):
        np.testing.assert_allclose(stacked[:, 4 * i : 4 * i + 4], expected[link], atol=1e-12)


SPHERE_AT_A = '<collision><geometry><sphere radius="0.01"/></geometry></collision>'


@pytest.mark.filterwarnings("ignore:link tip is thicker than its fingertip")
@pytest.mark.parametrize(
    ("tip", "depth"),
    [
        (0.004, "16"),  # least depth of the ball: the difference of the radii
        (ng.SphereTip(0.02, (0.0, 0.0, 0.01)), None),  # a cap of it is above the flat end
        (ng.FlatTip([0.01, 0.01], [0.0, 0.0, 0.0245]), None),
        (ng.FlatTip([0.01, 0.01], [0.0, 0.0, 0.024]), "1"),
    ],
)
def test_a_link_thicker_than_its_fingertip_is_said_to_be(tmp_path, tip, depth):
    text = CHAIN.format("revolute", "0 0 0", "1 0 0", "revolute").replace(
        '<sphere radius="0.01"/>', '<cylinder radius="0.02" length="0.05"/>'
    )
    (tmp_path / "fat.urdf").write_text(text)
    hand = ng.URDFHand.load(tmp_path / "fat.urdf", {"tip": tip}, tip_overhang=0.01)
    found = [finding.text for finding in inspect(hand).findings if "thicker" in finding.text]
    text = f"Link tip is thicker than its fingertip: beside a contact it may reach {depth} mm into the body."
    assert found == ([] if depth is None else [text])


def test_depth_in_a_capsule_is_that_of_its_axis(rng):
    shape = CollisionShape.capsule(0.01, 0.04, np.eye(4))
    points = rng.uniform(-0.04, 0.04, (200, 3))
    axis = np.linspace([0.0, 0.0, -0.02], [0.0, 0.0, 0.02], 4001)
    expected = 0.01 - np.min(np.linalg.norm(points[:, None] - axis, axis=2), axis=1)
    np.testing.assert_allclose(shape.depth(points), expected, atol=5e-6)


@pytest.mark.parametrize("scale", [1e-4, 1.0])
def test_shapes_of_any_size(scale):
    pose = np.eye(4)
    for shape in (
        CollisionShape.cylinder(scale, 4 * scale, pose),
        CollisionShape.capsule(scale, 4 * scale, pose),
        CollisionShape.sphere(scale, pose),
    ):
        assert np.max(shape.mesh.extents) == pytest.approx(
            {"cylinder": 4, "capsule": 6, "sphere": 2}[shape.kind] * scale
        )
