"""Task ellipsoids: support functions and the quadratic form (3.3-3)."""

import numpy as np
import pytest

import nlpgrasp as ng
from tests.samples import random_rotation


def test_support_is_attained_by_its_maximiser(rng):
    task = ng.TaskEllipsoid(rng.uniform(0.5, 2.0, 6), rng.standard_normal(6), random_rotation(rng, 6))
    y = rng.standard_normal((100, 6))
    value, wrench = task.support(y)
    np.testing.assert_allclose(np.sum(wrench * y, axis=1), value)
    wrenches = task.boundary(rng.standard_normal((500, 6)) / 10.0)
    interior = wrenches[np.linalg.norm(np.linalg.solve(task.axes.T, (wrenches - task.center).T), axis=0) <= 1.0]
    assert np.all(interior @ y.T <= value + 1e-12)


def test_quadratic_form_is_3_3_3(rng):
    """Boundary points of the ellipsoid satisfy <y, Q y> + <a, y> = beta^2."""
    root = rng.standard_normal((6, 6))
    Q, a, beta = root @ root.T + 0.1 * np.eye(6), rng.standard_normal(6), 1.7
    task = ng.TaskEllipsoid.from_quadratic(Q, a, beta)
    u = rng.standard_normal((50, 6))
    y = task.boundary(u / np.linalg.norm(u, axis=1, keepdims=True))
    np.testing.assert_allclose(np.einsum("mi,ij,mj->m", y, Q, y) + y @ a, beta**2, rtol=1e-9)


def test_centred_quadratic_has_semi_axes_beta_over_root_of_eigenvalue():
    task = ng.TaskEllipsoid.from_quadratic(np.diag([4.0, 1.0, 0.25]), beta=2.0)
    np.testing.assert_allclose(sorted(np.linalg.norm(task.axes, axis=1)), [1.0, 2.0, 4.0])
    assert task.is_centred


def test_ellipsoids_of_the_peg_and_the_pencil(rng):
    """(3.3-1), (3.3-2) as they are printed: semi-axes are r_i beta (docs/corrections.md), whatever the centre."""
    r, beta, c1, c2, c = np.sort(rng.uniform(0.1, 2.0, 6))[::-1], 1.6, 3.0, 0.5, 0.7
    u = rng.standard_normal((50, 6))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    peg = ng.TaskEllipsoid(beta * r[[4, 0, 3, 2, 5, 1]], center=[0, -c1, c2, 0, 0, 0])
    fx, fy, fz, tx, ty, tz = peg.boundary(u).T
    squares = np.array([fy + c1, tz, tx, fz - c2, fx, ty]) ** 2
    np.testing.assert_allclose(np.sum(squares / r[:, None] ** 2, axis=0), beta**2)
    pencil = ng.TaskEllipsoid(beta * r[[2, 3, 4, 5, 1, 0]], center=[c, 0, 0, 0, 0, 0])
    fx, fy, fz, tx, ty, tz = pencil.boundary(u).T
    squares = np.array([tz, ty, fx - c, fy, fz, tx]) ** 2
    np.testing.assert_allclose(np.sum(squares / r[:, None] ** 2, axis=0), beta**2)


def test_offsets_within_the_ellipsoid_alone_are_of_the_form_3_3_3(rng):
    """With another beta; a set of that form has the origin inside, which is not so where the offset is larger."""
    r, beta, y = rng.uniform(0.1, 2.0, 6), 1.6, rng.standard_normal((500, 6))
    Q, c = np.diag(r**-2.0), 0.3 * r * rng.uniform(-1.0, 1.0, 6)
    quadratic = ng.TaskEllipsoid.from_quadratic(Q, -2.0 * Q @ c, np.sqrt(beta**2 - c @ Q @ c))
    np.testing.assert_allclose(ng.TaskEllipsoid(beta * r, c).support(y)[0], quadratic.support(y)[0])
    assert np.min(quadratic.support(y)[0]) > 0.0
    offset = beta * r * [2.0, 0, 0, 0, 0, 0]
    assert ng.TaskEllipsoid(beta * r, offset).support(-offset[None])[0][0] < 0.0


def test_the_printed_support_is_that_of_half_the_quadratic_form(rng):
    """(3.4-4), by hand; that of (3.3-3) is less in every direction (docs/corrections.md)."""
    root, a, beta = rng.standard_normal((6, 6)), rng.standard_normal(6), 1.3
    Q, y = root @ root.T + 0.1 * np.eye(6), rng.standard_normal((50, 6))
    inverse = np.linalg.inv(Q)
    sigma = 0.5 * a @ inverse @ a + beta**2
    printed = -y @ inverse @ a + np.sqrt(2.0 * sigma * np.einsum("mi,ij,mj->m", y, inverse, y))
    np.testing.assert_allclose(ng.TaskEllipsoid.from_quadratic(Q / 2.0, a, beta).support(y)[0], printed)
    assert np.all(ng.TaskEllipsoid.from_quadratic(Q, a, beta).support(y)[0] < printed)


def test_units_far_apart_are_still_positive_definite():
    task = ng.TaskEllipsoid.from_quadratic(np.diag([1e-4] * 3 + [1e8, 1e8, 1e9]))
    assert np.linalg.norm(task.axes, axis=1).max() == pytest.approx(100.0)


def test_axes_are_rows_with_length():
    task = ng.TaskEllipsoid([1.0, 2.0, 0.0], center=[0.0, 0.5, 0.0])
    np.testing.assert_array_equal(task.axes, np.diag([1.0, 2.0, 0.0]))
    assert not task.is_centred
    assert task.dimension == 3


def test_flat_ellipsoid_has_no_reach_across():
    task = ng.TaskEllipsoid([1.0, 1.0, 0.0])
    assert task.support(np.array([[0.0, 0.0, 1.0]]))[0][0] == 0.0


def test_json_round_trip_is_exact(rng):
    task = ng.TaskEllipsoid(rng.uniform(0.1, 1.0, 6), rng.standard_normal(6))
    assert ng.TaskEllipsoid.from_dict(task.to_dict()) == task


def test_frozen():
    task = ng.TaskEllipsoid([1.0] * 3)
    with pytest.raises(ValueError, match="read-only"):
        task.axes[0, 0] = 2.0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ng.TaskEllipsoid([0.0] * 6), r"TaskEllipsoid\.semi_axes: .* not all of them 0"),
        (lambda: ng.TaskEllipsoid([1.0, -1.0, 1.0]), "at least 0"),
        (lambda: ng.TaskEllipsoid([1.0] * 4), r"3 \(planar\) or 6"),
        (lambda: ng.TaskEllipsoid([1.0] * 6, center=[0.0] * 3), r"TaskEllipsoid\.center: got shape \(3,\)"),
        (lambda: ng.TaskEllipsoid([1.0] * 3, directions=np.ones((3, 3))), "off orthonormal"),
        (lambda: ng.TaskEllipsoid([1.0, float("nan"), 1.0]), "finite numbers"),
        (lambda: ng.TaskEllipsoid.from_quadratic(np.eye(4)), "3 x 3"),
        (lambda: ng.TaskEllipsoid.from_quadratic(np.diag([1.0, 1.0, 0.0])), "positive definite"),
        (lambda: ng.TaskEllipsoid.from_quadratic(np.diag([1.0, 1.0, -1.0])), "positive definite"),
        (lambda: ng.TaskEllipsoid.from_quadratic([[1, 1, 0], [0, 1, 0], [0, 0, 1]]), "off symmetric by 1"),
        (lambda: ng.TaskEllipsoid.from_quadratic(np.eye(3), beta=0.0), r"TaskEllipsoid\.beta"),
        (lambda: ng.TaskEllipsoid.from_quadratic(np.eye(3), a=[1.0]), r"TaskEllipsoid\.a"),
    ],
)
def test_bad_tasks_are_refused(make, message):
    with pytest.raises(ng.InputError, match=message):
        make()
