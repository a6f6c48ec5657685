"""Nearest points, winding numbers and clearances of a mesh, against a box's closed forms and plain loops."""

import pickle

import numpy as np
import pytest
import trimesh

from nlpgrasp.common.meshes.search_tree import SearchTree

EXTENTS = np.array([0.08, 0.05, 0.03])


@pytest.fixture
def points(rng):
    return rng.uniform(-0.8, 0.8, (300, 3)) * EXTENTS


def tree_of(mesh):
    return SearchTree(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def distance_from_box(points):
    excess = np.abs(points) - EXTENTS / 2.0
    outer_distance = np.linalg.norm(np.maximum(excess, 0.0), axis=1)
    return outer_distance + np.minimum(np.max(excess, axis=1), 0.0)


def test_clearance_is_the_distance_and_negative_inside(points):
    box = trimesh.creation.box(EXTENTS).subdivide()
    np.testing.assert_allclose(tree_of(box).exact_signed_distance(points), distance_from_box(points), atol=1e-15)
    box.invert()
    np.testing.assert_allclose(tree_of(box).exact_signed_distance(points), distance_from_box(points), atol=1e-15)
    assert tree_of(box).exact_signed_distance(points[:0]).shape == (0,)


def test_signed_distance_is_the_clearance_to_a_hundredth(points):
    tree = tree_of(trimesh.creation.box(EXTENTS).subdivide())
    np.testing.assert_allclose(tree.signed_distance(points), distance_from_box(points), rtol=0.01)


def test_winding_numbers_are_one_inside(points):
    is_inside = distance_from_box(points) < 0.0
    box = trimesh.creation.box(EXTENTS).subdivide()
    np.testing.assert_allclose(tree_of(box).winding_numbers(points), is_inside, atol=0.01)
    box.invert()
    np.testing.assert_allclose(tree_of(box).winding_numbers(points), -1.0 * is_inside, atol=0.01)


def test_the_nearest_edge_is_that_of_a_loop(rng, points):
    ends = rng.uniform(-1.0, 1.0, (40, 2, 3)) * EXTENTS
    tree = SearchTree(ends.reshape(-1, 3), np.arange(80).reshape(40, 2))
    directions = ends[:, 1] - ends[:, 0]
    shares = np.sum((points[:, None] - ends[:, 0]) * directions, axis=2) / np.sum(directions**2, axis=1)
    feet = ends[:, 0] + np.clip(shares, 0.0, 1.0)[:, :, None] * directions
    distances = np.linalg.norm(points[:, None] - feet, axis=2)
    squared, edges, nearest = tree.nearest(points)
    np.testing.assert_allclose(np.sqrt(squared), distances.min(axis=1), atol=1e-14)
    np.testing.assert_array_equal(edges, distances.argmin(axis=1))
    np.testing.assert_allclose(nearest, feet[np.arange(len(points)), edges], atol=1e-14)


def test_trees_are_built_anew_where_they_are_let_go_or_sent_elsewhere(points):
    tree = tree_of(trimesh.creation.icosphere(subdivisions=2, radius=0.03))
    expected = tree.exact_signed_distance(points)
    tree.release()
    np.testing.assert_array_equal(tree.exact_signed_distance(points), expected)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(tree)).exact_signed_distance(points), expected)  # noqa: S301
