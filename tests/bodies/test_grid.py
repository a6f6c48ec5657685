"""Distance grids: exact near the surface, interpolated elsewhere."""

import casadi as ca
import numpy as np
import pytest
import trimesh
from scipy.ndimage import gaussian_filter

import nlpgrasp as ng
from nlpgrasp.bodies.mesh.signed_distance import EXACT_CELLS, _exact_distance, _narrow_band_distance, _tensor_grid
from nlpgrasp.common.meshes.search_tree import SearchTree


def grid_of(mesh, cells):
    lower, upper = mesh.bounds
    cell = float(np.max(upper - lower)) / cells
    return [np.arange(low - 5 * cell, high + 5.5 * cell, cell) for low, high in zip(lower, upper, strict=True)], cell


@pytest.mark.parametrize("shape", ["sphere", "box", "torus", "bracket"])
def test_near_the_surface_it_is_exact_and_after_smoothing_everywhere_close(shape):
    make = trimesh.creation
    mesh = {
        "sphere": lambda: make.icosphere(subdivisions=3, radius=0.03),
        "box": lambda: make.box(extents=[0.08, 0.05, 0.03]),
        "torus": lambda: make.torus(0.03, 0.01),
        "bracket": lambda: trimesh.util.concatenate(
            [make.box(bounds=[[0, 0, 0], [0.08, 0.02, 0.03]]), make.box(bounds=[[0, 0.02, 0], [0.02, 0.06, 0.03]])]
        ),
    }[shape]()
    distance = SearchTree(np.array(mesh.vertices, dtype=float), np.array(mesh.faces)).signed_distance
    axes, cell = grid_of(mesh, 40)
    exact, fast = (
        _exact_distance(distance, _tensor_grid(axes)),
        _narrow_band_distance(distance, axes, cell, EXACT_CELLS),
    )
    in_band = np.abs(exact) < (EXACT_CELLS - 0.8) * cell
    np.testing.assert_array_equal(fast[in_band], exact[in_band])
    assert np.max(np.abs(fast - exact)) < cell
    assert np.all((fast < 0.0) == (exact < 0.0))
    smooth = [gaussian_filter(field, 1.5) for field in (exact, fast)]
    assert np.max(np.abs(smooth[0] - smooth[1])[np.abs(exact) < cell]) < 0.03 * cell


def test_it_asks_the_mesh_about_a_fraction_of_the_points():
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.03)
    tree = SearchTree(np.array(mesh.vertices, dtype=float), np.array(mesh.faces))
    axes, cell = grid_of(mesh, 48)
    counts = []
    _narrow_band_distance(
        lambda points: counts.append(len(points)) or tree.signed_distance(points), axes, cell, EXACT_CELLS
    )
    assert sum(counts) < 0.5 * np.prod([len(axis) for axis in axes])


def test_the_distance_from_sharp_edges_is_right_to_a_tenth_of_a_cell_beyond_a_cell():
    mesh = trimesh.creation.box(extents=[0.08, 0.05, 0.03])
    body = ng.Mesh(mesh)
    points, _ = body.surface_samples(2000, np.random.default_rng(0))
    cell = 0.08 / body.resolution
    p = body.point()
    splined = ca.Function("edges", [p], body.face("surface").edges(p)).map(len(points))(points.T).full().ravel()
    error = (splined - body.edge_distance("surface", points)) / cell
    in_band = (splined > cell) & (splined < 3.0 * cell)
    assert np.quantile(error[in_band], 0.9) < 0.0  # less a tenth of a cell
    assert np.max(np.abs(error[in_band])) < 0.4
    h = body.evaluate("surface", points, 0.005)[3]
    np.testing.assert_allclose(h, 0.005 - splined, atol=1e-12)
    assert np.all(body.evaluate("surface", points)[3] == -np.inf)  # without a margin nothing is asked
    samples = body.sample("surface", 200, np.random.default_rng(0), 0.005)
    assert len(samples) == 200
    assert np.min(body.edge_distance("surface", samples)) >= 0.005
