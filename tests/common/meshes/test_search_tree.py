"""Nearest points, winding numbers and clearances of a triangle mesh, against a box's own and against plain loops."""

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
    beyond = np.abs(points) - EXTENTS / 2.0
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return outside + np.minimum(np.max(beyond, axis=1), 0.0)


def test_clearance_is_the_distance_and_negative_inside(points):
    box = trimesh.creation.box(EXTENTS).subdivide()
    np.testing.assert_allclose(tree_of(box).clearance(points), distance_from_box(points), atol=1e-15)
    box.invert()
    np.testing.assert_allclose(tree_of(box).clearance(points), distance_from_box(points), atol=1e-15)
    assert tree_of(box).clearance(points[:0]).shape == (0,)


def test_signed_distance_is_the_clearance_to_a_hundredth(points):
    tree = tree_of(trimesh.creation.box(EXTENTS).subdivide())
    np.testing.assert_allclose(tree.signed_distance(points), distance_from_box(points), rtol=0.01)


def test_winding_numbers_are_one_inside(points):
    inside = distance_from_box(points) < 0.0
    box = trimesh.creation.box(EXTENTS).subdivide()
    np.testing.assert_allclose(tree_of(box).winding_numbers(points), inside, atol=0.01)
    box.invert()
    np.testing.assert_allclose(tree_of(box).winding_numbers(points), -1.0 * inside, atol=0.01)


def test_the_nearest_edge_is_that_of_a_loop(rng, points):
    ends = rng.uniform(-1.0, 1.0, (40, 2, 3)) * EXTENTS
    tree = SearchTree(ends.reshape(-1, 3), np.arange(80).reshape(40, 2))
    along = ends[:, 1] - ends[:, 0]
    shares = np.sum((points[:, None] - ends[:, 0]) * along, axis=2) / np.sum(along**2, axis=1)
    places = ends[:, 0] + np.clip(shares, 0.0, 1.0)[:, :, None] * along
    apart = np.linalg.norm(points[:, None] - places, axis=2)
    squared, edges, nearest = tree.nearest(points)
    np.testing.assert_allclose(np.sqrt(squared), apart.min(axis=1), atol=1e-14)
    np.testing.assert_array_equal(edges, apart.argmin(axis=1))
    np.testing.assert_allclose(nearest, places[np.arange(len(points)), edges], atol=1e-14)


def test_trees_are_built_anew_where_they_are_let_go_or_sent_elsewhere(points):
    tree = tree_of(trimesh.creation.icosphere(subdivisions=2, radius=0.03))
    known = tree.clearance(points)
    tree.release()
    np.testing.assert_array_equal(tree.clearance(points), known)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(tree)).clearance(points), known)  # noqa: S301
