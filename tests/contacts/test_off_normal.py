"""Directions of rectangles: used only where tangential to the surface."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.contacts.pad import is_off_normal
from nlpgrasp.optimize.surface_samples import SurfaceSamples

PADS = [ng.PlaneContact(extents=(0.01, 0.006), friction=0.6, direction=[0, 0, 1], model="box")] * 2
TASK = ng.TaskEllipsoid([1.0] * 3 + [0.01] * 3)


def test_directions_near_a_normal_say_too_little():
    normals = np.array(
        [[0, 0, 1.0], [0, 0, -1.0], [np.sin(0.05), 0, np.cos(0.05)], [np.sin(0.2), 0, np.cos(0.2)], [1, 0, 0]]
    )
    np.testing.assert_array_equal(is_off_normal((0, 0, 2.0), normals), [False, False, False, True, True])


@pytest.mark.slow
def test_a_box_is_held_by_the_sides_that_the_direction_lies_in():
    problem = ng.GraspProblem(ng.Box([0.04, 0.03, 0.05]), PADS, TASK)
    samples = SurfaceSamples(problem)
    assert set(samples.usable_faces(0)) == {"+x", "-x", "+y", "-y"}
    solution = ng.solve(problem, 1, options=ng.SolveOptions(workers=1, rounds=1))
    assert solution.success
    assert set(solution.faces) <= {"+x", "-x", "+y", "-y"}
