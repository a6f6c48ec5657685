"""Distance of bodies on a grid: against their distance at points, and derivatives by differences."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.bodies.distance_grid import DistanceGrid

MESH = ng.Mesh(trimesh.creation.capsule(height=0.05, radius=0.02, count=[24, 24]))
BODIES = {
    "mesh": MESH,
    "box": ng.Box([0.08, 0.05, 0.04]),
    "ellipsoid": ng.Ellipsoid([0.05, 0.03, 0.02]),
    "cylinder": ng.Cylinder(0.02, 0.09),
    "torus": ng.Torus(0.05, 0.015),
}
bodies = pytest.mark.parametrize("body", BODIES.values(), ids=BODIES.keys())


def near(body, count=200):
    lower, upper = body.bounds
    return np.random.default_rng(0).uniform(lower - 0.01, upper + 0.01, (count, 3))


@bodies
def test_values_are_the_distances_within_a_part_of_a_cell(body):
    grid, points = DistanceGrid(body, 0.02), near(body)
    expected = body.signed_distance(points)
    assert grid.distance(points)[0] == pytest.approx(expected, abs=0.6 * grid.spacing)
    assert np.median(np.abs(grid.distance(points)[0] - expected)) < 0.1 * grid.spacing
    assert grid.nearest(points) == pytest.approx(expected, abs=1.2 * grid.spacing)


@bodies
def test_gradients_are_those_of_the_values(body):
    grid, points, step = DistanceGrid(body, 0.02), near(body), 1e-7
    value, gradient = grid.distance(points)
    for axis in range(3):
        ahead = grid.distance(points + step * np.eye(3)[axis])[0]
        differences = (ahead - value) / step
        assert np.quantile(np.abs(differences - gradient[:, axis]), 0.97) < 1e-5  # a step may lead into another cell


def test_the_smooth_surface_of_a_mesh_is_the_one_that_contacts_are_on():
    grid = DistanceGrid(MESH, 0.02)
    points = MESH.sample("surface", 200, np.random.default_rng(0))
    value, gradient, hessian = grid.smooth_distance(points)
    slope = np.linalg.norm(gradient, axis=1)
    assert np.max(np.abs(value / slope)) < 1e-4
    assert np.min(np.sum(gradient / slope[:, None] * MESH.evaluate("surface", points)[2], axis=1)) > 0.998
    side = np.abs(points[:, 2]) < 0.015  # of radius 20 mm: one curvature is its inverse
    assert np.median(np.linalg.eigvalsh(hessian[side])[:, 2]) == pytest.approx(50.0, rel=0.15)


def test_beyond_the_grid_the_distance_grows_and_is_at_most_the_true_one(rng):
    grid = DistanceGrid(BODIES["box"], 0.01)
    points = np.concatenate([[[0.2, 0.0, 0.0], [0.04, 0.3, 0.1]], rng.uniform(-0.5, 0.5, (500, 3))])
    value, _ = grid.distance(points)
    expected, outside = BODIES["box"].signed_distance(points), grid.beyond(points) > 0.0
    assert np.all(value[outside] <= expected[outside] + 1e-4)
    assert np.all(value[outside] >= 0.85 * expected[outside])
    assert np.sum(outside) > 490


def test_sharp_edges_of_a_mesh_are_known():
    box = ng.Mesh(trimesh.creation.box([0.08, 0.05, 0.04]).subdivide().subdivide())
    grid, points = DistanceGrid(box, 0.02), np.array([[0.0, 0.0, 0.02], [0.035, 0.0, 0.02]])
    value, gradient = grid.edge_distance(points)
    assert value == pytest.approx([0.025, 0.005], abs=2e-3)
    assert gradient[1] == pytest.approx([-1.0, 0.0, 0.0], abs=0.2)
    assert DistanceGrid(BODIES["ellipsoid"], 0.02).edge_distance(points) is None
