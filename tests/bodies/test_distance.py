"""Signed distance of clearances: a lower bound, exact near the surface."""

import pickle

import casadi as ca
import numpy as np
import pytest
import trimesh
from scipy.interpolate import NdBSpline
from scipy.spatial import cKDTree

import nlpgrasp as ng
from nlpgrasp.bodies.mesh.signed_distance import distance_spline
from tests.samples import BODIES

EXACT = ("sphere", "cylinder", "box", "prism", "torus", "polygon")


def distances(body, points):
    return np.asarray(body.distance_function.map(len(points))(points.T).full()).ravel()


@pytest.mark.parametrize("name", BODIES)
def test_distance_is_never_more_than_the_true_one(name, rng):
    """Against the nearest of many surface points, which is a little too far."""
    body = BODIES[name]
    cloud = np.concatenate([body.sample(face, 3000, rng) for face in body.face_names])
    lower, upper = body.bounds
    points = rng.uniform(lower - 0.5 * body.size, upper + 0.5 * body.size, (1500, body.space))
    computed, true = distances(body, points), cKDTree(cloud).query(points)[0]
    is_outside = computed > 0.0
    assert np.max((computed - true)[is_outside]) < 1e-3 * body.size
    assert np.mean(is_outside) > 0.5
    if name in EXACT:
        assert np.max(np.abs(np.abs(computed) - true)) < 0.06 * body.size


@pytest.mark.parametrize("name", BODIES)
def test_distance_grows_like_the_distance_near_the_surface(name, rng):
    body = BODIES[name]
    face = body.face_names[0]
    points = body.sample(face, 40, rng)
    outward = body.evaluate(face, points)[2]
    h = 1e-4 * body.size
    off_edges = body.evaluate(face, points)[3] < -3.0 * h
    computed = distances(body, points + h * outward)[off_edges]
    np.testing.assert_allclose(computed, h, rtol=0.02)


def test_distance_to_a_mesh_is_the_meshs_own(outside_meshes, rng):
    body = ng.Mesh.load(outside_meshes / "ycb_012_strawberry.stl")
    points = rng.uniform(body.bounds[0] - 0.05, body.bounds[1] + 0.05, (3000, 3))
    computed, true = distances(body, points), body.signed_distance(points)
    is_near = (true > 0.004) & (true < 0.015)
    assert np.max(np.abs(computed - true)[is_near]) < 2e-4
    assert np.max((computed - true)[true > 0.004]) < 2e-4


def test_distance_of_a_slender_mesh_far_outside_its_grid():
    import trimesh

    body = ng.Mesh(trimesh.creation.box([0.2, 0.02, 0.02]))
    point = np.array([[0.0, 0.0, 0.5]])
    assert 0.43 < distances(body, point)[0] <= 0.49 + 1e-6


def test_a_distance_spline_is_pickled_without_its_compiled_function():
    mesh = trimesh.creation.box([0.08, 0.05, 0.04])
    spline = distance_spline(np.asarray(mesh.vertices), np.asarray(mesh.faces), 20, 1.0)
    unused = pickle.dumps(spline)
    value = float(spline.function(spline.box[0]))
    assert pickle.dumps(spline) == unused
    assert float(pickle.loads(unused).function(spline.box[0])) == value  # noqa: S301


def test_derivatives_of_a_distance_spline_are_those_of_scipy(rng):
    mesh = trimesh.creation.box([0.08, 0.05, 0.04]).subdivide()
    spline = distance_spline(np.asarray(mesh.vertices), np.asarray(mesh.faces), 20, 1.0)
    reference = NdBSpline(tuple(np.asarray(knots) for knots in spline.knots), spline.coefficients, 3)
    p = ca.MX.sym("p", 3)
    distance = spline.expression(p)
    hessian, gradient = ca.hessian(distance, p)
    function = ca.Function("derivatives", [p], [distance, gradient, hessian])
    orders = np.eye(3, dtype=int)
    for point in rng.uniform(*spline.box, (20, 3)):
        value, slope, bend = (np.asarray(part) for part in function(point + spline.origin))
        assert value.item() == pytest.approx(reference(point).item(), abs=1e-12)
        assert slope.ravel() == pytest.approx([reference(point, nu=n).item() for n in orders], abs=1e-10)
        expected = [[reference(point, nu=a + b).item() for b in orders] for a in orders]
        assert bend == pytest.approx(np.array(expected), abs=1e-7)
