"""Incremental convex hull against Qhull, and containment of its centre."""

import itertools

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from nlpgrasp.quality.convex_hull import IncrementalHull


def ball(directions):
    """Return the support function of the unit ball."""
    return np.linalg.norm(directions, axis=1)


def grown(points, first):
    hull = IncrementalHull(points[:first], points[:first], ball, np.zeros((points.shape[1],) * 2))
    for p in points[first:]:
        hull.insert(p[None], p[None])
    return hull


@pytest.mark.parametrize("dimension", [2, 3, 4, 6])
def test_same_facets_as_qhull(dimension, rng):
    points = rng.standard_normal((80, dimension))
    hull, expected = grown(points, 12), ConvexHull(points)
    planes = hull.planes[np.any(hull.planes != 0.0, axis=1)]
    distances = np.sort((1.0 + planes @ hull.centre) / np.linalg.norm(planes, axis=1))
    np.testing.assert_allclose(distances, np.sort(-expected.equations[:, -1]), rtol=1e-9, atol=1e-9)


def test_a_point_inside_changes_nothing(rng):
    points = rng.standard_normal((30, 4))
    hull = IncrementalHull(points, points, ball, np.zeros((points.shape[1],) * 2))
    before = hull.values.copy()
    middle = points.mean(axis=0, keepdims=True)
    assert not hull.insert(middle, middle)
    np.testing.assert_array_equal(hull.values, before)


DEGENERATE = {
    "grid": np.array(list(itertools.product([-1.0, 0.0, 1.0], repeat=4))),
    "cross and cube": np.concatenate(
        [np.eye(4), -np.eye(4), np.array(list(itertools.product([-0.25, 0.25], repeat=4)))]
    ),
    "repeated": np.repeat(np.concatenate([np.eye(4), -np.eye(4)]), 3, axis=0),
}


@pytest.mark.parametrize("name", DEGENERATE)
@pytest.mark.parametrize("seed", range(3))
def test_degenerate_points_stay_inside_and_surrounded(name, seed):
    """Every point is below every plane, and every direction meets a cell: the planes bound the hull's own gauge."""
    rng = np.random.default_rng(seed)
    points = DEGENERATE[name]
    points = points[rng.permutation(len(points))]
    start = rng.uniform(-0.1, 0.1, (10, 4))
    hull = grown(np.concatenate([start, points]), 10)
    live = hull.planes[np.any(hull.planes != 0.0, axis=1)]
    assert np.max((points - hull.centre) @ live.T) <= 1.0 + 1e-6
    directions = rng.standard_normal((200, 4))
    expected = ConvexHull(points)  # merged facets: the same planes
    gauge = np.max(
        directions
        @ expected.equations[:, :-1].T
        / (-expected.equations[:, -1] - expected.equations[:, :-1] @ hull.centre),
        axis=1,
    )
    np.testing.assert_allclose(np.max(directions @ live.T, axis=1), gauge, rtol=1e-6)


def test_cells_that_rounding_turns_over_the_centre_are_noticed(rng):
    points = rng.standard_normal((40, 3))
    assert IncrementalHull(points, points, ball, np.full((3, 3), 1e-12)).is_sound
    assert not IncrementalHull(points, points, ball, np.full((3, 3), 0.1)).is_sound
