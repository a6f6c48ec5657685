"""Conformance tests of every body."""

import pickle

import casadi as ca
import cloudpickle
import numpy as np
import pytest

import nlpgrasp as ng
from tests.samples import BODIES

bodies = pytest.mark.parametrize("body", BODIES.values(), ids=BODIES.keys())


@bodies
def test_samples_are_on_the_face_and_in_the_box(body, rng):
    for name in body.face_names:
        p = body.sample(name, 50, rng)
        h, slope, _, extent = body.evaluate(name, p)
        assert len(p) == 50
        assert np.max(np.abs(h) / slope) < 1e-8 * body.size
        assert np.max(extent) <= 1e-8 * body.size
        assert np.all(p >= body.bounds[0] - 1e-8 * body.size)
        assert np.all(p <= body.bounds[1] + 1e-8 * body.size)


@bodies
def test_points_are_on_a_face_or_beside_it(body, rng):
    for name in body.face_names:
        p = body.sample(name, 50, rng)
        assert np.all(body.is_on(name, p))
        assert not np.any(body.is_on(name, p + 1e-3 * body.size * body.evaluate(name, p)[2]))
        margin = min(0.5 * body.room(name), body.size)
        np.testing.assert_array_equal(body.is_on(name, p, margin), body.edge_distance(name, p) >= margin)


@bodies
def test_normals_are_unit_gradients(body, rng):
    """Against central differences of the surface itself."""
    step = 1e-6 * body.size
    for name in body.face_names:
        p = body.sample(name, 20, rng)
        _, slope, normals, _ = body.evaluate(name, p)
        columns = [
            (body.evaluate(name, p + step * e)[0] - body.evaluate(name, p - step * e)[0]) / (2 * step)
            for e in np.eye(body.space)
        ]
        gradient = np.stack(columns, axis=1)
        np.testing.assert_allclose(gradient, slope[:, None] * normals, rtol=1e-5, atol=1e-6 * np.max(slope))
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)


@bodies
def test_normals_point_outward(body, rng):
    for name in body.face_names:
        p = body.sample(name, 20, rng)
        normals = body.evaluate(name, p)[2]
        assert np.all(body.evaluate(name, p + 1e-4 * body.size * normals)[0] > 0.0)
        assert np.all(body.evaluate(name, p - 1e-4 * body.size * normals)[0] < 0.0)


@bodies
def test_snap_moves_nearby_points_onto_the_surface(body, rng):
    name = body.face_names[0]
    p = body.sample(name, 20, rng)
    nearby = p + 0.02 * body.size * rng.standard_normal(p.shape)
    h, slope, _, _ = body.evaluate(name, body.snap(name, nearby))
    assert np.max(np.abs(h) / slope) < 1e-9 * body.size


@bodies
def test_pickling_keeps_the_surface(body, rng):
    name = body.face_names[0]
    p = body.sample(name, 5, rng)
    copy = pickle.loads(cloudpickle.dumps(body))  # noqa: S301
    np.testing.assert_array_equal(copy.evaluate(name, p)[0], body.evaluate(name, p)[0])
    np.testing.assert_array_equal(copy.centroid, body.centroid)


@bodies
def test_dictionary_names_the_type(body):
    assert body.to_dict()["type"] in BODIES


def test_centroids():
    np.testing.assert_allclose(BODIES["prism"].centroid, [1 / 3, 1 / 3, 0.0])
    np.testing.assert_allclose(ng.Polygon([[0, 0], [2, 0], [2, 1], [0, 1]]).centroid, [1.0, 0.5])
    half = ng.Implicit(lambda p: ca.fmax(ca.sumsqr(p) - 1.0, -p[2]), [[-1.1] * 3, [1.1] * 3])
    np.testing.assert_allclose(half.centroid, [0.0, 0.0, 3 / 8], atol=0.01)


def test_centroid_far_from_the_origin():
    square = np.array([[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1]]) + np.array([5e5, 5e6])
    np.testing.assert_allclose(ng.Polygon(square).centroid, [5e5 + 0.05, 5e6 + 0.05], rtol=0, atol=1e-8)


def test_polygon_orientation_does_not_matter():
    clockwise = ng.Polygon([[0, 0], [0, 1], [1, 1], [1, 0]])
    normals = clockwise.evaluate("edge0", np.array([[0.5, 0.0]]))[2]
    assert abs(normals[0]).max() == pytest.approx(1.0)
    assert clockwise.evaluate("edge0", clockwise.centroid[None])[0][0] < 0.0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ng.Sphere(0.0), r"Sphere\.radius: got 0.0, expected a number greater than 0"),
        (lambda: ng.Ellipsoid([1.0, 0.0, 1.0]), r"Ellipsoid\.semi_axes: got 0.0"),
        (lambda: ng.Ellipsoid([1.0, 1.0]), r"Ellipsoid\.semi_axes: got shape \(2,\), expected shape \(3,\)"),
        (lambda: ng.Box([1.0, -1.0, 1.0]), r"Box\.extents: got -1.0"),
        (lambda: ng.Box([1.0, float("nan"), 1.0]), "finite numbers"),
        (lambda: ng.Cylinder(1.0, "tall"), r"Cylinder\.height"),
        (lambda: ng.Torus(1.0, 1.5), "less than the major radius"),
        (lambda: ng.Superquadric([1, 1, 1], [3.0, 1.0]), "from 0.2 to 1.9"),
        (lambda: ng.Polygon([[0, 0], [1, 0]]), "at least 3 vertices"),
        (lambda: ng.Polygon([[0, 0], [1, 1], [2, 2]]), "non-zero area"),
        (lambda: ng.Polygon([[0, 0], [2, 0], [1, 0], [1, 1]]), "simple polygon"),
        (lambda: ng.Sphere(1e-200), "at least 1e-100"),
        (lambda: ng.Polygon([[0, 0], [2, 2], [2, 0], [0, 1]]), "simple polygon"),
        (lambda: ng.Prism([[0, 0], [2, 0], [0.5, 0.5], [0, 2]], 1.0), "convex polygon"),
        (lambda: ng.Implicit(lambda p: 1.0 + ca.sumsqr(p), [[-1] * 3, [1] * 3]), "h negative inside"),
        (lambda: ng.Implicit(lambda p: ca.sumsqr(p) - 4.0, [[-1] * 3, [1] * 3]), "the whole body inside"),
        (lambda: ng.Implicit(lambda p: p, [[-1] * 3, [1] * 3]), "a scalar expression"),
        (lambda: ng.Implicit(lambda p: np.linalg.norm(p), [[-1] * 3, [1] * 3]), "CasADi operations on p"),
        (lambda: ng.Implicit(3.0, [[-1] * 3, [1] * 3]), "a function of a CasADi point"),
        (lambda: ng.Implicit(lambda p: ca.sumsqr(p) - 1, [[1] * 3, [-1] * 3]), "lower corner below"),
    ],
)
def test_bad_bodies_are_refused_in_one_sentence(make, message):
    with pytest.raises(ng.InputError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_faces_and_bodies_of_expressions_print_in_a_line():
    """A spline has thousands of numbers, and an expression may be as long."""
    ball = ng.Implicit(lambda p: p.T @ p - 0.03**2, [[-0.05] * 3, [0.05] * 3])
    assert repr(ball.faces) == "(Face('surface'),)"
    assert repr(ball) == "Implicit(h=<lambda>, bounds=[[-0.05, -0.05, -0.05], [0.05, 0.05, 0.05]])"
    assert repr(ng.Box([1, 1, 1]).faces[0]) == "Face('+x')"
