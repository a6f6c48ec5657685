"""Warnings of squeezes that are too weak for the task."""

from types import SimpleNamespace

import numpy as np
import pytest

from nlpgrasp.solution.squeeze_record import friction_warning, weak_squeeze_warning

NEEDED = SimpleNamespace(normal=np.array([4.0, 12.2, 7.0]))


def squeeze(worst=None, normal_force=2.0):
    joints = SimpleNamespace(worst=worst)
    return SimpleNamespace(normal_force=normal_force, joints=joints)


@pytest.mark.parametrize(
    ("worst", "pressed", "words"),
    [
        (
            None,
            None,
            "up to 12.2 N at a finger, but this squeeze presses with 2 N at least: --normal-force 18 presses",
        ),
        (("index_joint", 0.1), 5.0, "presses with 5 N at least: --normal-force 18 presses for all of it"),
        (
            ("index_joint", 0.25),
            None,
            "with 2 N at least: --normal-force 7.6 is what joint index_joint is strong enough",
        ),
        (("index_joint", 1.0), None, "with 2 N at least, the most that joint index_joint is strong enough for"),
    ],
)
def test_what_would_do(worst, pressed, words):
    assert words in weak_squeeze_warning(squeeze(worst), NEEDED, pressed)


def test_nothing_is_said_of_one_that_is_strong_enough():
    assert weak_squeeze_warning(squeeze(), NEEDED, 12.3) == ""
    assert weak_squeeze_warning(squeeze(normal_force=20.0), NEEDED) == ""
    assert weak_squeeze_warning(None, NEEDED) == ""
    assert weak_squeeze_warning(squeeze(), None) == ""


def test_a_squeeze_that_spends_the_friction_says_so():
    assert friction_warning(SimpleNamespace(share=0.96)).startswith(
        "the squeeze alone needs 96 % of the friction there is: "
    )
    assert friction_warning(SimpleNamespace(share=0.9)) == friction_warning(None) == ""
