"""Updatable fits of task libraries: containment of every wrench, and volume against a fit of all."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

import nlpgrasp as ng
from nlpgrasp.tasks.enclosing_ellipsoid import MinVolumeEllipsoid
from nlpgrasp.tasks.library.outer_ellipsoid import InnerEllipsoid, farthest_point
from nlpgrasp.tasks.library.updatable_fits import CovarianceFit, MinVolumeFit, Moments
from tests.tasks.clouds import CLOUDS

UNITS = np.array([4.0, 1.0, 9.0, 0.05, 0.2, 0.01])
BATCHES, SIZE = 8, 250


KINDS = {
    **CLOUDS,
    "flat": lambda rng, n, t: CLOUDS["flat"](rng, n, t) + np.eye(6)[2],
    "steps of a sensor": lambda rng, n, t: np.round(CLOUDS["normal"](rng, n, t), 1),
}


def batches(kind, seed):
    rng = np.random.default_rng(seed)
    return [UNITS * KINDS[kind](rng, SIZE, i / (BATCHES - 1)) for i in range(BATCHES)]


def volume(axes):
    """The volume over that of the ball, in the ellipsoid's own plane, units taken out."""
    return float(np.prod(np.linalg.svd(axes / UNITS)[1]))


def level(fit, rows):
    """Return the largest level of wrenches in the ellipsoid: 1 at its boundary."""
    local = (rows - fit.center) / UNITS @ np.linalg.pinv(fit.axes / UNITS)
    return float(np.max(np.linalg.norm(local, axis=1)))


@pytest.mark.parametrize("seed", [0, *(pytest.param(i, marks=pytest.mark.slow) for i in range(1, 10))])
@pytest.mark.parametrize("kind", KINDS)
def test_all_wrenches_are_inside_and_the_volume_is_that_of_a_fit_of_all(kind, seed):
    first, *others = batches(kind, seed)
    fit = MinVolumeFit.of(first)
    for rows in others:
        fit = fit.updated(rows)
    rows = np.concatenate([first, *others])
    assert fit.wrench_count == len(rows)
    np.testing.assert_array_equal(fit.rows, rows)
    assert level(fit, rows) <= 1.0 + 2e-9
    expected = MinVolumeFit.of(rows)
    assert len(fit.axes) == len(expected.axes)
    assert volume(fit.axes) == pytest.approx(volume(expected.axes), rel=2e-5)
    assert fit.gap <= 2e-5


def test_wrenches_inside_change_nothing(rng):
    fit = MinVolumeFit.of(UNITS * rng.standard_normal((1000, 6)))
    updated = fit.updated(fit.center + 0.3 * (fit.rows - fit.center))
    assert updated.axes is fit.axes
    assert updated.wrench_count == 2000


def test_a_flat_ellipsoid_grows_into_a_new_direction(rng):
    flat = UNITS * KINDS["flat"](rng, 500, 0.0)
    full = UNITS * rng.standard_normal((500, 6))
    fit = MinVolumeFit.of(flat)
    assert len(fit.axes) == 3
    fit = fit.updated(full)
    assert len(fit.axes) == 6
    assert level(fit, np.concatenate([flat, full])) <= 1.0 + 2e-9


def test_a_given_task_stays_inside(rng):
    """The stated ellipsoid is inside the new one, by its support function; and that is close to the least."""
    task = ng.TaskEllipsoid(2.0 * UNITS, center=UNITS)
    rows = UNITS * 3.0 * rng.standard_normal((40, 6))
    fit = MinVolumeFit.of_task(task).updated(rows)
    y = rng.standard_normal((5000, 6)) / UNITS
    assert np.all(fit.task.support(y)[0] >= task.support(y)[0] * (1.0 - 1e-9))
    assert level(fit, rows) <= 1.0 + 2e-9
    assert 0.0 < fit.gap < 3e-3
    reference = MinVolumeFit.of(np.concatenate([rows, task.boundary(sphere(rng))]))
    assert volume(reference.axes) <= volume(fit.axes) <= volume(reference.axes) * 1.05


def sphere(rng, n=20000):
    g = rng.standard_normal((n, 6))
    return g / np.linalg.norm(g, axis=1)[:, None]


def test_merging_is_a_fit_of_both(rng):
    a, b = (UNITS * (rng.standard_normal((800, 6)) + shift) for shift in (0.0, 3.0))
    merged = MinVolumeFit.of(a).merged(MinVolumeFit.of(b))
    assert merged.wrench_count == 1600
    assert volume(merged.axes) == pytest.approx(volume(MinVolumeFit.of(np.concatenate([a, b])).axes), rel=3e-5)


def test_outliers_are_removed_after_updates(rng):
    inliers = UNITS * rng.standard_normal((1980, 6))
    outliers = UNITS * (rng.standard_normal((20, 6)) + 30.0)
    fit = MinVolumeFit.of(inliers[:500]).updated(np.concatenate([outliers, inliers[500:1000]])).updated(inliers[1000:])
    assert level(fit, outliers) <= 1.0 + 2e-9
    trimmed, removed = fit.without_outliers(0.01)
    assert len(removed) == 20
    assert {tuple(row) for row in removed} == {tuple(row) for row in outliers}
    assert (trimmed.wrench_count, trimmed.forgotten) == (1980, 20)
    assert level(trimmed, inliers) <= 1.0 + 2e-9
    assert volume(trimmed.axes) == pytest.approx(volume(MinVolumeFit.of(inliers).axes), rel=3e-5)


def test_too_many_outliers_are_refused(rng):
    task = ng.TaskEllipsoid(UNITS)
    fit = MinVolumeFit.of(rng.standard_normal((900, 6)))
    with pytest.raises(ng.InputError, match=r"a share below 0\.5"):
        fit.without_outliers(0.5)
    few = replace(MinVolumeFit.of_task(task).updated(rng.standard_normal((100, 6))), unstored=800)
    with pytest.raises(ng.InputError, match=r"at most 0\.055: 100 wrenches are kept one by one"):
        few.without_outliers(0.2)


def test_the_ellipsoid_of_a_probability_is_that_of_all_at_once(rng):
    rows = UNITS * (rng.standard_normal((3000, 6)) + 5.0)
    fit = (
        CovarianceFit.of(Moments.of(rows[:10]), 0.9)
        .updated(rows[10:1500])
        .merged(CovarianceFit.of(Moments.of(rows[1500:]), 0.9))
    )
    expected = ng.fit_ellipsoid(rows, probability=0.9).task
    np.testing.assert_allclose(fit.center, expected.center, rtol=1e-12)
    np.testing.assert_allclose(fit.axes.T @ fit.axes, expected.axes.T @ expected.axes, rtol=1e-9, atol=1e-12)
    with pytest.raises(ng.InputError, match="no wrenches"):
        fit.without_outliers(0.1)


def test_moments_add_up(rng):
    a, b = rng.standard_normal((50, 6)), rng.standard_normal((70, 6)) + 9.0
    union = Moments.of(a).plus(Moments.of(b))
    np.testing.assert_allclose(union.scatter, Moments.of(np.concatenate([a, b])).scatter, rtol=1e-12)


@pytest.mark.parametrize("rank", [1, 3, 6, 8])
def test_the_farthest_point_of_an_ellipsoid_is_bounded_from_above_and_attained(rank, rng):
    ellipsoid = MinVolumeEllipsoid(rng.standard_normal(6), np.diag(rng.uniform(1.0, 3.0, 6)), 0.0)
    inner = InnerEllipsoid(rng.standard_normal(6), rng.standard_normal((rank, 6)))

    def negative_level(v):
        u = v / max(1.0, np.linalg.norm(v))
        return -float(np.linalg.norm((inner.center + u @ inner.axes - ellipsoid.center) / np.diag(ellipsoid.axes)))

    bound, point = farthest_point(inner, ellipsoid)
    best = -min(minimize(negative_level, rng.standard_normal(rank), method="BFGS").fun for _ in range(8))
    assert bound == pytest.approx(best, rel=1e-6)
    assert bound >= best * (1.0 - 1e-12)
    assert np.linalg.norm((point - ellipsoid.center) / np.diag(ellipsoid.axes)) == pytest.approx(bound, rel=1e-9)


@pytest.mark.parametrize(("center", "size"), [(0.0, 0.1), (0.0, 1.0), (0.5, 0.1), (0.5, 1.0)])
def test_the_hard_case_of_a_ball_in_a_ball(center, size):
    """No direction is the farthest where the centres are the same."""
    ellipsoid = MinVolumeEllipsoid(np.zeros(6), 2.0 * np.eye(6), 0.0)
    inner = InnerEllipsoid(center * np.eye(6)[0], size * np.eye(6))
    bound, point = farthest_point(inner, ellipsoid)
    assert bound == pytest.approx((center + size) / 2.0, rel=1e-12)
    assert np.linalg.norm(point) == pytest.approx(center + size, rel=1e-9)
