"""Proposed fingertips: which leaf links, and the bodies that they close on, of grippers with known openings."""

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
    closing = closing_widths(hand.tree, hand.unshrunk_spheres)
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
    assert closing_widths(hand.tree, {}) == ClosingWidths(WIDTHS, WIDTHS)
    assert closing_widths(hand.tree, hand.unshrunk_spheres) == ClosingWidths((), ())


@pytest.mark.slow
def test_panda_closes_up_to_its_opening():
    hand = ng.hands.panda(robot("panda_description/urdf/panda.urdf"))
    closing = closing_widths(hand.tree, hand.unshrunk_spheres)
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
        "(links as spheres, friction 0.7). Left out: camera (no collision shape), pusher (faces no other). To use them:"
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
    assert [tip.link for tip in result.tips] == ["t1", "t2"]
    assert result.closing.box == tuple(width for width in WIDTHS if 0.02 <= width <= 0.12)
