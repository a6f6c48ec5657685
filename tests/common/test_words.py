"""Labels, units and texts of wrenches."""

import numpy as np
import pytest

from nlpgrasp.common.formatting import (
    COMPONENTS,
    DIRECTIONS,
    axis_labels,
    format_headroom,
    format_ranges,
    format_wrench,
    format_wrench_direction,
    unit_of,
)


@pytest.mark.parametrize("dimension", [3, 6])
def test_every_component_has_a_label_and_a_direction(dimension):
    assert len(COMPONENTS[dimension]) == len(DIRECTIONS[dimension]) == dimension
    forces = [unit_of(name) == "N" for name in COMPONENTS[dimension]]
    assert forces == ["force" in words for words in DIRECTIONS[dimension]]


def test_axis_labels():
    assert axis_labels(3) == ["f_x [N]", "f_y [N]", "m_z [N m]"]
    assert axis_labels(6)[2:4] == ["f_z [N]", "m_x [N m]"]


def test_small_components_are_left_out():
    assert format_wrench(np.array([10.0, 0.1, -3.0])) == "f_x 10 N, m_z -3 N m"
    assert format_wrench(np.array([0.0, 0.0, -2.5, 0.0, 1.0, 0.019])) == "f_z -2.5 N, m_y 1 N m"
    assert format_wrench(np.zeros(6)) == "zero"


def test_direction_words():
    assert format_wrench_direction(np.array([0.0, -2.0, 0.0]), 1.0).startswith("a force along -y (direction [")
    text = format_wrench_direction(np.array([1.0, 0.0, 0.0, 0.0, 0.0, -20.0]), 0.05)
    assert text.startswith("a force along x with a torque about -z (direction")
    assert format_wrench_direction(np.array([1.0, 0.0, 0.0, 0.0, 0.0, -20.0]), 0.01).startswith(
        "a force along x (direction"
    )


def test_ranges_of_components_that_are_alike_are_named_together():
    low, high = np.array([-1.8, -1.8, 2.12, -0.02, -0.02, 0.0]), np.array([1.8, 1.8, 5.72, 0.02, 0.02, 0.0])
    assert format_ranges(low, high) == "f_x, f_y ±1.8 N; f_z 2.12 to 5.72 N; m_x, m_y ±0.02 N m"
    assert format_ranges(np.array([0.0, 3.92, 1e-12]), np.array([1e-15, 3.92, 0.1])) == "f_y 3.92 N; m_z 0 to 0.1 N m"
    assert format_ranges(np.zeros(3), np.zeros(3)) == "zero"


def test_moments_and_forces_that_rounding_leaves_are_not_worth_a_word():
    assert format_wrench(np.array([0.0, 0.0, 5.72, -3.1e-7, 1.6e-7, 2.5e-6])) == "f_z 5.72 N"
    assert format_wrench(np.array([1e-9, 0.0, 0.0, 0.0, 0.0, 0.02])) == "m_z 0.02 N m"
    assert format_wrench(np.array([3.0, 0.0, 0.0, 0.0, 0.0, 0.02])) == "f_x 3 N, m_z 0.02 N m"


@pytest.mark.parametrize(
    ("gap", "words"),
    [
        (0.0, "no placement is more than 0% better"),
        (0.01511, "no placement is more than 1.52% better"),
        (1.0, "no placement is more than 100% better"),
        (3.2, "the best possible is at most 4.2 times better"),
        (3.2011, "the best possible is at most 4.21 times better"),
        (np.inf, "nothing is known of how much better the best possible is"),
    ],
)
def test_the_best_possible_is_told_as_a_share_or_as_a_multiple(gap, words):
    assert format_headroom(gap) == words
