"""Irregular URDFs: missing signs and shapes, xacro and COLLADA, arms above the palm."""

import re
import sys
import warnings

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.hands.urdf_reader import read_urdf
from nlpgrasp.verify.chain_kinematics import links_in_urdf, read_root_element
from tests.hands.urdf import FOUR, FOUR_TIPS, GRIPPER, PADS

PAD = {"left_pad": PADS["left_pad"]}
MIMIC = '<mimic joint="left_slide" multiplier="1" offset="0"/>'
SPHERE = '<collision><origin xyz="0 0 0"/><geometry><sphere radius="0.009"/></geometry></collision>'
MESH = '<collision><geometry><mesh filename="{}" scale="{}"/></geometry></collision>'


def write_hand(tmp_path, text, name="hand.urdf"):
    path = tmp_path / name
    path.write_text(text)
    return path


def with_mimic(tmp_path, mimic):
    text = GRIPPER.read_text()
    assert MIMIC in text
    return write_hand(tmp_path, text.replace(MIMIC, f'<mimic joint="left_slide" {mimic}/>'))


def with_mesh(tmp_path, name, scale="1 1 1"):
    return write_hand(tmp_path, FOUR.read_text().replace(SPHERE, MESH.format(name, scale), 1))


def test_limits_without_the_sign_are_taken_with_it(tmp_path):
    path = with_mimic(tmp_path, 'multiplier="-1"')
    with pytest.warns(UserWarning, match=r"taken with the other sign: limits 0 to 0.\d+ of joint right_slide, which"):
        hand = ng.URDFHand.load(path, PAD)
    plain = ng.URDFHand.load(GRIPPER, PAD)
    np.testing.assert_array_equal(hand.tree.joint_limits, plain.tree.joint_limits)
    positions = hand.tree.joint_positions(hand.tree.joint_limits[1])
    assert positions["right_slide"] == -positions["left_slide"] < 0.0


@pytest.mark.parametrize("mimic", ['multiplier="-1"', 'multiplier="1"', 'multiplier="-1" offset="0.01"'])
def test_who_checks_a_grasp_takes_the_same_limits(tmp_path, mimic):
    path = with_mimic(tmp_path, mimic)
    robot = read_urdf(path)
    limits = {j.name: (j.lower, j.upper) for j in robot.joints if j.moves}
    links = links_in_urdf(read_root_element(path), robot.root)
    assert {link.joint: (link.lower, link.upper) for link in links if link.moves} == limits


def test_limits_that_keep_their_sign(tmp_path):
    """With an offset there is a range as the file states it."""
    assert not read_urdf(with_mimic(tmp_path, 'multiplier="-1" offset="0.01"')).negated_limits


def test_follower_without_limits_follows_everywhere(tmp_path):
    text = GRIPPER.read_text()
    at = text.index("<limit", text.index('name="right_slide"'))
    path = write_hand(tmp_path, text[:at] + '<limit effort="1"/>' + text[text.index("/>", at) + 2 :])
    np.testing.assert_array_equal(
        ng.URDFHand.load(path, PAD).tree.joint_limits, ng.URDFHand.load(GRIPPER, PAD).tree.joint_limits
    )


@pytest.mark.parametrize("multiplier", ["1", "-1", "-0.5"])
@pytest.mark.parametrize("ends", ['lower="0" upper="0"', 'lower="0.0"', 'lower="-0" upper="0e0"'])
def test_a_follower_from_0_to_0_follows_everywhere(tmp_path, ends, multiplier):
    """As exporters write it where nothing is stated. Who checks a grasp takes the same limits."""
    text = with_mimic(tmp_path, f'multiplier="{multiplier}"').read_text()
    at = text.index("<limit", text.index('name="right_slide"'))
    path = write_hand(tmp_path, f'{text[:at]}<limit {ends} effort="1"/>{text[text.index("/>", at) + 2 :]}')
    with pytest.warns(
        UserWarning, match=r"limits 0 to 0 of joints that follow others are taken as none.*: right_slide$"
    ):
        hand = ng.URDFHand.load(path, PAD)
    np.testing.assert_array_equal(hand.tree.joint_limits, ng.URDFHand.load(GRIPPER, PAD).tree.joint_limits)
    links = links_in_urdf(read_root_element(path), hand.robot.root)
    assert [link.upper for link in links if link.joint == "right_slide"] == [np.inf]


def test_a_free_joint_from_0_to_0_is_said_to_stand_still(tmp_path):
    text = FOUR.read_text()
    at = text.index("<limit", text.index('type="revolute"'))
    path = write_hand(tmp_path, f'{text[:at]}<limit lower="0" upper="0"/>{text[text.index("/>", at) + 2 :]}')
    with pytest.warns(UserWarning, match="joints whose limits leave one position do not move: "):
        ng.URDFHand.load(path, FOUR_TIPS)


def test_follower_that_leaves_one_position(tmp_path):
    upper = float(read_urdf(GRIPPER).joints[0].upper)
    path = with_mimic(tmp_path, f'multiplier="1" offset="{upper}"')
    with pytest.raises(ng.InputError, match=r"joint left_slide with joint right_slide .*limits that both can keep"):
        ng.URDFHand.load(path, PAD)


def test_an_arm_above_the_palm_may_have_joints_of_any_type(tmp_path):
    arm = (
        '<link name="world"/><joint name="base" type="floating"><parent link="world"/><child link="palm"/></joint>'
        '<link name="wheel"/><joint name="axle" type="planar"><parent link="world"/><child link="wheel"/></joint>'
        "</robot>"
    )
    path = write_hand(tmp_path, FOUR.read_text().replace("</robot>", arm))
    assert ng.URDFHand.load(path, FOUR_TIPS, palm="palm").count == 4
    with pytest.raises(ng.InputError, match="joint base of type 'floating'"):
        ng.URDFHand.load(path, FOUR_TIPS)


def test_links_without_a_collision_shape_are_named_once(tmp_path):
    path = write_hand(tmp_path, FOUR.read_text().replace("collision>", "visual>"))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ng.URDFHand.load(path, FOUR_TIPS)
    links = ", ".join(name for name in read_urdf(FOUR).links if name in read_urdf(FOUR).shapes)
    message = f"hand.urdf: nothing keeps links without a collision shape off the body: {links}"
    assert [str(warning.message) for warning in caught] == [message]


def test_xacro(tmp_path):
    text = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="a"/></robot>'
    with pytest.raises(ng.InputError, match=r"a xacro file.*expected the URDF that it makes: .*hand.xacro > hand.urdf"):
        ng.URDFHand.load(write_hand(tmp_path, text, "hand.xacro"), PAD)
    source = FOUR.read_text().replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ', 1)
    assert ng.URDFHand.load(write_hand(tmp_path, source), FOUR_TIPS).count == 4  # what xacro makes keeps the name alone


def test_collada_without_its_reader(tmp_path, monkeypatch):
    (tmp_path / "knuckle.dae").write_text("<COLLADA/>")
    monkeypatch.setitem(sys.modules, "collada", None)
    with pytest.raises(ng.NlpgraspError, match=r"hand.urdf: reading knuckle.dae .link index_knuckle, pycollada. needs"):
        ng.URDFHand.load(with_mesh(tmp_path, "knuckle.dae"), FOUR_TIPS)


def test_collada_in_its_own_unit(tmp_path):
    pytest.importorskip("collada", reason='no pycollada: pip install "nlpgrasp[hands]"')
    text = trimesh.creation.box([20.0, 10.0, 10.0]).export(file_type="dae").decode()
    assert "<unit" not in text
    unit = '<unit name="millimeter" meter="0.001"/></asset>'
    (tmp_path / "knuckle.dae").write_text(text.replace("</asset>", unit, 1))
    shape = read_urdf(with_mesh(tmp_path, "knuckle.dae")).shapes["index_knuckle"][0]
    np.testing.assert_allclose(shape.mesh.extents, [0.02, 0.01, 0.01])


def test_mirrored_mesh_is_not_inside_out(tmp_path):
    trimesh.creation.box([20.0, 10.0, 10.0]).apply_translation([5.0, 0.0, 0.0]).export(tmp_path / "knuckle.stl")
    shape = read_urdf(with_mesh(tmp_path, "knuckle.stl", "-0.001 0.001 0.001")).shapes["index_knuckle"][0]
    assert shape.mesh.volume == pytest.approx(2e-6)
    np.testing.assert_allclose(shape.mesh.bounds[:, 0], [-0.015, 0.005])
    assert shape.depth(np.array([[-0.005, 0.0, 0.0]]))[0] == pytest.approx(0.005)


@pytest.mark.parametrize(("variable", "inside"), [("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")])
def test_meshes_of_packages_elsewhere(tmp_path, monkeypatch, variable, inside):
    package = tmp_path / "ros" / inside / "some_hand"
    package.mkdir(parents=True)
    (tmp_path / "here").mkdir()
    trimesh.creation.box([0.02, 0.01, 0.01]).export(package / "knuckle.stl")
    path = with_mesh(tmp_path / "here", "package://some_hand/knuckle.stl")
    assert read_urdf(path).missing
    monkeypatch.setenv(variable, str(tmp_path / "ros"))
    assert not read_urdf(path).missing


@pytest.mark.parametrize(
    ("element", "named"),
    [
        ('<loop_joint name="l" type="spherical"><link1 link="A"/><link2 link="B"/></loop_joint>', "<loop_joint>"),
        ('<gazebo><joint name="l" type="ball"><parent>A</parent><child>B</child></joint></gazebo>', "<joint>"),
        ('<mujoco><equality><connect body1="A" body2="B" anchor="0 0 0"/></equality></mujoco>', "<connect>"),
    ],
)
def test_linkages_that_extensions_close(tmp_path, element, named):
    loop = element.replace("A", "left_pad").replace("B", "right_pad")
    text = GRIPPER.read_text().replace("</robot>", f"{loop}</robot>")
    message = f"hand.urdf: closed linkages that mimic joints are taken to keep: {named} of links left_pad and right_pad"
    with pytest.warns(UserWarning, match=f"^{message}$"):
        ng.URDFHand.load(write_hand(tmp_path, text), PADS)
    path = write_hand(tmp_path, re.sub("<mimic[^>]*/>", "", text))
    with pytest.raises(ng.InputError, match=f"a closed linkage: {named} of links .*, expected a tree with <mimic>"):
        ng.URDFHand.load(path, PADS)
    elsewhere = write_hand(tmp_path, GRIPPER.read_text().replace("</robot>", f"{element}</robot>"), "b.urdf")
    assert read_urdf(elsewhere).mimicked_loops == ()  # of links that are not the hand's


def test_effort_of_zero_is_none(tmp_path):
    path = write_hand(tmp_path, FOUR.read_text().replace('effort="0.7"', 'effort="0"', 1))
    hand = ng.URDFHand.load(path, FOUR_TIPS)
    assert "index_abduction" not in hand.torque_limits
    with pytest.raises(ng.InputError, match=r"none for index_abduction, .* where the URDF states no effort or 0"):
        ng.GraspProblem(
            ng.Sphere(0.03),
            ng.FrictionContact(0.7),
            ng.TaskEllipsoid([1.0] * 6),
            hand=hand,
            force_budget="hand_torques",
        )
