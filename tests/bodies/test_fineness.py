"""Automatic smoothing and resolution from the wall thickness, and their accuracy."""

import math

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.bodies.mesh.signed_distance import (
    MOST_POINTS,
    GridResolution,
    choose_grid_resolution,
    smooth_offset,
    wall_thickness,
)

MUG = np.array([0.083, 0.06, 0.07])  # sides of the mug, metres


def dish(wall):
    """A dish of 60 x 60 x 20 mm, a polygon turned about its axis."""
    outer, height = 0.03, 0.02
    profile = [[0, 0], [outer, 0], [outer, height], [outer - wall, height], [outer - wall, wall], [0, wall]]
    return trimesh.creation.revolve(np.array(profile), sections=32)


@pytest.fixture(scope="module")
def thin():
    return ng.Mesh(dish(0.003))


def even_wall(half, deviation):
    """The mean distance from a wall's middle plane, less half its thickness, under a Gaussian: zero on its surface."""

    def lifted(x):
        t = x / deviation
        density = math.exp(-t * t / 2.0) / math.sqrt(2.0 * math.pi)
        return x * math.erf(t / math.sqrt(2.0)) + 2.0 * deviation * density - half

    low, high = 0.0, half
    for _ in range(60):
        middle = (low + high) / 2.0
        low, high = (middle, high) if lifted(middle) < 0.0 else (low, middle)
    return half - low


def test_thin_walls_stay_where_they_are(thin, rng):
    assert thin.wall == pytest.approx(0.003, rel=0.03)
    assert (thin.smoothing, thin.resolution) == (0.99, 48)
    assert thin.offset.most < 0.15 * thin.wall
    points = thin.sample("surface", 300, rng)
    assert np.quantile(thin.closest(points)[2], 0.8) < 0.15 * thin.wall  # the other way round, by other code


@pytest.mark.slow
def test_walls_of_a_millimetre_stay_too():
    body = ng.Mesh(dish(0.001))
    assert body.resolution > 48
    assert body.offset.most < 0.2 * body.wall


def test_the_usual_choice_would_spoil_a_thin_wall():
    spoiled = ng.Mesh(dish(0.003), smoothing=1.5, resolution=30)
    assert spoiled.offset.most > spoiled.wall / 3.0
    assert spoiled.offset.largest >= spoiled.offset.most


def test_thick_bodies_keep_the_usual_choice():
    for mesh in (trimesh.creation.box([0.1, 0.06, 0.04]), trimesh.creation.icosphere(radius=0.05)):
        body = ng.Mesh(mesh)
        assert (body.smoothing, body.resolution) == (1.5, 48)
        assert body.offset.most < 0.05 * body.wall


def test_an_even_wall_moves_by_a_sixteenth_of_its_thickness():
    grid = choose_grid_resolution(MUG, 0.004)
    deviation = grid.smoothing * MUG[0] / grid.resolution
    assert even_wall(0.002, deviation) / 0.004 == pytest.approx(1.0 / 16.0, rel=0.05)
    plate = trimesh.creation.box([0.1, 0.1, 0.01])
    body = ng.Mesh(plate, smoothing=2.0, resolution=48)
    deviation = 2.0 * 0.1 / 48
    middle = np.array([[0.0, 0.0, 0.005]])
    offset = smooth_offset(body, middle, deviation, body.wall).most
    assert offset == pytest.approx(even_wall(0.005, deviation), rel=0.1)


def test_less_smoothing_first_then_a_finer_grid_then_less_smoothing_still():
    thick, medium, thin = (choose_grid_resolution(MUG, 1e-3 * wall) for wall in (4, 2, 1))
    assert thick.resolution == 48
    assert 0.75 <= thick.smoothing < 1.0
    assert 48 < medium.resolution < 100
    assert 0.75 <= medium.smoothing < 0.77
    assert thin.smoothing < 0.5
    assert np.prod(MUG / MUG[0] * thin.resolution + 11) <= MOST_POINTS
    for grid, wall in ((thick, 0.004), (medium, 0.002), (thin, 0.001)):
        assert 2.4 * grid.smoothing * MUG[0] / grid.resolution <= wall


def test_what_is_given_is_used():
    box = trimesh.creation.box([0.08, 0.06, 0.002])
    body = ng.Mesh(box, smoothing=1.5, resolution=20)
    assert (body.smoothing, body.resolution) == (1.5, 20)
    assert body.to_dict()["smoothing"] == 1.5
    assert body.to_dict()["resolution"] == 20
    assert ng.Mesh(box, resolution=20).smoothing == pytest.approx(0.002 * 20 / (2.4 * 0.08), abs=0.01)
    assert choose_grid_resolution(MUG, 0.004, smoothing=1.5).resolution == 75
    assert choose_grid_resolution(MUG, 0.004, smoothing=0.0).resolution == 48


def test_the_choice_is_in_the_file_and_the_same_each_time(thin, monkeypatch):
    monkeypatch.setenv("NLPGRASP_CACHE", "off")
    repeated = choose_grid_resolution(np.ptp(thin.mesh.bounds, axis=0), wall_thickness(dish(0.003)))
    data = thin.to_dict()
    assert repeated == GridResolution(data["smoothing"], data["resolution"])


def test_small_triangles_let_no_ray_through():
    """The scale at which rays are cast has no triangle degenerate: a ball of 20,000 in metres."""
    assert wall_thickness(trimesh.creation.icosphere(subdivisions=5, radius=0.02)) == pytest.approx(0.04, rel=0.01)
