"""Distances on a grid: exact near the surface, splines through fewer points elsewhere."""

import numpy as np
import pytest
import trimesh
from scipy.ndimage import gaussian_filter

from nlpgrasp.bodies.mesh.signed_distance import EXACT_CELLS, _exact, _grid, _near_exact
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
    tree = SearchTree(np.array(mesh.vertices, dtype=float), np.array(mesh.faces))
    axes, cell = grid_of(mesh, 40)
    exact, fast = _exact(tree, _grid(axes)), _near_exact(tree, axes, cell, EXACT_CELLS)
    near = np.abs(exact) < (EXACT_CELLS - 0.8) * cell
    np.testing.assert_array_equal(fast[near], exact[near])
    assert np.max(np.abs(fast - exact)) < cell
    assert np.all((fast < 0.0) == (exact < 0.0))
    smooth = [gaussian_filter(field, 1.5) for field in (exact, fast)]
    assert np.max(np.abs(smooth[0] - smooth[1])[np.abs(exact) < cell]) < 0.03 * cell


def test_it_asks_the_mesh_about_a_fraction_of_the_points(monkeypatch):
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.03)
    tree = SearchTree(np.array(mesh.vertices, dtype=float), np.array(mesh.faces))
    axes, cell = grid_of(mesh, 48)
    asked, own = [], tree.signed_distance
    monkeypatch.setattr(tree, "signed_distance", lambda points: asked.append(len(points)) or own(points))
    _near_exact(tree, axes, cell, EXACT_CELLS)
    assert sum(asked) < 0.5 * np.prod([len(axis) for axis in axes])
