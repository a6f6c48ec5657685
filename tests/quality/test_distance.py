"""Distance of a point from a polytope, against closed forms and a quadratic program."""

import clarabel
import numpy as np
import pytest
from scipy import sparse

import nlpgrasp as ng
from nlpgrasp.quality.paper_algorithms import polytope_distance

CUBE = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])


def by_quadratic_program(points, p):
    """Minimise |V^T w - p|^2 over weights w that are at least 0 and add up to 1."""
    m = len(points)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-13
    P, q = sparse.csc_matrix(np.triu(points @ points.T)), -points @ p
    A = sparse.csc_matrix(np.concatenate([np.ones((1, m)), -np.eye(m)]))
    cones = [clarabel.ZeroConeT(1), clarabel.NonnegativeConeT(m)]
    solution = clarabel.DefaultSolver(P, q, A, np.append(1.0, np.zeros(m)), cones, settings).solve()
    return float(np.linalg.norm(np.array(solution.x) @ points - p))


@pytest.mark.parametrize(
    ("point", "nearest"),
    [
        ([3.0, 0.2, -0.1], [1.0, 0.2, -0.1]),  # a face
        ([3.0, 2.0, 0.3], [1.0, 1.0, 0.3]),  # an edge
        ([2.0, -3.0, 4.0], [1.0, -1.0, 1.0]),  # a vertex
        ([0.3, -0.2, 0.9], [0.3, -0.2, 0.9]),  # inside
        ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
        ([1.0, 1.0, 1.0], [1.0, 1.0, 1.0]),
        ([1.0 + 1e-6, 0.0, 0.0], [1.0, 0.0, 0.0]),
        ([1e6, 0.0, 0.0], [1.0, 0.0, 0.0]),
    ],
)
def test_a_cube(point, nearest):
    result = polytope_distance(CUBE, point)
    expected = float(np.linalg.norm(np.subtract(point, nearest)))
    np.testing.assert_allclose(result.nearest, nearest, atol=1e-6)
    assert result.distance == pytest.approx(expected, abs=2e-7)
    assert result.lower == pytest.approx(expected, abs=2e-7)
    assert result.outside == (expected > 0.0)
    if expected > 1e-6:
        np.testing.assert_allclose(result.direction, np.subtract(point, nearest) / expected, atol=1e-6)


@pytest.mark.parametrize("d", [2, 3, 6])
@pytest.mark.parametrize("count", [1, 2, 5, 40])
def test_hulls_at_random_against_a_quadratic_program(d, count, rng):
    points = rng.standard_normal((count, d)) + 0.3
    for p in 2.0 * rng.standard_normal((8, d)):
        result, expected = polytope_distance(points, p), by_quadratic_program(points, p)
        assert result.distance == pytest.approx(expected, abs=1e-6)
        assert result.lower <= expected + 1e-9
        if result.outside:
            plane = np.max((points - p) @ result.direction)
            assert plane == pytest.approx(-expected, abs=1e-6)  # no vertex is nearer along the direction


def test_points_twice_on_a_line_and_all_the_same():
    line = np.repeat(np.linspace(0.0, 1.0, 5), 2)[:, None] * np.array([1.0, 2.0, 2.0])
    assert polytope_distance(line, [0.0, 0.0, 3.0]).distance == pytest.approx(np.sqrt(9.0 - 4.0))
    assert polytope_distance(np.ones((4, 3)), [1.0, 1.0, 3.0]).distance == pytest.approx(2.0)


def test_a_support_function_in_place_of_vertices(rng):
    """Of the same polytope the same answer, and of a ball, which has no vertices, its distance."""
    points = rng.standard_normal((30, 4))
    p = np.array([2.0, -1.0, 3.0, 1.0])
    directions = []

    def vertex(y):
        directions.append(y)
        return points[np.argmax(points @ y)]

    np.testing.assert_allclose(polytope_distance(vertex, p).nearest, polytope_distance(points, p).nearest)
    assert len(directions) < 30
    ball = polytope_distance(lambda y: y / np.linalg.norm(y), [3.0, 4.0])
    assert ball.distance == pytest.approx(4.0)
    assert ball.lower == pytest.approx(4.0)
    assert polytope_distance(lambda y: y / np.linalg.norm(y), [0.3, 0.4]).distance < 1e-6


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: polytope_distance(CUBE, [0.0, 0.0]), r"polytope: got shape \(8, 3\)"),
        (
            lambda: polytope_distance(np.zeros((0, 2)), [0.0, 0.0]),
            "polytope: got no points, expected",
        ),
        (lambda: polytope_distance(CUBE, [np.nan, 0.0, 0.0]), "point: got"),
        (lambda: polytope_distance(lambda y: y[:1], [0.0, 0.0]), r"polytope: got shape \(1,\)"),
        (lambda: polytope_distance(CUBE, [0.0, 0.0, 0.0], most=0), "most: got 0"),
    ],
)
def test_what_is_no_polytope_is_refused(make, message):
    with pytest.raises(ng.InputError, match=message):
        make()
