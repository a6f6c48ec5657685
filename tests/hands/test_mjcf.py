"""MJCF reader: MuJoCo's kinematics of the same file, couplings, efforts, shapes and errors."""

import sys

import mujoco
import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.hands.robot import euler_angles
from nlpgrasp.hands.robot_file import read_robot
from nlpgrasp.verify.chain_kinematics import links_in, poses
from nlpgrasp.verify.check import NotCheckedError
from tests.hands.mjcf import frames, tree_of

HAND = """<mujoco model="pincer"><compiler angle="radian" autolimits="true"/>
  <worldbody><body name="palm" pos="0.3 -0.2 0.5" quat="0.9 0.1 -0.3 0.2"><freejoint name="loose"/>
    <geom type="box" size="0.02 0.03 0.01" pos="0 0 -0.01"/>
    <body name="left" pos="0 0.02 0.01" euler="0.3 1.5707963 -0.4">
      <joint name="spread" axis="1 0 2" pos="0.004 -0.002 0.001" range="-0.5 0.6" ref="0.1"/>
      <joint name="bend" axis="0 1 0.3" pos="0.01 0.002 -0.003" range="-0.2 1.2"/>
      <geom type="capsule" size="0.006" fromto="0 0 0 0 0 0.04"/>
      <body name="left_tip" pos="0 0 0.04"><joint name="reach" type="slide" axis="0 1 1" range="-0.01 0.02"
        ref="0.003"/><geom type="ellipsoid" size="0.006 0.008 0.01"/>
        <geom type="sphere" size="0.02" contype="0" conaffinity="0"/></body>
    </body>
    <body name="right" pos="0 -0.02 0.01"><joint name="turn" axis="1 0 0"/>
      <geom type="cylinder" size="0.006 0.02" contype="0" conaffinity="0" group="3"/>
      <body pos="0 0 0.05" euler="0 -1.5707963 0.2"><joint name="last" axis="0 1 0" range="-1 1"/>
        <geom type="sphere" size="0.007"/></body>
    </body>
  </body></worldbody>{more}
</mujoco>"""


def write_hand(folder, more="", change=("", "")):
    path = folder / "pincer.xml"
    path.write_text(HAND.replace("{more}", more).replace(*change))
    return path


def test_bodies_are_where_mujoco_has_them(tmp_path, rng):
    path = write_hand(tmp_path)
    tree = tree_of(read_robot(path))
    assert [j.name for j in tree.robot.free_joints] == ["spread", "bend", "reach", "turn", "last"]
    lower, upper = tree.joint_limits
    np.testing.assert_allclose(lower, [-0.5, -0.2, -0.01, -np.pi, -1.0])
    np.testing.assert_allclose(upper, [0.6, 1.2, 0.02, np.pi, 1.0])
    for q in rng.uniform(lower, upper, (20, 5)):
        positions = tree.joint_positions(q)
        expected = frames(path, positions, "palm")
        stacked = np.hstack(tree.palm_poses(q[None])[0])
        numeric_poses = poses(links_in(path, "palm"), "palm", np.eye(4), positions)
        for i, link in enumerate(tree.used_links):
            np.testing.assert_allclose(stacked[:, 4 * i : 4 * i + 4], expected[link], atol=1e-12)
            np.testing.assert_allclose(numeric_poses[link], expected[link], atol=1e-12)


def test_angles_to_all_digits_where_they_are_not_unique(rng):
    from scipy.spatial.transform import Rotation

    for tilt in (0.0, 1e-9, 1e-7, 1e-4):
        for roll, yaw in rng.uniform(-3.0, 3.0, (20, 2)):
            turned = Rotation.from_euler("xyz", [roll, np.pi / 2.0 - tilt, yaw]).as_matrix()
            np.testing.assert_allclose(Rotation.from_euler("xyz", euler_angles(turned)).as_matrix(), turned, atol=1e-15)


def test_shapes_that_collide_are_taken(tmp_path):
    robot = read_robot(write_hand(tmp_path))
    kinds = {link: [shape.kind for shape in shapes] for link, shapes in robot.shapes.items()}
    assert kinds == {
        "palm": ["box"],
        "left": ["capsule"],
        "left_tip": ["ellipsoid"],
        "right": ["cylinder"],
        "body_5": ["sphere"],
    }
    np.testing.assert_allclose(robot.shapes["left"][0].mesh.extents, [0.012, 0.012, 0.052], rtol=0.02)
    solid = robot.shapes["left_tip"][0].mesh
    gauge = np.linalg.norm(solid.triangles_center / [0.006, 0.008, 0.01], axis=1)
    assert 1.0 - 1e-12 <= gauge.min() <= gauge.max() < 1.02  # around the ellipsoid
    assert robot.shapeless == ()


def test_joints_that_follow_in_a_line(tmp_path):
    equality = '<equality><joint joint1="last" joint2="spread" polycoef="0.05 -0.5 0 0 0"/></equality>'
    path = write_hand(tmp_path, equality)
    tree = tree_of(read_robot(path))
    assert [j.name for j in tree.robot.free_joints] == ["spread", "bend", "reach", "turn"]
    positions = tree.joint_positions(np.array([0.3, 0.0, 0.0, 0.0]))
    assert positions["last"] == pytest.approx(0.05 - 0.5 * (0.3 - 0.1))
    assert residual(path, positions) < 1e-12
    assert residual(path, positions | {"last": 0.1}) > 0.1
    follow = next(link.follow for link in links_in(path, "palm") if link.joint == "last")
    assert (follow.joint, follow.multiplier, follow.offset) == pytest.approx(("spread", -0.5, 0.1))


def residual(path, positions):
    """How far MuJoCo says that its equalities are from being kept."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for name, value in positions.items():
        data.qpos[model.joint(name).qposadr[0]] = value
    mujoco.mj_forward(model, data)
    return float(np.max(np.abs(data.efc_pos[: data.ne])))


TENDON = (
    '<tendon><fixed name="cord"><joint joint="bend" coef="0.5"/><joint joint="spread" coef="-0.25"/></fixed></tendon>'
)


def test_a_tendon_of_fixed_length_makes_the_later_joint_follow(tmp_path):
    path = write_hand(tmp_path, TENDON + '<equality><tendon tendon1="cord" polycoef="0.01 1 0 0 0"/></equality>')
    robot = read_robot(path)
    assert robot.unmodelled_couplings == ()
    positions = tree_of(robot).joint_positions(np.array([0.4, 0.0, 0.0, 0.0]))
    assert residual(path, positions) < 1e-12
    follow = next(link.follow for link in links_in(path, "palm") if link.joint == "bend")
    assert (follow.joint, follow.multiplier) == ("spread", pytest.approx(0.5))
    assert positions["bend"] == pytest.approx(0.5 * 0.4 + follow.offset)


@pytest.mark.filterwarnings("ignore:.*not the visible hand:UserWarning", "ignore:link .* is thicker")
def test_what_couples_joints_and_is_not_modelled_is_said(tmp_path):
    pulled = TENDON + '<actuator><motor tendon="cord" ctrlrange="-1 1" ctrllimited="true"/></actuator>'
    path = write_hand(tmp_path, pulled)
    message = (
        "joints move on their own where the file couples them: tendon cord of joints (bend and spread|spread and bend)"
    )
    with pytest.warns(UserWarning, match=message):
        hand = ng.URDFHand.load(path, {"left_tip": 0.006, "right": 0.006})
    assert hand.torque_limits == {}
    stiff = TENDON.replace('"cord"', '"cord" range="-1 1"')
    assert read_robot(write_hand(tmp_path, stiff)).unmodelled_couplings == ()  # the joints' ranges keep it
    short = TENDON.replace('"cord"', '"cord" range="-0.1 0.1"')
    assert len(read_robot(write_hand(tmp_path, short)).unmodelled_couplings) == 1


def test_efforts_are_what_the_actuators_hold_both_ways(tmp_path):
    elements = """<equality><joint joint1="last" joint2="turn" polycoef="0 2 0 0 0"/></equality><actuator>
      <position joint="spread" kp="5" forcerange="-2 3"/><motor joint="bend" gear="4" ctrlrange="-0.5 0.5"/>
      <motor joint="last" gear="-3" forcerange="-1 1"/><motor joint="turn" forcerange="-1 1"/>
      <position joint="reach" kp="5"/></actuator>"""
    robot = read_robot(write_hand(tmp_path, elements))
    assert {j.name: j.effort for j in robot.free_joints} == {"spread": 2.0, "bend": 2.0, "reach": None, "turn": 7.0}


@pytest.mark.parametrize(
    ("more", "change", "match"),
    [
        ("", ('name="last" axis="0 1 0" range="-1 1"', 'name="last" type="ball"'), "joint last of body .*three hinges"),
        ("", ('<joint name="turn" axis="1 0 0"/>', '<joint name="turn" type="slide"/>'), "turn, a slide without range"),
        (
            '<equality><joint joint1="last" joint2="turn"/><joint joint1="turn" joint2="last"/></equality>',
            ("", ""),
            "joints that mimic each other",
        ),
        ("", ("<worldbody>", '<worldbody><body name="cup"/>'), "bodies cup, palm side by side, expected palm="),
        ("", ('type="box"', 'type="mesh" mesh="none"'), "expected an MJCF file that MuJoCo reads"),
        ("", ("mujoco", "mujocoinclude"), "a part that other files include"),
    ],
)
def test_files_that_cannot_be_used(tmp_path, more, change, match):
    path = tmp_path / "pincer.xml"
    path.write_text(HAND.replace("{more}", more).replace(*change))
    with pytest.raises(ng.InputError, match=match) as caught:
        read_robot(path)
    assert "\n" not in str(caught.value)


def test_palm_that_is_no_body(tmp_path):
    with pytest.raises(
        ng.InputError, match="palm 'thumb', expected a body of the file: palm, left, left_tip, right, body_5, world"
    ):
        read_robot(write_hand(tmp_path), "thumb")


@pytest.mark.filterwarnings("ignore:.*not the visible hand:UserWarning", "ignore:link .* is thicker")
def test_limits_that_may_be_radians_are_named(tmp_path):
    path = write_hand(tmp_path, change=(' angle="radian"', ""))
    message = r'pincer.xml: no joint turns by more than 1.2 degrees: the file may lack <compiler angle="radian"/>'
    with pytest.warns(UserWarning, match=message):
        ng.URDFHand.load(path, {"left_tip": 0.006})
    ng.URDFHand.load(write_hand(tmp_path), {"left_tip": 0.006})


def test_without_mujoco_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ng.errors.MissingExtraError, match=r'reading MJCF needs the extra "sim"'):
        read_robot(write_hand(tmp_path))


XACRO = """<robot name="one" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="far" value="0.1"/>
<link name="palm"/><link name="tip"/><joint name="bend" type="revolute"><parent link="palm"/><child link="tip"/>
<origin xyz="0 0 ${far}"/><limit lower="0" upper="1"/></joint></robot>"""


def test_xacro_is_never_expanded_as_it_runs_python(tmp_path):
    path = tmp_path / "one.urdf.xacro"
    path.write_text(XACRO)
    message = (
        "got a xacro file, which runs Python, expected the URDF .*: .*xacro one.urdf.xacro > one.urdf, if you trust it"
    )
    with pytest.raises(ng.InputError, match=message):
        ng.URDFHand.load(path, {"tip": 0.01})
    with pytest.raises(NotCheckedError, match="a xacro file, which runs Python"):
        links_in(path, "palm")


HUGE = [
    '<hfield name="h" nrow="100000000" ncol="100000000" size="1 1 1 1"/>',
    '<texture name="t" type="2d" builtin="flat" width="1000000" height="1000000"/>',
]


@pytest.mark.parametrize("asset", HUGE)
def test_a_file_that_crashes_mujoco_is_refused(tmp_path, asset):
    path = write_hand(tmp_path, f"<asset>{asset}</asset>")
    with pytest.raises(ng.InputError, match=r"pincer.xml: got .*, expected an MJCF file that MuJoCo reads"):
        ng.URDFHand.load(path, {"left_tip": 0.006})
    with pytest.raises(NotCheckedError, match=r"MuJoCo cannot read pincer\.xml"):
        links_in(path, "palm")
    assert not list(tmp_path.glob("MUJOCO_LOG*"))


def test_a_large_robot_file_is_refused_before_it_is_parsed(tmp_path):
    for name, text in (("a.urdf", "<robot>"), ("a.xml", "<mujoco>")):
        (tmp_path / name).write_text(text + " " * (33 * 2**20))
        with pytest.raises(ng.InputError, match=f"{name}: got more than 32 MiB"):
            ng.URDFHand.load(tmp_path / name, {"tip": 0.006})
