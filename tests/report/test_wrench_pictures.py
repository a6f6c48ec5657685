"""Pictures of the wrench set of any grasp, and public support functions."""

import numpy as np
import pytest

import nlpgrasp as ng

CORNERS = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]) / np.sqrt(3.0)
GRASP = ng.Grasp(CORNERS, -CORNERS, ng.FrictionContact(0.5))
TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])


def test_support_functions_are_attained_and_bound_each_other():
    y = np.random.default_rng(0).standard_normal((50, 6))
    values, wrenches = ng.support(GRASP, y)
    reach, maximisers = ng.support(TASK, y)
    np.testing.assert_allclose(np.einsum("ij,ij->i", y, wrenches), values, rtol=1e-9)
    np.testing.assert_allclose(np.einsum("ij,ij->i", y, maximisers), reach, rtol=1e-9)
    assert np.all(values >= ng.mu(GRASP, TASK).lower * reach)


def test_the_support_of_something_else_is_refused():
    with pytest.raises(ng.InputError, match=r"item: got .*, expected a Grasp or a Task"):
        ng.support("box", np.eye(6))
    with pytest.raises(ng.InputError, match="directions"):
        ng.support(GRASP, np.eye(3))


def test_a_picture_has_a_plane_for_each_pair_and_the_weakest_direction():
    pytest.importorskip("matplotlib")
    figure = ng.draw_wrenches(GRASP, TASK)
    drawn = [axes for axes in figure.axes if axes.lines or axes.patches]
    assert len(drawn) == 7
    with pytest.raises(ng.InputError, match="Grasp"):
        ng.draw_wrenches("box", TASK)
