"""Suggested palm directions from the mean direction of the fingers."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.hands.finger_chains import first_finger_links, format_direction, mean_finger_direction, suggested_approach
from nlpgrasp.hands.inspection import findings, inspection_data
from tests.hands.robots import SHADOW, model, robot
from tests.hands.urdf import FOUR, FOUR_TIPS, GRIPPER, PADS, THREE, THREE_TIPS, four_finger_hand, gripper
from tests.hands.urdf import three_finger_hand as three
from tests.quick import every

ALLEGRO = "allegro_hand_description/urdf/allegro_{}_hand.urdf"
PANDA = "panda_description/urdf/panda.urdf"
QUIET = ("ignore:.*nothing keeps links", "ignore:.*joints move on their own")
AXES = [list(sign * axis) for axis in np.eye(3) for sign in (1.0, -1.0)]


def degrees(tree, direction):
    return np.degrees(np.arccos(np.clip(mean_finger_direction(tree) @ np.array(direction), -1.0, 1.0)))


@pytest.mark.parametrize("hand", [four_finger_hand, three, gripper], ids=["four", "three", "gripper"])
def test_hands_that_face_where_they_are_said_to_are_not_asked_about(hand):
    assert suggested_approach(hand().tree) is None
    assert degrees(hand().tree, hand().tree.approach) < 35.0


def test_a_grippers_fingers_lie_where_it_faces():
    assert mean_finger_direction(gripper().tree) == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)


@pytest.mark.parametrize("wrong", every(3, AXES))
@pytest.mark.parametrize(
    ("path", "tips", "right"),
    [(FOUR, FOUR_TIPS, [1, 0, 0]), (THREE, THREE_TIPS, [0, 0, 1]), (GRIPPER, PADS, [0, 0, 1])],
    ids=["four", "three", "gripper"],
)
def test_every_other_axis_is_asked_about(path, tips, right, wrong):
    suggestion = suggested_approach(ng.URDFHand.load(path, tips, approach=wrong).tree)
    assert (suggestion is None) if wrong == right else (suggestion.tolist() == right)


@pytest.mark.filterwarnings("ignore:link .* is thicker")
def test_tips_on_inner_links_and_on_the_palm_change_nothing():
    """As in problems/power_grasp.py; a palm's own tip counts from the palm's origin."""
    radii = {"proximal": 0.009, "middle": 0.009, "tip": 0.011}
    tips = {f"{finger}_{link}": r for finger in ("index", "ring", "thumb") for link, r in radii.items()}
    palm = ng.SphereTip(0.01, [-0.02, 0.0, -0.045])
    hand = ng.URDFHand.load(FOUR, {"palm": palm, **tips}, approach=[1.0, 0.0, 0.0])
    assert first_finger_links(hand.tree)[0] == "palm"
    assert set(first_finger_links(hand.tree)[1:]) == {"index_knuckle", "ring_knuckle", "thumb_knuckle"}
    assert suggested_approach(hand.tree) is None


@pytest.mark.filterwarnings("ignore:.*not the visible hand:UserWarning")
@pytest.mark.parametrize("side", ["right", "left"])
def test_an_allegro_is_asked_about_where_nothing_is_said(side):
    right = ng.hands.allegro(robot(ALLEGRO.format(side)))
    assert suggested_approach(right.tree) is None
    unsaid = ng.URDFHand.load(robot(ALLEGRO.format(side)), dict(right.tips))
    assert suggested_approach(unsaid.tree).tolist() == [1.0, 0.0, 0.0]


@pytest.mark.filterwarnings("ignore:.*not the visible hand:UserWarning")
@pytest.mark.filterwarnings(*QUIET)
@pytest.mark.parametrize("palm", ["robot0:palm", "robot0:hand mount"], ids=["hand", "with its wrist"])
def test_a_wrist_below_the_palm_is_no_finger(palm):
    assert suggested_approach(ng.hands.shadow(model(SHADOW), palm=palm).tree) is None


def test_a_panda_is_not_asked_about():
    assert suggested_approach(ng.hands.panda(robot(PANDA)).tree) is None


def test_the_question_is_one_for_python_and_one_for_the_command_line():
    shown = inspection_data(ng.URDFHand.load(FOUR, FOUR_TIPS))
    (warning,) = findings(shown, None)
    message = "The palm is said to face +z, but its fingertips lie towards +x:"
    assert (warning.text, warning.command) == (f"{message} approach=[1, 0, 0]?", f"{message} --approach 1,0,0?")
    assert not warning.grave


def test_directions_in_words():
    assert format_direction(np.array([0.0, -1.0, 0.0])) == "-y"
    assert format_direction(np.array([0.6, 0.0, -0.8])) == "[0.6, 0, -0.8]"
