"""Leaf links, their suggested fingertips, and the command and code that state them."""

import re
import shlex
from pathlib import Path

import pytest

import nlpgrasp as ng
from nlpgrasp.hands.inspection import inspect, inspect_without_tips
from nlpgrasp.hands.robot_file import read_robot
from nlpgrasp.hands.suggested_tips import SuggestedTip, leaf_links, suggest_tip
from tests.hands.urdf import FOUR, FOUR_TIPS

THREE_FINGERS = Path(__file__).resolve().parents[2] / "problems" / "hands" / "three_finger_hand.urdf"
SPHERE = '<collision><origin xyz="{}"/><geometry><sphere radius="0.008"/></geometry></collision>'
BOX = '<collision><origin xyz="0 0 0.01"/><geometry><box size="0.02 0.012 0.03"/></geometry></collision>'
CAPSULE = '<collision><geometry><capsule radius="0.005" length="0.02"/></geometry></collision>'
SHAPES = {"ball": SPHERE.format("0 0 0"), "off": SPHERE.format("0 0 0.02"), "block": BOX, "rod": CAPSULE, "bare": ""}


def write_hand(folder):
    """Write a hand with one finger of each shape, a camera fixed to the palm and a sensor fixed to a fingertip."""
    joint = '<joint name="{0}_{1}" type="{2}"><parent link="{1}"/><child link="{0}"/>{3}</joint>'
    limits = '<axis xyz="0 1 0"/><limit lower="0" upper="1" effort="1" velocity="1"/>'
    text = "".join(
        f'<link name="{n}">{s}</link>{joint.format(n, "palm", "revolute", limits)}' for n, s in SHAPES.items()
    )
    for name, parent in (("camera", "palm"), ("sensor", "last"), ("last", "bare")):
        text += f'<link name="{name}"/>{joint.format(name, parent, "fixed", "")}'
    text += f'<link name="pad">{SHAPES["ball"]}</link>{joint.format("pad", "bare", "fixed", "")}'
    path = folder / "mixed hand.urdf"
    path.write_text(f'<robot name="mixed"><link name="palm"/>{text}</robot>')
    return path


def test_one_link_each_of_those_that_move(tmp_path):
    robot = read_robot(write_hand(tmp_path))
    assert leaf_links(robot) == ("ball", "off", "block", "rod", "pad")  # no camera; of sensor and pad that with a shape


def test_all_ends_of_a_robot_that_never_moves(tmp_path):
    path = tmp_path / "fist.urdf"
    path.write_text('<robot name="fist"><link name="palm"/></robot>')
    assert leaf_links(read_robot(path)) == ("palm",)


def test_fingertips_are_those_of_the_shapes(tmp_path):
    robot = read_robot(write_hand(tmp_path))
    assert [suggest_tip(robot, link) for link in SHAPES] == [
        SuggestedTip("ball", "ball=0.008", "0.008"),
        SuggestedTip("off", "off", "None"),  # its own sphere, where it is
        SuggestedTip("block", "block", "None"),  # fitted to its box
        SuggestedTip("rod", "rod", "None"),
        SuggestedTip("bare", "bare", "None"),  # fitted to the pad's, which is fixed to it
    ]


def test_a_radius_is_a_guess_where_no_link_of_the_rigid_group_has_a_shape(tmp_path):
    path = write_hand(tmp_path)
    path.write_text(path.read_text().replace(f'<link name="pad">{SHAPES["ball"]}</link>', '<link name="pad"/>'))
    assert suggest_tip(read_robot(path), "bare") == SuggestedTip("bare", "bare=0.01", "0.01", guessed=True)


@pytest.mark.slow
def test_tips_of_links_without_shapes_that_close_on_nothing_are_not_proposed(tmp_path):
    path = write_hand(tmp_path)
    path.write_text(re.sub("<collision>.*?</collision>", "", path.read_text()))
    inspection = inspect(inspect_without_tips(path, None, [0.0, 0.0, 1.0]))
    notice = inspection.notices[0].text
    assert "Links at the ends: ball, off, block, rod, pad. They close on none of the " in notice
    assert notice.endswith("--fingertip LINK states others.")
    assert not inspection.usage_lines


@pytest.mark.slow
def test_the_lines_to_paste_state_the_same_hand(tmp_path):
    path = tmp_path / "three fingers.urdf"
    path.write_text(THREE_FINGERS.read_text())
    command, line = inspect(inspect_without_tips(path, "palm", [0.0, 0.0, 1.0])).usage_lines
    hand = eval(line, {"ng": ng})  # noqa: S307
    names = [f"finger_{i}_tip" for i in (1, 2, 3)]
    assert [link for link, _ in hand.tips] == names
    assert hand.tree.approach.tolist() == [0.0, 0.0, 1.0]
    assert {(tip.kind, tip.standoff) for _, tip in hand.tips} == {("sphere", 0.01)}
    words = shlex.split(command)
    assert words[:5] == ["nlpgrasp", "hand", str(path), "--palm", "palm"]
    assert words[-6::2] == ["--fingertip"] * 3
    assert words[-5::2] == [f"{name}=0.01" for name in names]


def test_without_fingertips_the_error_names_those_at_the_ends():
    expected = ", ".join(f'"{link}": {radius}' for link, radius in FOUR_TIPS.items())
    message = f"URDFHand.fingertips: got nothing, expected links with their radii, such as {{{expected}}}"
    with pytest.raises(ng.InputError, match=f"^{re.escape(message)}$"):
        ng.URDFHand.load(FOUR)
