"""Enclosing ellipsoids: closed forms, an independent optimiser, containment, invalid input."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import chi2

import nlpgrasp as ng
from nlpgrasp.tasks.enclosing_ellipsoid import min_volume_ellipsoid
from tests.samples import random_rotation


def excess(task, wrenches):
    """Return the largest ``|L^-1 (w - c)|`` less one."""
    local = np.linalg.lstsq(task.axes.T, (wrenches - task.center).T, rcond=None)[0]
    return float(np.max(np.linalg.norm(local, axis=0))) - 1.0


def volume(axes):
    return float(np.prod(np.linalg.svd(axes)[1]))


SETS = {
    "normal": lambda rng: rng.standard_normal((4000, 6)),
    "heavy tails": lambda rng: rng.standard_t(2, (4000, 6)),
    "sphere": lambda rng: (x := rng.standard_normal((4000, 6))) / np.linalg.norm(x, axis=1)[:, None],
    "ball": lambda rng: SETS["sphere"](rng) * rng.uniform(0, 1, (4000, 1)) ** (1 / 6),
    "grid": lambda rng: rng.integers(-2, 3, (4000, 6)).astype(float),
    "units": lambda rng: rng.standard_normal((4000, 6)) * [10, 20, 5, 1e-3, 1e-2, 1e-4] + [100, 0, 0, 0, 1, 0],
    "planar": lambda rng: rng.standard_normal((4000, 3)) * [1, 5, 0.01],
    "few": lambda rng: rng.standard_normal((8, 6)),
}


@pytest.mark.parametrize("center", [False, True], ids=["free", "centred"])
@pytest.mark.parametrize("name", SETS)
def test_every_point_is_inside_at_the_gap(name, center, rng):
    wrenches = SETS[name](rng)
    fit = ng.fit_ellipsoid(wrenches, center=np.zeros(wrenches.shape[1]) if center else None)
    assert excess(fit.task, wrenches) <= 1e-9
    assert fit.gap <= 1e-6
    assert fit.inside.all()
    assert fit.task.is_centred == center


def test_the_corners_of_a_box(rng):
    """Least ellipsoid around the corners of a box: semi-axes sqrt(d) times the half sides; (3.3-3) by symmetry."""
    half, middle = rng.uniform(0.5, 2.0, 6), rng.standard_normal(6)
    corners = middle + half * np.array(np.meshgrid(*[[1, -1]] * 6)).reshape(6, -1).T
    task = ng.TaskEllipsoid.fit(corners)
    np.testing.assert_allclose(task.center, middle, atol=1e-6)
    np.testing.assert_allclose(task.axes.T @ task.axes, np.diag(6.0 * half**2), atol=1e-4)


def test_the_ends_of_axes_and_any_linear_image(rng):
    """A cross-polytope's is the ellipsoid through its ends, and the least ellipsoid of an image is the image."""
    lengths, turn = rng.uniform(0.5, 2.0, 6), random_rotation(rng, 6)
    ends = np.concatenate([np.diag(lengths), -np.diag(lengths)]) @ turn.T
    task = ng.TaskEllipsoid.fit(ends)
    np.testing.assert_allclose(task.axes.T @ task.axes, turn @ np.diag(lengths**2) @ turn.T, atol=1e-5)


def test_the_volume_is_that_of_another_optimiser(rng):
    """Least volume in dimension 3 by SLSQP over centre and Cholesky factor of the inverse."""
    points = rng.standard_normal((40, 3)) * [1.0, 2.0, 0.5]
    lower = np.tril_indices(3)

    def factor(x):
        L = np.zeros((3, 3))
        L[lower] = x[3:]
        return L

    def slack(x):
        return 1.0 - np.sum(((points - x[:3]) @ factor(x)) ** 2, axis=1)

    start = np.concatenate([np.zeros(3), 0.2 * np.eye(3)[lower]])
    result = minimize(
        lambda x: -np.sum(np.log(np.abs(np.diag(factor(x))))),
        start,
        constraints={"type": "ineq", "fun": slack},
        method="SLSQP",
        options={"maxiter": 500, "ftol": 1e-12},
    )
    task = ng.TaskEllipsoid.fit(points)
    assert volume(task.axes) == pytest.approx(np.exp(result.fun), rel=1e-5)


def test_the_stated_gap_is_a_bound(rng):
    points = rng.standard_normal((500, 6))
    rough, fine = (min_volume_ellipsoid(points, gap) for gap in (0.3, 1e-9))
    ratio = volume(rough.axes) / volume(fine.axes)
    assert 1.0 - 1e-9 <= ratio <= (1.0 + rough.gap) * (1.0 + 1e-8)
    assert rough.gap <= 0.3


def test_outliers_are_left_out(rng):
    inliers = rng.standard_normal((2000, 6))
    outliers = 30.0 + rng.standard_normal((40, 6))
    fit = ng.fit_ellipsoid(np.concatenate([inliers, outliers]), outliers=0.03)
    assert not fit.inside[2000:].any()
    assert fit.inside[:2000].mean() >= 0.985
    assert fit.share >= 0.97
    expected = ng.fit_ellipsoid(inliers)
    assert volume(fit.task.axes) < volume(expected.task.axes)


def test_the_ellipsoid_of_a_probability(rng):
    spread = np.diag([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
    wrenches = rng.standard_normal((60_000, 6)) @ spread + 1.0
    fit = ng.fit_ellipsoid(wrenches, probability=0.9)
    np.testing.assert_allclose(fit.task.axes.T @ fit.task.axes / chi2.ppf(0.9, 6), spread**2, atol=0.15)
    assert fit.share == pytest.approx(0.9, abs=0.005)
    assert fit.gap is None


def test_flat_recordings_say_which_directions_are_missing(rng):
    wrenches = rng.standard_normal((300, 6)) * [1, 1, 1, 1, 1, 0]
    with pytest.warns(UserWarning, match="do not differ along m_z"):
        fit = ng.fit_ellipsoid(wrenches)
    assert len(fit.task.axes) == 5
    assert np.all(fit.task.axes[:, 5] == 0.0)
    assert excess(fit.task, wrenches) <= 1e-9


def test_too_few_wrenches_make_a_flat_ellipsoid(rng):
    wrenches = rng.standard_normal((4, 6))
    with pytest.warns(UserWarning, match="the ellipsoid is flat"):
        fit = ng.fit_ellipsoid(wrenches)
    assert len(fit.task.axes) == 3
    assert excess(fit.task, wrenches) <= 1e-9
    offset = (wrenches - fit.task.center) - (wrenches - fit.task.center) @ np.linalg.pinv(fit.task.axes) @ fit.task.axes
    assert np.max(np.abs(offset)) <= 1e-9


@pytest.mark.parametrize("value", [9.81, -6.1, 0.1, 1000.1])
def test_a_component_that_never_changes(value, rng):
    wrenches = rng.standard_normal((1001, 6)) * [1e-2, 1e-2, 0, 1e-4, 1e-4, 1e-4]
    wrenches[:, 2] = value
    with pytest.warns(UserWarning, match="do not differ along f_z"):
        fit = ng.fit_ellipsoid(wrenches)
    assert len(fit.task.axes) == 5
    assert fit.gap <= 1e-6
    assert fit.task.center[2] == pytest.approx(value, rel=1e-12)
    assert excess(fit.task, wrenches) <= 1e-9


def test_units_far_apart(rng):
    wrenches = rng.standard_normal((500, 6)) * [1e7, 1e7, 1e7, 1e-6, 1e-6, 1e-6]
    fit = ng.fit_ellipsoid(wrenches)
    assert len(fit.task.axes) == 6
    assert excess(fit.task, wrenches) <= 1e-6


def test_outliers_that_leave_too_little():
    idle = 0.1 * np.random.default_rng(0).standard_normal((200, 6))
    idle[:140] = 0.0
    with pytest.raises(ng.InputError, match="do not differ in every direction"):
        ng.fit_ellipsoid(idle, outliers=0.35)


@pytest.mark.parametrize(
    ("wrenches", "options", "message"),
    [
        (np.ones((5, 6)), {}, "wrenches that differ"),
        (np.full((3, 6), 0.1), {}, "wrenches that differ"),
        (np.eye(6) * 1j, {}, "numbers"),
        ([["1", "2", "3"]], {}, "numbers"),
        (np.zeros((0, 6)), {}, "at least one wrench"),
        (np.ones((5, 4)), {}, r"shape \(m, 3\) or \(m, 6\)"),
        ([[1, 2, "x", 0, 0, 0]], {}, "numbers"),
        ([[np.nan] * 6, [1.0] * 6, [np.inf] * 6], {}, r"2 rows with NaN or infinity \(0, 2\)"),
        (np.eye(6), {"outliers": 0.7}, "below 0.5"),
        (np.eye(6), {"probability": 1.0}, "between 0 and 1"),
        (np.eye(6), {"probability": 0.5, "outliers": 0.1}, "without outliers"),
        (np.eye(6), {"center": [0.0]}, "center"),
        (np.eye(6), {"gap": 0.0}, "gap"),
    ],
)
def test_bad_input_is_one_sentence(wrenches, options, message):
    with pytest.raises(ng.InputError, match=message) as caught:
        ng.fit_ellipsoid(wrenches, **options)
    assert "\n" not in str(caught.value)


def test_a_warning_names_the_line_that_asked(rng):
    flat = np.c_[rng.standard_normal((50, 5)), np.zeros(50)]
    for ask in (lambda: ng.fit_ellipsoid(flat), lambda: ng.TaskEllipsoid.fit(flat)):
        with pytest.warns(UserWarning, match="do not differ along m_z") as caught:
            ask()
        assert caught[0].filename == __file__
