"""Fingertip opposition: sliding fingers with distances in closed form."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.hands.finger_chains import fingers
from nlpgrasp.hands.inspection import findings, inspect_without_tips, inspection_data
from nlpgrasp.hands.opposition import TOUCH, TipDistances, opposition
from tests.hands.urdf import FOUR, gripper, three_finger_hand

SLIDE = """<link name="{name}">{shape}</link>
<joint name="{name}_slide" type="prismatic"><parent link="palm"/><child link="{name}"/><origin xyz="{x} {y} 0"/>
<axis xyz="1 0 0"/><limit lower="{lower}" upper="{upper}" {effort}/>{mimic}</joint>"""


SHAPE = '<collision><geometry><sphere radius="0.004"/></geometry></collision>'


def write_slides(folder, *entries):
    """Return the URDF of a palm with links that slide along x."""
    links = [
        SLIDE.format(**{"y": 0, "shape": "", "lower": 0, "effort": 'effort="5" velocity="1"', "mimic": "", **entry})
        for entry in entries
    ]
    path = folder / "slides.urdf"
    palm = '<link name="palm"><collision><geometry><box size="0.02 0.02 0.02"/></geometry></collision></link>'
    path.write_text(f'<robot name="slides">{palm}{"".join(links)}</robot>')
    return path


def find_opposition(hand):
    shown = inspection_data(hand)
    return shown, opposition(shown.tree, shown.rest_posture)


def test_two_slides_that_do_not_reach_each_other(tmp_path):
    path = write_slides(
        tmp_path, {"name": "a", "x": -0.05, "upper": 0.03}, {"name": "b", "x": 0.05, "lower": -0.01, "upper": 0}
    )
    shown, result = find_opposition(ng.URDFHand.load(path, {"a": 0.005, "b": 0.005}))
    (pair,) = result.pairs
    assert pair.opposed == pytest.approx(0.1 - 0.03 - 0.01 - 2 * 0.005, abs=1e-6)
    assert pair.nearest == pair.opposed
    assert pair.joints == pytest.approx([0.03, -0.01], abs=1e-6)
    assert result.unopposed == (0, 1)
    (text,) = [f.text for f in findings(shown, result)]
    message = "Fingertips 0 (a) and 1 (b) cannot meet: they stay 50 mm apart and can hold nothing thinner between them."
    assert text == message


def test_pads_that_look_the_same_way_never_face(tmp_path):
    path = write_slides(
        tmp_path, {"name": "a", "x": -0.05, "upper": 0.1}, {"name": "b", "x": 0.05, "y": 0.02, "upper": 0.01}
    )
    pad = ng.FlatTip([0.01, 0.01])
    shown, result = find_opposition(ng.URDFHand.load(path, {"a": pad, "b": pad}))
    (pair,) = result.pairs
    assert not pair.faces
    assert pair.nearest == pytest.approx(0.01, abs=1e-4)  # the pads' edges, side by side
    grave = [f.text for f in findings(shown, result) if f.grave]
    assert grave == ["No two fingertips ever face each other: they cannot press from two sides."]


def test_each_two_meet_and_never_all_three(tmp_path):
    """At q: the tips are at 0.1 q, 0.2 - 0.1 q and 0, metres, which one joint drives."""
    follow = '<mimic joint="b_slide" multiplier="{}" offset="{}"/>'
    path = write_slides(
        tmp_path,
        {"name": "a", "x": 0.0, "lower": -1, "upper": 1, "mimic": follow.format(0.0, 0.0)},
        {"name": "b", "x": 0.0, "upper": 0.2},
        {"name": "c", "x": 0.2, "lower": -0.2, "upper": 0, "mimic": follow.format(-1.0, 0.0)},
    )
    shown, result = find_opposition(ng.URDFHand.load(path, dict.fromkeys("abc", 0.01)))
    assert [pair.touches for pair in result.pairs] == [True, True, True]
    (three,) = result.separated
    assert three.fingers == (0, 1, 2)
    assert three.nearest == pytest.approx(0.1 - 2 * 0.01, abs=1e-4)
    assert three.joints == pytest.approx([0.1], abs=1e-4)
    messages = [f.text for f in findings(shown, result)]
    assert any("0 (a), 1 (b) and 2 (c) come together in smaller sets but not all at once" in text for text in messages)


def test_pads_of_a_gripper_close_face_to_face():
    shown, result = find_opposition(gripper())
    assert result.pairs[0].touches
    assert result.pairs[0].joints == pytest.approx([0.0], abs=1e-4)
    assert findings(shown, result) == ()


def test_distances_are_those_of_centres_less_radii():
    tree = three_finger_hand().tree
    lower, upper = tree.joint_limits
    joints = np.random.default_rng(1).uniform(lower, upper, (20, len(lower)))
    tips = tree.palm_tips(joints)
    expected = np.linalg.norm(tips[:, 0] - tips[:, 2], axis=1) - 0.02
    assert TipDistances(tree).distances((0, 2), joints, facing=False) == pytest.approx(expected, abs=1e-12)


def test_what_the_search_finds_is_no_more_than_among_many_random_postures():
    shown, result = find_opposition(three_finger_hand())
    lower, upper = shown.tree.joint_limits
    tips = shown.tree.palm_tips(np.random.default_rng(2).uniform(lower, upper, (20_000, len(lower))))
    for pair in result.pairs:
        i, j = pair.fingers
        least = np.min(np.linalg.norm(tips[:, i] - tips[:, j], axis=1)) - 0.02
        assert pair.nearest <= max(least, 0.0) + TOUCH


def test_joints_by_finger():
    chains = fingers(inspect_without_tips(FOUR, None, [1, 0, 0]).tree)
    assert [len(finger.joints) for finger in chains] == [4, 4, 4, 4]
    assert sorted(i for finger in chains for i in finger.joints) == list(range(16))
    gripper_chains = fingers(gripper().tree)
    assert [(finger.tips, finger.joints) for finger in gripper_chains] == [((0, 1), (0,))]


def test_what_a_file_leaves_open_is_said(tmp_path):
    text = write_slides(tmp_path, {"name": "a", "x": 0.0, "upper": 0.1, "effort": "", "shape": SHAPE}).read_text()
    joint = '<joint name="spin" type="continuous"><parent link="palm"/><child link="wheel"/><axis xyz="0 0 1"/></joint>'
    wheel = '<link name="wheel"><visual><geometry><sphere radius="0.01"/></geometry></visual></link>'
    path = tmp_path / "open.urdf"
    path.write_text(text.replace("</robot>", f"{wheel}{joint}</robot>"))
    messages = {f.text: f.grave for f in findings(inspect_without_tips(path, None, [0, 0, 1]), None)}
    bare = "Link wheel is visible but has no collision shape: it may pass through the body."
    weak = 'No joint has an effort limit: the force budget "hand_torques" needs torque_limits.'
    wide = "Joint spin can turn a full circle or more: cables may not allow that."
    assert messages == {bare: True, weak: False, wide: False}
