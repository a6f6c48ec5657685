"""Intersections of boxes and triangles, against all pairs and edge tests."""

import numpy as np
import pytest

from nlpgrasp.common.meshes.intersections import intersecting_boxes, is_covered, triangles_intersect
from tests.bodies.made_meshes import signed_crossings

SLACK = 1e-9
FLAT = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def moved(triangle, x, y, z):
    return triangle + np.array([x, y, z])


def crosses(first, second):
    return bool(triangles_intersect(np.array([first]), np.array([second]), SLACK)[0])


@pytest.mark.parametrize("longest", [0.02, 0.3, 1.5])
def test_boxes_that_meet_are_all_found(longest, rng):
    lower = rng.uniform(0.0, 1.0, (300, 3))
    upper = lower + rng.uniform(0.0, longest, (300, 3))
    meet = np.all((lower[:, None] <= upper) & (lower <= upper[:, None]), axis=2)
    np.testing.assert_array_equal(intersecting_boxes(lower, upper), np.argwhere(np.triu(meet, 1)))


def test_triangles_cross_where_an_edge_of_one_goes_through_the_other(rng):
    first, second = rng.uniform(0.0, 1.0, (2, 400, 3, 3))
    expected = [_edges_through(a, b) or _edges_through(b, a) for a, b in zip(first, second, strict=True)]
    np.testing.assert_array_equal(triangles_intersect(first, second, SLACK), expected)
    assert 20 < np.sum(expected) < 380


def _edges_through(first, second):
    """Return whether an edge of a triangle passes through the other."""
    normal = np.cross(second[1] - second[0], second[2] - second[0])
    for start, end in zip(first, np.roll(first, -1, axis=0), strict=True):
        a, b = (start - second[0]) @ normal, (end - second[0]) @ normal
        point = start + (end - start) * a / (a - b)
        sides = np.cross(np.roll(second, -1, axis=0) - second, point - second) @ normal
        if a * b < 0.0 and np.all(sides > 0.0):
            return True
    return False


def test_triangles_beside_each_other_do_not_cross_and_upon_each_other_do():
    adjacent = np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    assert not crosses(FLAT, adjacent)
    assert crosses(FLAT, FLAT[::-1])
    assert crosses(FLAT, moved(FLAT, 0.2, 0.2, 0.0))
    assert not crosses(FLAT, moved(FLAT, 0.2, 0.2, 1e-3))


def test_a_wall_that_ends_on_a_triangle_touches_it():
    wall = np.array([[0.1, 0.2, 0.0], [0.5, 0.2, 0.0], [0.3, 0.2, 1.0]])
    assert crosses(FLAT, wall)
    assert not crosses(FLAT, moved(wall, 0.0, 0.0, 1e-3))


def test_a_triangle_is_covered_by_the_one_around_it():
    inner = moved(0.2 * FLAT, 0.1, 0.1, 0.0)
    first = np.array([inner, inner[::-1], FLAT, moved(inner, 0.0, 0.0, 1e-3), moved(inner, 0.9, 0.0, 0.0)])
    second = np.array([FLAT, FLAT, inner, FLAT, FLAT])
    np.testing.assert_array_equal(is_covered(first, second, SLACK), [True, True, False, False, False])


def test_the_rays_of_the_tests_tell_inside_from_outside():
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    sides = corners[[[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]]
    points = np.array([[0.1, 0.2, 0.3], [0.6, 0.6, 0.6], [-0.1, -0.1, -0.1]])
    np.testing.assert_array_equal(signed_crossings(sides, points), [1.0, 0.0, 0.0])
