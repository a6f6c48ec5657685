"""Errors on invalid URDF files."""

import re

import pytest
import trimesh

import nlpgrasp as ng
from tests.hands.urdf import FOUR, FOUR_TIPS, GRIPPER

TIP = {"index_tip": 0.011}


def load(tmp_path, text, tips=TIP, **options):
    path = tmp_path / "hand.urdf"
    path.write_text(text)
    return ng.URDFHand.load(path, tips, **options)


def check_refusal(tmp_path, old, new, match, tips=TIP):
    text = FOUR.read_text()
    assert old in text
    with pytest.raises(ng.InputError, match=match):
        load(tmp_path, text.replace(old, new, 1), tips)


def test_missing_file():
    with pytest.raises(ng.InputError, match=r"nowhere\.urdf, expected a URDF file that can be read"):
        ng.URDFHand.load("nowhere.urdf", TIP)


def test_folder_in_place_of_a_file(tmp_path):
    with pytest.raises(ng.InputError, match="got not a regular file, expected a URDF or MJCF file"):
        ng.URDFHand.load(tmp_path, TIP)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("", "broken XML"),
        ("<robot><link name='a'></robot>", "broken XML"),
        ("<svg/>", "<svg> at the top, expected <robot>"),
        ("<robot name='r'/>", "no <link>"),
        ("<robot name='r'><link/></robot>", "a <link> without name"),
        ("<robot name='r'><link name='index_tip'/></robot>", "no movable joints"),
        ("<robot name='r'><link name='a'/><link name='a'/></robot>", "two links named a"),
        ("<robot name='r'><link name='a'/><link name='index_tip'/></robot>", "roots a, index_tip"),
    ],
)
def test_broken_files(tmp_path, text, match):
    with pytest.raises(ng.InputError, match=re.escape(match)):
        load(tmp_path, text)


def test_unknown_links_list_those_there_are():
    with pytest.raises(ng.InputError, match=r"thumb_tips, expected links: palm, index_knuckle, .*thumb_tip"):
        ng.URDFHand.load(FOUR, {"thumb_tips": 0.01})


@pytest.mark.parametrize("tips", [{}, {"index_tip": []}, ["palm", None], []])
def test_no_fingertips(tips):
    with pytest.raises(ng.InputError, match=r"URDFHand\.fingertips"):
        ng.URDFHand.load(FOUR, tips)


@pytest.mark.parametrize("radius", [0.0, -0.01, "thick", float("nan")])
def test_fingertip_radius(radius):
    with pytest.raises(ng.InputError, match=re.escape("URDFHand.fingertips['index_tip']")):
        ng.URDFHand.load(FOUR, {"index_tip": radius})


def test_limits_upside_down(tmp_path):
    match = "joint index_abduction with limits 0.5 to -0.45, expected a lower limit below the upper one"
    check_refusal(tmp_path, 'lower="-0.45"', 'lower="0.5" upper="-0.45" note="', "broken XML")
    check_refusal(tmp_path, 'lower="-0.45" upper="0.45"', 'lower="0.5" upper="-0.45"', match)


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ('lower="-0.45"', 'lower="low"', "joint index_abduction, lower 'low', expected 1 finite number"),
        ('xyz="-0.018 0.044 0.006"', 'xyz="1 2"', "joint index_abduction, xyz '1 2', expected 3 finite numbers"),
        ('<axis xyz="1 0 0"/>', '<axis xyz="0 0 0"/>', "joint index_abduction with axis zero"),
        ('type="revolute"', 'type="floating"', "joint index_abduction of type 'floating'"),
        ('<parent link="palm"/>', '<parent link="plam"/>', "joint index_abduction with parent 'plam', expected a link"),
        ('<child link="index_proximal"/>', '<child link="index_middle"/>', "link index_middle with two parents"),
        ('<sphere radius="0.009"/>', '<sphere radius="-1"/>', "collision of link index_knuckle, sizes"),
        ('<sphere radius="0.009"/>', "<cone/>", "collision of link index_knuckle with <cone>"),
        ('<sphere radius="0.009"/>', "<sphere/>", "collision of link index_knuckle, radius 'missing'"),
        ('effort="0.7"', 'effort="much"', "joint index_abduction, effort 'much'"),
    ],
)
def test_broken_parts(tmp_path, old, new, match):
    check_refusal(tmp_path, old, new, re.escape(match))


def test_joint_without_limits(tmp_path):
    limit = '    <limit lower="-0.45" upper="0.45" effort="0.7" velocity="6"/>\n'
    check_refusal(tmp_path, limit, "", "joint index_abduction without <limit>")


def test_mimic_of_a_joint_there_is_not(tmp_path):
    text = GRIPPER.read_text().replace('<mimic joint="left_slide"', '<mimic joint="slide"')
    with pytest.raises(
        ng.InputError, match="joint right_slide that mimics 'slide', expected a moving joint: left_slide"
    ):
        load(tmp_path, text, {"left_pad": 0.01})


def test_joints_that_mimic_each_other(tmp_path):
    text = GRIPPER.read_text()
    first = text.index("</joint>")
    text = text[:first] + '<mimic joint="right_slide"/>' + text[first:]
    with pytest.raises(ng.InputError, match="joints that mimic each other"):
        load(tmp_path, text, {"left_pad": 0.01})


def test_unknown_palm():
    with pytest.raises(ng.InputError, match=r"URDFHand.palm: got hand, expected a link of the URDF: palm"):
        ng.URDFHand.load(FOUR, TIP, palm="hand")


def test_fingertip_outside_the_palms_part_of_the_robot():
    with pytest.raises(ng.InputError, match="thumb_tip, expected links: index_knuckle"):
        ng.URDFHand.load(FOUR, {"thumb_tip": 0.01}, palm="index_knuckle")


SPHERE = '<collision><origin xyz="0 0 0"/><geometry><sphere radius="0.009"/></geometry></collision>'
MESH = '<collision><geometry><mesh filename="{}" scale="0.001 0.001 0.001"/></geometry></collision>'


def test_missing_mesh_is_named_and_the_rest_goes_on(tmp_path):
    text = FOUR.read_text().replace(SPHERE, MESH.format("package://some_hand/meshes/knuckle.stl"), 1)
    with pytest.warns(UserWarning, match=r"left out package://some_hand/meshes/knuckle.stl \(link index_knuckle\)"):
        hand = load(tmp_path, text)
    assert not hand.robot.shapes.get("index_knuckle")
    assert hand.robot.shapes["middle_knuckle"]
    assert hand.to_dict()["missing"] == ["package://some_hand/meshes/knuckle.stl (link index_knuckle)"]


def test_no_shapes_but_missing_meshes(tmp_path):
    text = "<robot name='r'><link name='a'>{}</link><link name='index_tip'/><joint name='j' type='continuous'>".format(
        MESH.format("a.stl")
    )
    with pytest.raises(
        ng.InputError, match=r"got no link with a collision shape: a.stl \(link a\) cannot be read, expected mesh files"
    ):
        load(tmp_path, text + "<parent link='a'/><child link='index_tip'/></joint></robot>")


@pytest.mark.slow
def test_mesh_beside_the_file_and_below_a_package(tmp_path):
    mesh = trimesh.creation.icosphere(radius=9.0)  # millimetres
    (tmp_path / "some_hand" / "meshes").mkdir(parents=True)
    (tmp_path / "some_hand" / "urdf").mkdir()
    mesh.export(tmp_path / "some_hand" / "meshes" / "knuckle.stl")
    for name in ("package://some_hand/meshes/knuckle.stl", "../meshes/knuckle.stl"):
        text = FOUR.read_text().replace(SPHERE, MESH.format(name), 1)
        hand = load(tmp_path / "some_hand" / "urdf", text)
        assert not hand.robot.missing
        (shape,) = hand.robot.shapes["index_knuckle"]
        assert shape.mesh.extents == pytest.approx([0.018] * 3, abs=1e-5)


def test_torque_limits_by_name_by_number_and_from_the_file():
    assert ng.URDFHand.load(FOUR, FOUR_TIPS).torque_limits["thumb_abduction"] == 0.7
    assert set(ng.URDFHand.load(FOUR, FOUR_TIPS, 0.5).torque_limits.values()) == {0.5}
    assert ng.URDFHand.load(FOUR, FOUR_TIPS, {"thumb_abduction": 1.0}).torque_limits == {"thumb_abduction": 1.0}
    with pytest.raises(ng.InputError, match="thumb, expected joints: index_abduction"):
        ng.URDFHand.load(FOUR, FOUR_TIPS, {"thumb": 1.0})


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"approach": [0, 0, 0]}, "URDFHand.approach"),
        ({"clearance": -1.0}, "URDFHand.clearance"),
    ],
)
def test_bad_options(options, match):
    with pytest.raises(ng.InputError, match=match):
        ng.URDFHand.load(FOUR, TIP, **options)


@pytest.mark.parametrize("path", [None, 3, "a\0b"])
def test_paths_that_are_none(path):
    with pytest.raises(ng.InputError, match=r"URDFHand\.path"):
        ng.URDFHand.load(path, TIP)


@pytest.mark.parametrize("mimic", ['multiplier="1" offset="5"', 'multiplier="0" offset="5"'])
def test_limits_that_a_joint_and_its_follower_cannot_both_keep(tmp_path, mimic):
    text = GRIPPER.read_text().replace('multiplier="1" offset="0"', mimic)
    with pytest.raises(ng.InputError, match="joint left_slide with joint right_slide that follows it"):
        load(tmp_path, text, {"left_pad": 0.01})


def test_same_tip_twice_and_no_tip():
    with pytest.raises(ng.InputError, match="tips that are not the same"):
        ng.URDFHand.load(FOUR, {"index_tip": [ng.SphereTip(0.01), ng.SphereTip(0.01)]})
    with pytest.raises(ng.InputError, match="a radius, a tip, or several tips"):
        ng.URDFHand.load(FOUR, {"index_tip": [], "thumb_tip": 0.01})


def test_scale_zero(tmp_path):
    text = FOUR.read_text().replace(SPHERE, MESH.format("a.stl").replace("0.001 0.001 0.001", "0 1 1"), 1)
    trimesh.creation.icosphere().export(tmp_path / "a.stl")
    with pytest.raises(ng.InputError, match=r"scale .* expected a scale that is not zero"):
        load(tmp_path, text)


def test_planar_body():
    body = ng.Polygon([[0, 0], [1, 0], [0, 1]])
    with pytest.raises(ng.InputError, match="a URDF hand for a planar body"):
        ng.GraspProblem(
            body, ng.FrictionContact(0.5), ng.TaskEllipsoid([1.0] * 3), hand=ng.URDFHand.load(FOUR, FOUR_TIPS)
        )
