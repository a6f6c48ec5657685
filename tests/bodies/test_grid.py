"""Distance grids: exact near the surface, interpolated elsewhere."""

import casadi as ca
import numpy as np
import pytest
import trimesh
from scipy.ndimage import gaussian_filter

import nlpgrasp as ng
from nlpgrasp.bodies.mesh.signed_distance import (
    EXACT_CELLS,
    _narrow_band_distance,
    _SignedDistance,
    _tensor_grid,
)
from nlpgrasp.common.meshes.search_tree import SearchTree
from nlpgrasp.common.meshes.topology import is_plain


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
    vertices, faces = np.array(mesh.vertices, dtype=float), np.array(mesh.faces)
    axes, cell = grid_of(mesh, 40)
    points = _tensor_grid(axes)
    exact = SearchTree(vertices, faces).exact_signed_distance(points.reshape(-1, 3)).reshape(points.shape[:-1])
    fast = _narrow_band_distance(_SignedDistance(vertices, faces).on_grid, axes, cell, EXACT_CELLS)
    in_band = np.abs(exact) < (EXACT_CELLS - 0.8) * cell
    np.testing.assert_allclose(fast[in_band], exact[in_band], atol=1e-3 * cell)
    assert np.max(np.abs(fast - exact)) < cell
    assert np.all((fast < 0.0) == (exact < 0.0))
    smooth = [gaussian_filter(field, 1.5) for field in (exact, fast)]
    assert np.max(np.abs(smooth[0] - smooth[1])[np.abs(exact) < cell]) < 0.03 * cell


def test_it_asks_the_mesh_about_a_fraction_of_the_points(monkeypatch):
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.03)
    distance = _SignedDistance(np.array(mesh.vertices, dtype=float), np.array(mesh.faces))
    axes, cell = grid_of(mesh, 48)
    nearest, winding = [], []
    for name, counts in (("nearest", nearest), ("winding_numbers", winding)):
        function = getattr(SearchTree, name)
        monkeypatch.setattr(SearchTree, name, lambda tree, p, f=function, c=counts: c.append(len(p)) or f(tree, p))
    _narrow_band_distance(distance.on_grid, axes, cell, EXACT_CELLS)
    count = np.prod([len(axis) for axis in axes])
    assert sum(nearest) < 0.5 * count
    assert sum(winding) < 0.02 * count


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


def shapes():
    """Return closed meshes: round, thin, hollow, of parts that overlap, with long thin triangles."""
    creation = trimesh.creation
    crossing = trimesh.util.concatenate([creation.box([2.0, 0.3, 0.3]), creation.box([0.3, 2.0, 0.31])])
    hollow = trimesh.util.concatenate([creation.icosphere(3), creation.icosphere(3, 0.8).copy()])
    hollow.faces[len(hollow.faces) // 2 :] = hollow.faces[len(hollow.faces) // 2 :, ::-1]
    return {
        "sphere": creation.icosphere(3),
        "sheet": creation.box([1.0, 1.0, 0.004]),
        "hollow": hollow,
        "crossing": crossing,
        "disc": creation.cylinder(radius=1.0, height=0.3, sections=200),
        "ring": creation.annulus(0.5, 0.52, 0.4),
    }


@pytest.mark.parametrize("name", shapes())
def test_distances_on_a_grid_have_the_signs_of_winding_numbers(name):
    """Also where walls are thinner than a cell, and where surfaces are inside the body."""
    mesh = shapes()[name]
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    assert is_plain(mesh)
    axes = [np.arange(low - 0.2, high + 0.2, 0.05) for low, high in mesh.bounds.T]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    chosen = np.random.default_rng(0).random(points.shape[:-1]) < 0.9
    expected = SearchTree(vertices, faces).exact_signed_distance(points[chosen])
    distances = _SignedDistance(vertices, faces).on_grid(points, chosen, 0.05)
    np.testing.assert_allclose(distances, expected, atol=0.01 * 0.05)


def test_a_mesh_with_a_hole_is_not_closed():
    sphere = trimesh.creation.icosphere(1)
    faces = np.asarray(sphere.faces)
    for chosen, closed in (
        (faces, True),
        (faces[1:], False),
        (np.concatenate([faces[:1, ::-1], faces[1:]]), False),
    ):
        assert is_plain(trimesh.Trimesh(sphere.vertices, chosen, process=False)) == closed
