"""Labels, units and words of wrenches."""

import numpy as np
import pytest

from nlpgrasp.common.shown.words import COMPONENTS, DIRECTIONS, axis_labels, direction_words, unit_of, wrench_words


@pytest.mark.parametrize("dimension", [3, 6])
def test_every_component_has_a_label_and_a_direction(dimension):
    assert len(COMPONENTS[dimension]) == len(DIRECTIONS[dimension]) == dimension
    forces = [unit_of(name) == "N" for name in COMPONENTS[dimension]]
    assert forces == ["force" in words for words in DIRECTIONS[dimension]]


def test_axis_labels():
    assert axis_labels(3) == ["f_x [N]", "f_y [N]", "m_z [N m]"]
    assert axis_labels(6)[2:4] == ["f_z [N]", "m_x [N m]"]


def test_small_components_are_left_out():
    assert wrench_words(np.array([10.0, 0.1, -3.0])) == "f_x 10 N, m_z -3 N m"
    assert wrench_words(np.array([0.0, 0.0, -2.5, 0.0, 1.0, 0.019])) == "f_z -2.5 N, m_y 1 N m"
    assert wrench_words(np.zeros(6)) == "zero"


def test_direction_words():
    assert direction_words(np.array([0.0, -2.0, 0.0]), 1.0).startswith("a force along -y (direction [")
    both = direction_words(np.array([1.0, 0.0, 0.0, 0.0, 0.0, -20.0]), 0.05)
    assert both.startswith("a force along x with a torque about -z (direction")
    assert direction_words(np.array([1.0, 0.0, 0.0, 0.0, 0.0, -20.0]), 0.01).startswith("a force along x (direction")
