"""Proposed fingertips: which leaf links, and the bodies that they close on, of grippers with known openings."""

import re

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.hands.closing_trial import WIDTHS, ClosingWidths, closing_widths
from nlpgrasp.hands.inspection import inspect, inspect_without_tips
from nlpgrasp.hands.opposition import opposed_tips
from tests.hands.described import two_fingers
from tests.hands.robotiq import robotiq_2f85
from tests.hands.robots import in_radians, robot

BOX = '<collision><origin xyz="{xyz}"/><geometry><box size="{size}"/></geometry></collision>'
SLIDE = (
    '<link name="{name}">{shape}</link><joint name="{name}_slide" type="prismatic"><parent link="palm"/>'
    '<child link="{name}"/><origin xyz="0 {y} 0.01"/><axis xyz="0 {side} 0"/>'
    '<limit lower="{lower}" upper="{upper}" effort="50" velocity="1"/></joint>'
)


def write_jaws(folder, lower, upper, extra=""):
    """Write a gripper of two box jaws whose inner faces are ``0.1 - q1 - q2`` metres apart."""
    palm = f'<link name="palm">{BOX.format(xyz="0 0 -0.01", size="0.04 0.16 0.02")}</link>'
    text = palm
    for name, y, side in (("left", -0.05, 1), ("right", 0.05, -1)):
        shape = BOX.format(xyz=f"0 {-0.005 * side} 0.04", size="0.02 0.01 0.08")
        text += SLIDE.format(name=name, shape=shape, y=y, side=side, lower=lower, upper=upper)
    path = folder / "jaws.urdf"
    path.write_text(f'<robot name="jaws">{text}{extra}</robot>')
    return path


def proposal(path, palm=None):
    return inspect_without_tips(path, palm, [0.0, 0.0, 1.0]).proposal


@pytest.mark.parametrize(
    ("lower", "upper", "expected"),
    [
        (-0.002, 0.036, WIDTHS[2:]),
        (0.046, 0.0465, ()),
        pytest.param(-0.002, 0.05, WIDTHS, marks=pytest.mark.slow),
        pytest.param(0.018, 0.05, WIDTHS[:5], marks=pytest.mark.slow),
    ],
)
def test_jaws_close_on_the_widths_between_their_limits(tmp_path, lower, upper, expected):
    hand = ng.URDFHand.load(write_jaws(tmp_path, lower, upper), ["left", "right"])
    closing = closing_widths(hand.tree)
    openings = [width for width in WIDTHS if 0.1 - 2.0 * upper <= width <= 0.1 - 2.0 * lower]
    assert closing.box == closing.cylinder == expected == tuple(openings)


@pytest.mark.slow
def test_with_the_palm_between_the_jaws_they_close_on_nothing(tmp_path):
    path = write_jaws(tmp_path, -0.002, 0.05)
    text = path.read_text()
    thin = '<origin xyz="0 0 -0.01"/><geometry><box size="0.04 0.16 0.02"/>'
    assert thin in text
    path.write_text(text.replace(thin, '<origin xyz="0 0 0.05"/><geometry><box size="0.04 0.2 0.14"/>'))
    hand = ng.URDFHand.load(path, ["left", "right"])
    assert closing_widths(hand.tree) == ClosingWidths((), ())


@pytest.mark.slow
def test_panda_closes_up_to_its_opening():
    hand = ng.hands.panda(robot("panda_description/urdf/panda.urdf"))
    closing = closing_widths(hand.tree)
    assert closing == ClosingWidths(WIDTHS[:-1], WIDTHS[:-1])  # it opens by 80 mm
    assert str(closing) == "cylinders and boxes of 10 to 80 mm"


def test_widths_as_text():
    none = ClosingWidths((), ())
    assert len(none) == 0
    assert str(none) == "none of the cylinders and boxes of 10 to 100 mm that were tried"
    assert str(ClosingWidths(WIDTHS[:3], ())) == "cylinders of 10 to 30 mm"
    parts = ClosingWidths(WIDTHS[1:2], (*WIDTHS[:2], WIDTHS[4]))
    assert str(parts) == "cylinders of 20 mm and boxes of 10 to 20 and 60 mm"


@pytest.mark.slow
def test_links_that_are_only_seen_and_those_that_face_no_other_are_left_out(tmp_path):
    """A camera on a joint of its own, without a shape, and a pusher of box shape that slides along the palm's back."""
    extra = SLIDE.format(name="camera", shape="", y=0.0, side=1, lower=0.0, upper=0.01)
    shape = BOX.format(xyz="0 0 0.03", size="0.02 0.02 0.06")
    extra += SLIDE.format(name="pusher", shape=shape, y=0.0, side=1, lower=0.0, upper=0.05).replace(
        '<origin xyz="0 0.0 0.01"/><axis xyz="0 1 0"/>', '<origin xyz="0 0 -0.1"/><axis xyz="0 0 -1"/>'
    )
    path = write_jaws(tmp_path, -0.002, 0.05, extra)
    result = proposal(path)
    assert [tip.link for tip in result.tips] == ["left", "right"]
    assert result.left_out == {"camera": "no collision shape", "pusher": "faces no other"}
    (text, *_) = [notice.text for notice in inspect(inspect_without_tips(path, None, [0.0, 0.0, 1.0])).notices]
    assert text == (
        "No fingertips are stated. Links at the ends: left, right. They close on cylinders and boxes of 10 to 100 mm "
        "(links checked at points, friction 0.7). Left out: camera (no collision shape), pusher (faces no other). To "
        "use them:"
    )


@pytest.mark.slow
def test_knuckles_of_linkages_are_left_out(tmp_path):
    """They move with the finger whose pad is in front of them, and face the same way."""
    result = proposal(robotiq_2f85(tmp_path / "2f85.urdf", meshes=True))
    assert [tip.link for tip in result.tips] == ["left_inner_finger_pad", "right_inner_finger_pad"]
    why = "moves along behind a fingertip"
    assert result.left_out == {"left_inner_knuckle": why, "right_inner_knuckle": why}
    assert result.closing.box == WIDTHS[:-1]  # it opens by 85 mm
    result = proposal(in_radians("robotiq_gripper_140.xml", tmp_path))
    assert [tip.link for tip in result.tips] == ["left_inner_finger", "right_inner_finger"]


def notice(path, palm=None):
    """Return the first notice of a file without fingertips, and the lines to copy."""
    inspection = inspect(inspect_without_tips(path, palm, [0.0, 0.0, 1.0]))
    return inspection.notices[0].text, inspection.usage_lines


def write_on_mast(folder):
    """Write the gripper on a mast of 1 m that turns on a base with two wheels."""
    path = write_jaws(folder, -0.002, 0.05)
    joint = (
        '<joint name="to_{0}" type="revolute"><parent link="base"/><child link="{0}"/><origin xyz="{1}"/>'
        '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="5" velocity="1"/></joint>'
    )
    wheel = '<link name="{}"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>'
    extra = '<link name="base"/>' + joint.format("palm", "0 0 1")
    for name, y in (("left_wheel", 0.2), ("right_wheel", -0.2)):
        extra += wheel.format(name) + joint.format(name, f"0 {y} 0")
    path.write_text(path.read_text().replace("</robot>", f"{extra}</robot>"))
    return path


def test_of_a_robot_with_more_than_a_hand_nothing_is_proposed_but_its_palm(tmp_path):
    path = write_on_mast(tmp_path)
    assert notice(path) == (
        "No fingertips are stated. The file holds more than a hand (4 links at the ends, up to 1.1 m from base): "
        "--palm LINK names the hand's palm (likely palm), or --fingertip LINK each of its fingertips.",
        (),
    )
    assert notice(path, "palm")[0].startswith("No fingertips are stated. Links at the ends: left, right. They close on")


@pytest.mark.slow
def test_the_palms_of_public_robots_are_named():
    file = "tiago_description/robots/tiago{}.urdf"
    text, lines = notice(robot(file.format("")))
    assert "--palm LINK names the hand's palm (likely hand_palm_link), or" in text
    assert lines == ()
    assert "(likely hand_left_palm_link, hand_right_palm_link)" in notice(robot(file.format("_dual")))[0]
    result = proposal(robot(file.format("")), "hand_palm_link")
    assert [tip.link.split("_")[1] for tip in result.tips] == ["thumb", "index", "middle", "ring", "little"]
    motors = ("hand_thumb_link", "hand_index_link", "hand_mrl_link")
    assert result.left_out == dict.fromkeys(motors, "shapes of only 2 mm")
    assert len(result.closing) > 0


def test_links_with_tiny_shapes_and_those_fixed_to_the_palm_are_left_out(tmp_path):
    """A motor's sphere of 1 mm radius, and a box fixed to a palm that turns on a wrist."""
    motor = SLIDE.format(name="motor", shape="", y=0.0, side=1, lower=0.0, upper=0.01)
    sphere = '<collision><geometry><sphere radius="0.001"/></geometry></collision>'
    extra = motor.replace('"motor"></link>', f'"motor">{sphere}</link>')
    extra += f'<link name="guard">{BOX.format(xyz="0 0 -0.02", size="0.1 0.2 0.02")}</link>'
    extra += '<joint name="on" type="fixed"><parent link="palm"/><child link="guard"/></joint><link name="wrist"/>'
    extra += (
        '<joint name="turn" type="revolute"><parent link="wrist"/><child link="palm"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" effort="5" velocity="1"/></joint>'
    )
    result = proposal(write_jaws(tmp_path, 0.046, 0.0465, extra))
    assert [tip.link for tip in result.tips] == ["left", "right"]
    assert result.left_out == {"motor": "shapes of only 2 mm", "guard": "does not move against the palm"}


def test_a_single_link_at_an_end_is_no_proposal(tmp_path):
    path = write_jaws(tmp_path, -0.002, 0.05)
    path.write_text(path.read_text().replace('name="right_slide" type="prismatic"', 'name="right_slide" type="fixed"'))
    assert notice(path) == (
        "No fingertips are stated. Only one link is at an end: left. To hold a body takes two fingertips at least: "
        "--fingertip LINK states each, also on a fixed jaw.",
        (),
    )


@pytest.mark.slow
def test_more_links_than_are_tried_are_said_to_be_untried(tmp_path):
    shape = BOX.format(xyz="0 0 0.04", size="0.01 0.01 0.08")
    extra = "".join(
        SLIDE.format(name=f"pin_{i}", shape=shape, y=0.02 * i, side=1, lower=0.0, upper=0.01) for i in range(7)
    )
    text, lines = notice(write_jaws(tmp_path, 0.0, 0.02, extra))
    assert "They were not tried on bodies: that is done for 8 fingertips at most." in text
    assert len(lines) == 2


@pytest.mark.filterwarnings("ignore:link panda_hand is thicker")
@pytest.mark.filterwarnings("ignore:link panda_hand is thicker")
def test_fingertips_that_face_one_another_are_opposed():
    hand = ng.URDFHand.load(
        robot("panda_description/urdf/panda.urdf"),
        {
            "panda_leftfinger": ng.FlatTip([0.017, 0.018], [0.0, 0.0, 0.045], (np.pi / 2.0, 0.0, 0.0)),
            "panda_rightfinger": ng.FlatTip([0.017, 0.018], [0.0, 0.0, 0.045], (-np.pi / 2.0, 0.0, 0.0)),
            "panda_hand": ng.FlatTip([0.02, 0.02], [0.0, 0.0, -0.01], (np.pi, 0.0, 0.0)),
        },
        palm="panda_hand",
        tip_overhang=1.0,
    )
    assert opposed_tips(hand.tree, np.array([0.02])) == (0, 1)


def test_two_box_fingers_are_proposed_with_what_they_close_on(tmp_path):
    result = proposal(two_fingers(tmp_path))
    assert [tip.link for tip in result.tips] == ["f1", "f2"]  # and not the frames t1 and t2, which have no shape
    assert result.closing.box == tuple(width for width in WIDTHS if 0.02 <= width <= 0.12)


def write_two_on_arm(folder, joints):
    """Write the gripper with box jaws on a chain of short links that turn, without other ends."""
    path = write_jaws(folder, -0.002, 0.05)
    chain = '<link name="arm_0"/>'
    for i in range(joints):
        child = "palm" if i == joints - 1 else f"arm_{i + 1}"
        chain += (
            "" if child == "palm" else f'<link name="{child}">{BOX.format(xyz="0 0 0.05", size="0.05 0.05 0.1")}</link>'
        )
        chain += (
            f'<joint name="a{i}" type="revolute"><parent link="arm_{i}"/><child link="{child}"/><origin xyz="0 0 0.2"/>'
            f'<axis xyz="0 {i % 2} {1 - i % 2}"/><limit lower="-2" upper="2" effort="50" velocity="1"/></joint>'
        )
    path.write_text(path.read_text().replace("</robot>", f"{chain}</robot>"))
    return path


@pytest.mark.parametrize("joints", [3, 6, 7])
def test_the_palm_below_an_arm_is_asked_for(joints, tmp_path):
    path = write_two_on_arm(tmp_path, joints)
    names = ", ".join(f"a{i}" for i in range(joints))
    message = (
        f"URDFHand.palm: got arm_0, with an arm of {joints} joints ({names}) above the fingers, expected the link that "
        "the fingers hang from, probably palm='palm'"
    )
    for tips in (["left", "right"], ["left"]):
        with pytest.raises(ng.InputError, match=re.escape(message)):
            ng.URDFHand.load(path, tips)
    text, lines = notice(path)
    assert (
        text == f"No fingertips are stated. An arm of {joints} joints is above the fingers: --palm palm leaves it out."
    )
    assert lines == ()
    assert ng.URDFHand.load(path, ["left", "right"], palm="palm").count == 2


def test_a_wrist_is_no_arm(tmp_path):
    assert ng.URDFHand.load(write_two_on_arm(tmp_path, 2), ["left", "right"]).count == 2


@pytest.mark.slow
def test_tips_that_close_on_nothing_are_no_proposal(tmp_path):
    text, lines = notice(write_jaws(tmp_path, 0.046, 0.0465))
    assert text == (
        "No fingertips are stated. Links at the ends: left, right. They close on none of the cylinders and boxes of "
        "10 to 100 mm that were tried: --fingertip LINK states others."
    )
    assert lines == ()


@pytest.mark.slow
def test_couplers_of_a_linkage_and_links_that_are_only_visible_are_no_fingertips(tmp_path):
    """A rod from the palm overlaps each jaw, whose tip has a visible frame fixed to it."""
    extra = ""
    for name, y, side in (("left", -0.05, 1), ("right", 0.05, -1)):
        rod = BOX.format(xyz=f"0 {-0.005 * side} 0.01", size="0.004 0.004 0.05")
        extra += f'<link name="{name}_rod">{rod}</link><joint name="{name}_turn" type="revolute"><parent link="palm"/>'
        extra += f'<child link="{name}_rod"/><origin xyz="0 {y} 0.01"/><axis xyz="1 0 0"/>'
        extra += '<limit lower="-1" upper="1" effort="5" velocity="1"/></joint>'
        extra += f'<link name="{name}_visuals"><visual><geometry><sphere radius="0.005"/></geometry></visual></link>'
        extra += f'<joint name="{name}_fixed" type="fixed"><parent link="{name}"/><child link="{name}_visuals"/>'
        extra += '<origin xyz="0 0 0.08"/></joint>'
    result = proposal(write_jaws(tmp_path, -0.002, 0.05, extra))
    assert [tip.link for tip in result.tips] == ["left", "right"]
    assert result.left_out == dict.fromkeys(["left_rod", "right_rod"], "moves along behind a fingertip")
    assert result.closing.box == WIDTHS
