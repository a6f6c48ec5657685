"""Distances and angles between a grasp on the smoothed surface and its projection onto the mesh."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.optimize.grasp_on_body import surface_differences


@pytest.fixture(scope="module")
def box():
    return ng.Mesh(trimesh.creation.box([0.06, 0.04, 0.1]), smoothing=0.0, resolution=8)


def inward(angle):
    return [-np.cos(angle), np.sin(angle), 0.0]


def test_angles_are_between_stated_smooth_and_the_meshs_own_normals(box):
    grasp = ng.Grasp([[0.03, 0.0, 0.0], [0.03, 0.01, 0.0]], [inward(0.0), inward(0.03)], [ng.FrictionContact(0.5)] * 2)
    start = np.array([[0.029, 0.0, 0.0], [0.0302, 0.0, 0.0]])
    smooth = np.array([inward(0.02), inward(0.03)])
    match = surface_differences(box, start, grasp, smooth, free=False)
    np.testing.assert_allclose(match.distances, [1e-3, 2e-4], atol=1e-12)
    np.testing.assert_allclose(match.moved, [1e-3, np.hypot(0.01, 2e-4)], atol=1e-12)
    np.testing.assert_allclose(match.angles, [0.02, 0.03], atol=1e-7)
    np.testing.assert_allclose(match.stated, [0.0, 0.03], atol=1e-7)
    assert list(match.kept) == [1]


@pytest.mark.parametrize(("free", "off"), [(False, 0.0), (True, np.pi / 4.0)])
def test_only_posed_fingertips_touch_an_edge_between_its_triangles(box, free, off):
    grasp = ng.Grasp([[0.03, 0.02, 0.0], [-0.03, 0.0, 0.0]], [inward(-np.pi / 4.0), [1.0, 0.0, 0.0]], ng.PointContact())
    match = surface_differences(box, grasp.points, grasp, grasp.normals, free)
    np.testing.assert_allclose(match.stated, [off, 0.0], atol=1e-7)
