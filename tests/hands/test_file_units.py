"""Units of robot files: questions about millimetres and degrees, and their cures."""

import re
import warnings

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from benchmarks.outside import HANDS, MISSING
from nlpgrasp.common.robot_files import UrdfUnits
from nlpgrasp.hands.file_units import joint_reach, unit_questions
from nlpgrasp.hands.inspection import inspect, inspect_without_tips
from nlpgrasp.hands.robot_file import read_robot
from nlpgrasp.verify.chain_kinematics import links_in
from nlpgrasp.verify.link_shapes import link_shapes
from nlpgrasp.verify.sources import SourceFolders
from tests.hands.urdf import FOUR, GRIPPER, THREE

SLIDE = (
    '<joint name="slide" type="prismatic"><parent link="palm"/><child link="extra"/><axis xyz="0 0 1"/>'
    '<limit lower="0" upper="0.05" effort="1"/><mimic joint="left" multiplier="0.01" offset="0.001"/></joint>'
    '<link name="extra"/>'
)


def finger(name, y, axis, mesh, limit=0.6):
    """Return the text of a link with a mesh and a joint of the palm, radians and metres."""
    return (
        f'<link name="{name}_link"><collision><geometry><mesh filename="finger.stl" {mesh}/></geometry></collision>'
        "</link>"
        f'<joint name="{name}" type="revolute"><parent link="palm"/><child link="{name}_link"/>'
        f'<origin xyz="0 {y} 0.02"/>'
        f'<axis xyz="{axis} 0 0"/><limit lower="{-limit}" upper="{limit}" effort="5"/></joint>'
    )


def write_hand(folder, *parts):
    file = folder / "hand.urdf"
    file.write_text(f'<robot name="two"><link name="palm"/>{"".join(parts)}</robot>')
    return file


def write_fingers(folder, mesh="", limit=0.6, other_mesh=None, size=(20.0, 20.0, 60.0)):
    """Write a hand of two fingers with meshes of a size in their file's unit, and return its path."""
    trimesh.creation.box(size).export(folder / "finger.stl")
    other = mesh if other_mesh is None else other_mesh
    return write_hand(folder, finger("left", -0.05, 1, mesh, limit), finger("right", 0.05, -1, other, limit))


def questions(path, **units):
    return unit_questions(read_robot(path, None, UrdfUnits(**units)))


def test_meshes_in_millimetres_are_asked_about(tmp_path):
    path = write_fingers(tmp_path)
    text = "meshes up to 60 m long (links left_link, right_link) at joints that reach 0.0539 m"
    assert questions(path) == [f"{text}: if they are millimetres, scale=0.001 says so"]
    assert questions(path, scale=1e-3) == []
    text = re.escape(f"{text}, expected metres: if they are millimetres, scale=0.001 says so")
    for fingertips in (["left_link", "right_link"], {"left_link": 0.01}):
        with pytest.raises(ng.InputError, match=rf"^URDFHand\.path: hand\.urdf: got {text}$"):
            ng.URDFHand.load(path, fingertips)


def test_a_scale_is_that_of_the_file(tmp_path):
    """The factor and the attribute of the meshes give the same shapes, in the package and in its check."""
    (tmp_path / "stated").mkdir()
    path, stated = write_fingers(tmp_path), write_fingers(tmp_path / "stated", 'scale="0.001 0.001 0.001"')
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hand = ng.URDFHand.load(path, ["left_link", "right_link"], scale=1e-3)
        expected = ng.URDFHand.load(stated, ["left_link", "right_link"])
    for link in ("left_link", "right_link"):
        (mesh,), (stated_mesh,) = ([shape.mesh for shape in h.robot.shapes[link]] for h in (hand, expected))
        np.testing.assert_array_equal(mesh.vertices, stated_mesh.vertices)
    assert hand.to_dict()["scale"] == 1e-3
    assert expected.to_dict().keys().isdisjoint({"scale", "degrees"})
    for file, units in ((path, UrdfUnits.from_dict(hand.to_dict())), (stated, UrdfUnits())):
        (shape,) = link_shapes(file, {"left_link"}, None, SourceFolders([file.parent]), units)["left_link"]
        np.testing.assert_allclose(np.ptp(shape.vertices, axis=0), [0.02, 0.02, 0.06], rtol=1e-12)


def test_a_factor_comes_beside_the_scale_of_the_file(tmp_path):
    path = write_fingers(tmp_path, 'scale="-2 1 1"')
    (shape,) = read_robot(path, None, UrdfUnits(scale=1e-3)).shapes["left_link"]
    np.testing.assert_allclose(shape.mesh.extents, [0.04, 0.02, 0.06], rtol=1e-12)


def test_meshes_of_two_units_are_mended_in_the_file(tmp_path):
    (question,) = questions(write_fingers(tmp_path, "", other_mesh='scale="0.001 0.001 0.001"'))
    assert "(link left_link)" in question
    assert question.endswith('if they are millimetres, scale="0.001 0.001 0.001" in their <mesh> says so')


@pytest.mark.filterwarnings("ignore:link .* is thicker than its fingertip")
def test_centimetres_are_told_from_millimetres(tmp_path):
    """A hand of this size there may be: it is a warning."""
    path = write_fingers(tmp_path, size=(2.0, 2.0, 6.0))
    cure = r"if they are centimetres, scale=0\.01 says so"
    with pytest.warns(UserWarning, match=rf"^hand\.urdf: meshes up to 6 m long .*: {cure}$"):
        ng.URDFHand.load(path, {"left_link": 0.01, "right_link": 0.01})


def test_meshes_that_are_scaled_twice_are_asked_about(tmp_path):
    path = write_fingers(tmp_path, 'scale="0.001 0.001 0.001"', size=(0.02, 0.02, 0.06))
    (question,) = questions(path)
    assert question.startswith("meshes at most 0.06 mm long at joints that reach 0.0539 m")
    assert questions(path, scale=1e3) == []


@pytest.mark.filterwarnings("ignore:hand.urdf. meshes at most:UserWarning")
def test_fingertips_are_not_fitted_to_meshes_that_are_scaled_twice(tmp_path):
    path = write_fingers(tmp_path, 'scale="0.001 0.001 0.001"', size=(0.02, 0.02, 0.06))
    message = (
        "URDFHand.fingertips['left_link']: got a link whose collision shapes measure 2e-05 x 2e-05 x 6e-05 m, expected "
        "shapes large enough to fit a fingertip to, or a radius or a tip, such as ng.SphereTip(0.01); if their scale "
        "in the file is too small, scale=1000 makes up for it"
    )
    with pytest.raises(ng.InputError, match=f"^{re.escape(message)}$"):
        ng.URDFHand.load(path, ["left_link", "right_link"])
    ng.URDFHand.load(path, ["left_link", "right_link"], scale=1000)


def test_fingertips_are_not_fitted_to_flat_meshes(tmp_path):
    path = write_fingers(tmp_path, size=(0.02, 0.0, 0.06))
    with pytest.raises(
        ng.InputError, match=r"measure 0\.02 x 0 x 0\.06 m, expected .*, such as ng\.SphereTip\(0\.01\)$"
    ):
        ng.URDFHand.load(path, ["left_link", "right_link"])


def test_offsets_in_millimetres_are_asked_about(tmp_path):
    text = re.sub(r'origin xyz="([^"]*)"', lambda m: f'origin xyz="{scaled(m[1], 1e3)}"', THREE.read_text())
    path = tmp_path / "hand.urdf"
    path.write_text(text)
    (question,) = questions(path)
    assert question == "joints up to 167 m from palm: if these are millimetres, divide all lengths of hand.urdf by 1000"
    with pytest.raises(ng.InputError, match=r"got joints up to 167 m from palm, expected metres: if these are"):
        ng.URDFHand.load(path, ["finger_1_tip"])


def scaled(text, factor):
    return " ".join(repr(factor * float(value)) for value in text.split())


def in_degrees(text):
    """Return a URDF's text with the limits of its revolute joints in degrees."""

    def convert(joint):
        return re.sub(r'(lower|upper)="([^"]*)"', lambda m: f'{m[1]}="{scaled(m[2], 180.0 / np.pi)}"', joint[0])

    return re.sub(r'<joint [^>]*type="revolute">.*?</joint>', convert, text, flags=re.DOTALL)


@pytest.mark.parametrize("source", [FOUR, THREE])
def test_limits_in_degrees(tmp_path, source):
    path = tmp_path / "hand.urdf"
    path.write_text(in_degrees(source.read_text()))
    (question,) = questions(path)
    assert re.fullmatch(
        r"limits up to .* rad, .* turns \(joints .* more\): if they are degrees, degrees=True says so", question
    )
    assert questions(path, degrees=True) == []
    robot, expected = read_robot(path, None, UrdfUnits(degrees=True)), read_robot(source)
    for joint, other in zip(robot.joints, expected.joints, strict=True):
        assert (joint.lower, joint.upper) == pytest.approx((other.lower, other.upper), abs=1e-12)
    links, expected_links = links_in(path, robot.root, UrdfUnits(degrees=True)), links_in(source, expected.root)
    for link, other in zip(links, expected_links, strict=True):
        assert (link.lower, link.upper) == pytest.approx((other.lower, other.upper), abs=1e-12)


def test_few_limits_beyond_a_turn_are_of_geared_joints(tmp_path):
    """As the three tendons of Tiago's hand, among 36 joints of less than a turn."""
    path = tmp_path / "hand.urdf"
    path.write_text(re.sub(r'upper="[^"]*"', 'upper="9.25"', THREE.read_text(), count=2))
    assert sum(joint.upper == 9.25 for joint in read_robot(path).joints) == 2
    assert questions(path) == []


@pytest.mark.parametrize("place", ["joint", "collision"])
def test_origins_turned_by_degrees_are_asked_about(tmp_path, place):
    trimesh.creation.box([0.02, 0.02, 0.06]).export(tmp_path / "finger.stl")
    turned = finger("left", -0.05, 1, "")
    if place == "joint":
        turned = turned.replace('xyz="0 -0.05 0.02"', 'xyz="0 -0.05 0.02" rpy="0 0 90"')
    else:
        turned = turned.replace("<geometry>", '<origin rpy="90 0 0"/><geometry>')
    path = write_hand(tmp_path, turned, finger("right", 0.05, -1, ""))
    with pytest.raises(ng.InputError, match=r"left.*, rpy \[.*90.0.*radians: if these are degrees, 90 degrees"):
        ng.URDFHand.load(path, ["left_link", "right_link"])


def test_origins_turned_by_few_whole_degrees_are_asked_about(tmp_path):
    trimesh.creation.box([0.02, 0.02, 0.06]).export(tmp_path / "finger.stl")
    turned = finger("left", -0.05, 1, "").replace('xyz="0 -0.05 0.02"', 'xyz="0 -0.05 0.02" rpy="0 0 10"')
    path = write_hand(tmp_path, turned, finger("right", 0.05, -1, ""))
    with pytest.warns(UserWarning, match=r"left, rpy \[0.0, 0.0, 10.0\] is taken as radians: 10 degrees are 0.1745"):
        read_robot(path)


def test_followers_in_degrees(tmp_path):
    """A slide that follows a hinge: metres per degree, and an offset in metres."""
    trimesh.creation.box([0.02, 0.02, 0.06]).export(tmp_path / "finger.stl")
    mimic = '<mimic joint="left" multiplier="-1" offset="10"/></joint>'
    right = finger("right", 0.05, -1, "", 35.0).replace("</joint>", mimic)
    path = write_hand(tmp_path, finger("left", -0.05, 1, "", 35.0), right, SLIDE)
    for joint in read_robot(path, None, UrdfUnits(degrees=True)).joints:
        if joint.name == "right":
            assert (joint.mimic.multiplier, joint.mimic.offset) == pytest.approx((-1.0, np.radians(10.0)))
            assert joint.upper == pytest.approx(np.radians(35.0))
        if joint.name == "slide":
            assert (joint.mimic.multiplier, joint.mimic.offset) == pytest.approx((0.01 * 180.0 / np.pi, 0.001))
            assert joint.upper == 0.05


@pytest.mark.slow
def test_an_inspection_asks_and_suggests_with_the_units(tmp_path):
    path = write_fingers(tmp_path, limit=35.0)
    lines = inspect(inspect_without_tips(path, None, [0.0, 0.0, 1.0])).lines
    assert any(line.startswith("  ! Meshes up to 60 m long") for line in lines)
    assert any(line.startswith("  ! Limits up to 35 rad, 5.6 turns (joints left, right)") for line in lines)
    cured = inspect(inspect_without_tips(path, None, [0.0, 0.0, 1.0], UrdfUnits(1e-3, True))).lines
    assert not any("says so" in line for line in cured)
    assert any(line.strip().endswith("scale=0.001, degrees=True)") for line in cured)
    assert any("--scale 0.001 --degrees" in line for line in cured)


@pytest.mark.parametrize("path", [FOUR, THREE, GRIPPER])
def test_nothing_is_asked_about_good_files(path):
    assert questions(path) == []


def test_nothing_is_asked_about_hands_of_others():
    files = sorted(HANDS.glob("*/*.urdf"))
    if not files:
        pytest.skip(MISSING)
    for file in files:
        robot = read_robot(file)
        assert 0.1 < joint_reach(robot) < 1.0
        assert unit_questions(robot) == []


def test_other_scales_are_refused(tmp_path):
    path = write_fingers(tmp_path)
    with pytest.raises(ng.InputError, match=r"^URDFHand\.scale: got 0, expected a number greater than 0$"):
        ng.URDFHand.load(path, ["left_link"], scale=0)
    with pytest.raises(ng.InputError, match=r"^URDFHand\.degrees: got 1, expected True or False$"):
        ng.URDFHand.load(path, ["left_link"], degrees=1)


@pytest.mark.parametrize(
    ("units", "cure"), [({"scale": 0.1}, "<mesh scale="), ({"degrees": True}, '<compiler angle="degree"/>')]
)
def test_an_mjcf_states_its_own_units(tmp_path, units, cure):
    path = tmp_path / "hand.xml"
    path.write_text("<mujoco/>")
    (field,) = units
    with pytest.raises(ng.InputError, match=rf"^URDFHand\.{field}: .* for an MJCF, which states it: {cure}"):
        ng.URDFHand.load(path, ["a"], **units)


def test_an_sdf_file_is_refused_with_its_converter(tmp_path):
    path = tmp_path / "hand.sdf"
    path.write_text('<sdf version="1.9"><model name="hand"><link name="palm"/></model></sdf>')
    message = "URDFHand.path: hand.sdf: got an SDF file, expected a URDF or MJCF: sdf2mjcf hand.sdf hand.xml, of the"
    with pytest.raises(ng.InputError, match=f"^{message} package sdformat-mjcf, makes an MJCF$"):
        ng.URDFHand.load(path, ["palm"])


def test_links_that_lost_their_only_shape_are_named(tmp_path):
    sphere = '<collision><geometry><sphere radius="0.01"/></geometry></collision>'
    left, right = finger("left", -0.05, 1, ""), finger("right", 0.05, -1, "")
    path = write_hand(tmp_path, left, right.replace("<collision>", f"{sphere}<collision>"))
    text = (
        r"left out finger\.stl \(link left_link\); finger\.stl \(link right_link\); link left_link has no other shape"
    )
    with pytest.warns(UserWarning, match=rf"^hand\.urdf: {text}: collisions with it are not checked$"):
        ng.URDFHand.load(path, {"left_link": 0.01, "right_link": 0.01})


@pytest.mark.parametrize(("thickness", "gap"), [(0.006, 4.0), (0.012, 1.0), (0.024, 5.0)])
def test_collision_shapes_that_are_not_what_is_visible_are_said(thickness, gap, tmp_path):
    """Fingers of 14 mm, with boxes for collisions that are thinner or thicker by twice the gap, millimetres."""
    text = '<link name="palm"><collision><geometry><box size="0.1 0.04 0.02"/></geometry></collision></link>'
    for i in range(2):
        box = '<origin xyz="0 0 0.03"/><geometry><box size="{0} {0} 0.06"/></geometry>'
        text += (
            f'<link name="f{i}"><visual>{box.format(0.014)}</visual><collision>{box.format(thickness)}</collision>'
            f'</link><joint name="j{i}" type="revolute"><parent link="palm"/><child link="f{i}"/><axis xyz="0 1 0"/>'
            f'<origin xyz="{0.08 * i - 0.04} 0 0.01"/><limit lower="-0.6" upper="0.6" effort="3"/></joint>'
        )
    path = tmp_path / "visible.urdf"
    path.write_text(f'<robot name="visible">{text}</robot>')
    said = r"grasps are found for the collision shapes, which are not the visible hand at f0 \(up to (.*) mm\), f1 "
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        hand = ng.URDFHand.load(path, ["f0", "f1"])
    texts = [finding.text for finding in inspect(hand).findings]
    found = [re.search(said, text, re.IGNORECASE) for text in [*(str(w.message) for w in caught), *texts]]
    gaps = [float(match[1]) for match in found if match]
    assert len(gaps) == (2 if gap > 3.0 else 0)
    assert all(gap <= stated <= gap * np.sqrt(2.0) for stated in gaps)  # most at the edges
