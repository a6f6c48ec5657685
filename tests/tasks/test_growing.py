"""Ellipsoids that grow with recordings: they hold every wrench ever given, and stay as small as a fit of all."""

import numpy as np
import pytest
from scipy.optimize import minimize

import nlpgrasp as ng
from nlpgrasp.tasks import growing_ellipsoids as least_volume
from nlpgrasp.tasks.ellipsoid_covers import Shape, farthest
from nlpgrasp.tasks.enclosing_ellipsoid import MinVolume
from nlpgrasp.tasks.growing_ellipsoids import LeastVolume, Moments, Normal
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


def level(learnt, rows):
    """How far the wrenches are out, the farthest of them: 1 at the boundary."""
    local = (rows - learnt.center) / UNITS @ np.linalg.pinv(learnt.axes / UNITS)
    return float(np.max(np.linalg.norm(local, axis=1)))


@pytest.mark.parametrize("seed", [0, *(pytest.param(i, marks=pytest.mark.slow) for i in range(1, 10))])
@pytest.mark.parametrize("kind", KINDS)
def test_all_wrenches_ever_given_are_inside_and_the_volume_is_that_of_a_fit_of_all(kind, seed, monkeypatch):
    """With room for 1200 of 2000 wrenches, so that most of them are only known by covers in the end."""
    monkeypatch.setattr(least_volume, "MOST", 1200)
    monkeypatch.setattr(least_volume, "LEAST", 600)
    first, *more = batches(kind, seed)
    learnt = LeastVolume.of(first)
    for rows in more:
        learnt = learnt.updated(rows)
    rows = np.concatenate([first, *more])
    assert learnt.wrenches == len(rows)
    assert level(learnt, rows) <= 1.0 + 2e-9
    if kind != "steps of a sensor":
        assert len(learnt.covers) > 0
        assert len(learnt.kept) <= 1200
    found = LeastVolume.of(rows)
    assert len(learnt.axes) == len(found.axes)
    excess = volume(learnt.axes) / volume(found.axes) - 1.0
    assert excess <= learnt.gap + 1e-5
    assert excess <= 0.01
    assert learnt.gap <= 0.02


def test_nothing_is_lost_while_there_is_room(rng):
    rows = UNITS * rng.standard_normal((3000, 6))
    learnt = LeastVolume.of(rows[:1000]).updated(rows[1000:2000]).updated(rows[2000:])
    np.testing.assert_array_equal(learnt.kept, rows)
    assert learnt.covers == ()
    assert volume(learnt.axes) == pytest.approx(volume(ng.fit_ellipsoid(rows).task.axes), rel=2e-5)
    assert learnt.gap <= 2e-5


def test_wrenches_inside_change_nothing(rng):
    learnt = LeastVolume.of(UNITS * rng.standard_normal((1000, 6)))
    again = learnt.updated(learnt.center + 0.3 * (learnt.kept - learnt.center))
    assert again.axes is learnt.axes
    assert again.wrenches == 2000


def test_a_flat_ellipsoid_grows_into_a_new_direction(rng):
    flat = UNITS * KINDS["flat"](rng, 500, 0.0)
    full = UNITS * rng.standard_normal((500, 6))
    learnt = LeastVolume.of(flat)
    assert len(learnt.axes) == 3
    learnt = learnt.updated(full)
    assert len(learnt.axes) == 6
    assert level(learnt, np.concatenate([flat, full])) <= 1.0 + 2e-9


def test_a_stated_task_is_taken_in_beside_what_is_learnt(rng):
    """The stated ellipsoid is inside the new one, by its support function; and that is close to the least."""
    task = ng.TaskEllipsoid(2.0 * UNITS, center=UNITS)
    rows = UNITS * 3.0 * rng.standard_normal((40, 6))
    learnt = LeastVolume.of_task(task).updated(rows)
    y = rng.standard_normal((5000, 6)) / UNITS
    assert np.all(learnt.task.support(y)[0] >= task.support(y)[0] * (1.0 - 1e-9))
    assert level(learnt, rows) <= 1.0 + 2e-9
    assert 0.0 < learnt.gap < 3e-3
    near = LeastVolume.of(np.concatenate([rows, task.boundary(sphere(rng))]))
    assert volume(near.axes) <= volume(learnt.axes) <= volume(near.axes) * 1.05


def sphere(rng, n=20000):
    g = rng.standard_normal((n, 6))
    return g / np.linalg.norm(g, axis=1)[:, None]


def test_merging_is_a_fit_of_both(rng):
    a, b = (UNITS * (rng.standard_normal((800, 6)) + shift) for shift in (0.0, 3.0))
    merged = LeastVolume.of(a).merged(LeastVolume.of(b))
    assert merged.wrenches == 1600
    assert volume(merged.axes) == pytest.approx(volume(LeastVolume.of(np.concatenate([a, b])).axes), rel=3e-5)


@pytest.mark.parametrize("room", [5000, 700])
def test_outliers_are_forgotten_also_after_others_have_gone(room, rng, monkeypatch):
    monkeypatch.setattr(least_volume, "MOST", room)
    monkeypatch.setattr(least_volume, "LEAST", room // 2)
    good = UNITS * rng.standard_normal((1980, 6))
    bad = UNITS * (rng.standard_normal((20, 6)) + 30.0)
    learnt = LeastVolume.of(good[:500]).updated(np.concatenate([bad, good[500:1000]])).updated(good[1000:])
    assert level(learnt, bad) <= 1.0 + 2e-9
    left, out = learnt.without_outliers(0.01)
    assert len(out) == 20
    assert {tuple(row) for row in out} == {tuple(row) for row in bad}
    assert (left.wrenches, left.forgotten) == (1980, 20)
    assert level(left, good) <= 1.0 + 2e-9
    least = volume(LeastVolume.of(good).axes)
    excess = volume(left.axes) / least - 1.0
    assert excess <= left.gap + 1e-5
    assert excess <= (3e-5 if room == 5000 else 1.0)  # covers were made while the outliers were in: the gap says so
    np.testing.assert_allclose(left.moments.mean, good.mean(axis=0), atol=1e-10)


def test_too_many_outliers_are_refused(rng, monkeypatch):
    monkeypatch.setattr(least_volume, "MOST", 200)
    monkeypatch.setattr(least_volume, "LEAST", 100)
    learnt = LeastVolume.of(rng.standard_normal((900, 6)))
    with pytest.raises(ng.InputError, match=r"at most 0\.055: 100 wrenches are kept one by one"):
        learnt.without_outliers(0.2)
    with pytest.raises(ng.InputError, match=r"a share below 0\.5"):
        learnt.without_outliers(0.5)


def test_the_ellipsoid_of_a_probability_is_that_of_all_at_once(rng):
    rows = UNITS * (rng.standard_normal((3000, 6)) + 5.0)
    learnt = (
        Normal.of(Moments.of(rows[:10]), 0.9).updated(rows[10:1500]).merged(Normal.of(Moments.of(rows[1500:]), 0.9))
    )
    whole = ng.fit_ellipsoid(rows, probability=0.9).task
    np.testing.assert_allclose(learnt.center, whole.center, rtol=1e-12)
    np.testing.assert_allclose(learnt.axes.T @ learnt.axes, whole.axes.T @ whole.axes, rtol=1e-9, atol=1e-12)
    with pytest.raises(ng.InputError, match="no wrenches"):
        learnt.without_outliers(0.1)


def test_moments_add_up_and_come_apart(rng):
    a, b = rng.standard_normal((50, 6)), rng.standard_normal((70, 6)) + 9.0
    both = Moments.of(a).plus(Moments.of(b))
    np.testing.assert_allclose(both.scatter, Moments.of(np.concatenate([a, b])).scatter, rtol=1e-12)
    left = both.minus(Moments.of(b))
    np.testing.assert_allclose(left.scatter, Moments.of(a).scatter, rtol=1e-9, atol=1e-9)
    assert left.count == 50


@pytest.mark.parametrize("rank", [1, 3, 6, 8])
def test_how_far_a_cover_reaches_is_bounded_from_above_and_attained(rank, rng):
    ellipsoid = MinVolume(rng.standard_normal(6), np.diag(rng.uniform(1.0, 3.0, 6)), 0.0)
    cover = Shape(rng.standard_normal(6), rng.standard_normal((rank, 6)))

    def out(v):
        u = v / max(1.0, np.linalg.norm(v))
        return -float(np.linalg.norm((cover.center + u @ cover.axes - ellipsoid.center) / np.diag(ellipsoid.axes)))

    found, point = farthest(cover, ellipsoid)
    best = -min(minimize(out, rng.standard_normal(rank), method="BFGS").fun for _ in range(8))
    assert found == pytest.approx(best, rel=1e-6)
    assert found >= best * (1.0 - 1e-12)
    assert np.linalg.norm((point - ellipsoid.center) / np.diag(ellipsoid.axes)) == pytest.approx(found, rel=1e-9)


@pytest.mark.parametrize(("center", "size"), [(0.0, 0.1), (0.0, 1.0), (0.5, 0.1), (0.5, 1.0)])
def test_the_hard_case_of_a_ball_in_a_ball(center, size):
    """No direction is the farthest where the centres are the same."""
    ellipsoid = MinVolume(np.zeros(6), 2.0 * np.eye(6), 0.0)
    cover = Shape(center * np.eye(6)[0], size * np.eye(6))
    found, point = farthest(cover, ellipsoid)
    assert found == pytest.approx((center + size) / 2.0, rel=1e-12)
    assert np.linalg.norm(point) == pytest.approx(center + size, rel=1e-9)
