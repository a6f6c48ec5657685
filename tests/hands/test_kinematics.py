"""Forward kinematics against MuJoCo; link spheres against the shapes they enclose."""

import re

import casadi as ca
import numpy as np
import pytest
from nlpgrasp.hands.link_spheres import fit_spheres

import nlpgrasp as ng
from nlpgrasp.hands.collision_shapes import CollisionShape
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
        stacked = np.asarray(hand.tree.link_function(q).full())
        for i, link in enumerate(hand.tree.used_links):
            if link != hand.robot.root:
                np.testing.assert_allclose(stacked[:, 4 * i : 4 * i + 4], expected[link], atol=1e-9)


def test_axes_that_are_not_unit_and_joints_without_one(tmp_path, rng):
    """URDF's default axis is x, and a scaled axis is the same axis."""
    text = (
        FOUR.read_text().replace('<axis xyz="0 1 0"/>', '<axis xyz="0 3 0"/>').replace('    <axis xyz="1 0 0"/>\n', "")
    )
    (tmp_path / "hand.urdf").write_text(text)
    hand = ng.URDFHand.load(tmp_path / "hand.urdf", {"thumb_tip": 0.011})
    q = rng.uniform(*hand.tree.joint_limits)
    np.testing.assert_allclose(
        hand.tree.link_function(q).full(), four_finger_hand().tree.link_function(q).full(), atol=1e-12
    )


def test_mimic_joint_follows_and_narrows_the_limits(tmp_path):
    text = GRIPPER.read_text().replace('multiplier="1" offset="0"', 'multiplier="2" offset="0.01"')
    (tmp_path / "hand.urdf").write_text(text)
    hand = ng.URDFHand.load(tmp_path / "hand.urdf", {"left_pad": PADS["left_pad"]})
    assert hand.tree.joint_positions(np.array([0.015])) == pytest.approx({"left_slide": 0.015, "right_slide": 0.04})
    np.testing.assert_allclose(hand.tree.joint_limits, [[0.0], [0.02]])  # 2 q + 0.01 <= 0.05


def test_palm_is_any_link_and_what_is_above_is_left_out():
    hand = ng.URDFHand.load(FOUR, {"index_tip": 0.01}, palm="index_knuckle")
    assert hand.robot.root == "index_knuckle"
    assert [j.name for j in hand.robot.free_joints] == [f"index_{n}_flexion" for n in ("proximal", "middle", "distal")]


SHAPES = {
    "sphere": [CollisionShape.sphere(0.01, np.eye(4))],
    "capsule": [
        CollisionShape.cylinder(0.009, 0.04, np.eye(4)),
        CollisionShape.sphere(0.009, np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.02], [0, 0, 0, 1.0]])),
        CollisionShape.sphere(0.009, np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -0.02], [0, 0, 0, 1.0]])),
    ],
    "box": [CollisionShape.box(np.array([0.02, 0.09, 0.1]), np.eye(4))],
    "finger of a gripper": [CollisionShape.box(np.array([0.02, 0.012, 0.06]), np.eye(4))],
}


# metres: largest distances that spheres reach beyond the shape, and the shape out of the spheres
MOST = {"sphere": (1e-9, 0.0), "capsule": (0.003, 0.0), "box": (0.003, 0.01), "finger of a gripper": (0.003, 0.002)}


@pytest.mark.parametrize("name", SHAPES)
def test_spheres_enclose_the_shape_with_the_stated_errors(name, rng):
    shapes = SHAPES[name]
    fit = fit_spheres(shapes, 12)
    assert len(fit.radii) <= 12
    surface = np.concatenate([s.mesh.sample(4000, seed=1) for s in shapes])
    outside = np.min(np.linalg.norm(surface[:, None] - fit.centres, axis=2) - fit.radii, axis=1)
    assert np.max(outside) <= fit.uncovered + 1e-4
    directions = rng.standard_normal((300, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    reach = (fit.centres[:, None] + fit.radii[:, None, None] * directions).reshape(-1, 3)
    beyond = -np.max([s.depth(reach) for s in shapes], axis=0)
    assert np.max(beyond) <= fit.error + 1e-4
    assert fit.error <= MOST[name][0]
    assert fit.uncovered <= MOST[name][1]


def test_more_spheres_leave_less_of_a_thick_link_uncovered():
    box = [CollisionShape.box(np.array([0.02, 0.04, 0.1]), np.eye(4))]
    fits = [fit_spheres(box, most) for most in (4, 12, 40)]
    assert [fit.error for fit in fits] == [0.003] * 3
    assert 0.02 > fits[0].uncovered > 1.5 * fits[1].uncovered > 2.0 * fits[2].uncovered


def test_more_spheres_are_closer_to_a_thin_link():
    rod = [CollisionShape.box(np.array([0.004, 0.004, 0.03]), np.eye(4))]
    fits = [fit_spheres(rod, most) for most in (4, 6, 20)]
    assert 0.003 > fits[0].error > fits[1].error > fits[2].error
    assert [fit.uncovered for fit in fits] == [0.0] * 3


def test_spheres_of_a_fingertips_own_links_leave_it_free():
    """No sphere fixed to a round fingertip reaches farther than a cone of 20 degrees around it."""
    hand = four_finger_hand()
    fit = hand.fits["index_distal"]
    away = np.linalg.norm(fit.centres - [0.0, 0.0, 0.026], axis=1)
    assert np.all(fit.radii <= 0.011 + np.sin(np.radians(20.0)) * away + 1e-12)
    assert "index_tip" not in hand.fits  # the tip's own sphere is the fingertip itself


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
    stacked = np.asarray(hand.tree.link_function(q).full())
    for i, link in enumerate(hand.tree.used_links):
        np.testing.assert_allclose(stacked[:, 4 * i : 4 * i + 4], expected[link], atol=1e-12)


SPHERE_AT_A = '<collision><geometry><sphere radius="0.01"/></geometry></collision>'


def test_a_link_thicker_than_its_fingertip_is_said_to_be(tmp_path):
    text = CHAIN.format("revolute", "0 0 0", "1 0 0", "revolute").replace(
        '<sphere radius="0.01"/>', '<cylinder radius="0.02" length="0.05"/>'
    )
    (tmp_path / "fat.urdf").write_text(text)
    with pytest.warns(UserWarning, match=r"thicker than its fingertip: beside a contact it may reach \d+\.\d mm into"):
        fit = ng.URDFHand.load(tmp_path / "fat.urdf", {"tip": 0.004}).fits["tip"]
    assert 0.01 < fit.uncovered < 0.03


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
        assert fit_spheres([shape], 6).error < 1.5 * scale
