"""Enclosing ellipsoids of wrenches: minimum-volume with a certified gap, or from a covariance.

The minimum-volume ellipsoid minimises ``-ln det H`` subject to ``q_i^T H q_i <= n`` for all points q_i. Its dual is to
choose weights u >= 0 of sum one that maximise ``ln det sum_i u_i q_i q_i^T`` (D-optimal design; Khachiyan 1996,
doi:10.1287/moor.21.2.307). Few points matter: a small core set is solved by an interior-point method, and the farthest
of all points join it until none is outside (Sun and Freund 2004, doi:10.1287/opre.1040.0115). The first core set is
that of Kumar and Yildirim (2005, doi:10.1007/s10957-005-2653-6).

Forces and torques have different units, and wrenches may not span all directions: each component is divided by its
extent, and the directions along which the wrenches are constant are removed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammaincinv

from nlpgrasp.common.formatting import COMPONENTS
from nlpgrasp.common.user_warnings import warn
from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.wrench_table import columns_of, scales_of, table_of, units_of

GAP = 1e-6  # certified relative excess of volume
INSIDE = 1e-9  # relative distance beyond the ellipsoid within which a wrench counts as inside
ROUNDING = 1e-12  # relative enlargement against rounding; relative extent that counts as constant
FLAT = 1e-7  # of the largest normalised extent: directions of smaller extent are flat
MOST_NAMED = 10  # rows listed in a message
# dual weights
CORE, JOINING = 60, 60  # points of the first core set, and most added per round
ROUNDS = 200  # most rounds
IDLE, PRUNED = 1e-5, 20  # relative weight below which points leave the core set; number of rounds that prune
# interior-point method for the weights of the core set
STEPS = 100  # most steps
SHRINK, BACK_OFF = 0.15, 0.95  # factor of the complementarity per step; share of the way to the boundary
NEGLIGIBLE = 1e-9  # weight relative to the largest that counts as zero
# trimming of outliers
SWEEPS = 50  # most iterations
SHRINKS = 2e-3  # relative decrease of volume below which trimming stops (SHRINK is of the interior-point method)


def enclose(
    wrenches: ArrayLike, outliers: float, probability: float | None, center: ArrayLike | None, gap: float
) -> EnclosingEllipsoid:
    """Return the minimum-volume or covariance ellipsoid of wrenches; see ``fit_ellipsoid``."""
    rows = wrench_rows(wrenches)
    outliers = number("outliers", outliers, at_least=0.0)
    gap = number("gap", gap, above=0.0)
    if outliers >= 0.5:
        raise InputError("outliers", outliers, "a share below 0.5")
    if probability is not None:
        allowed = "a share between 0 and 1, without outliers"
        if not 0.0 < number("probability", probability) < 1.0:
            raise InputError("probability", probability, allowed)
        if outliers > 0.0:
            raise InputError("probability", probability, allowed)
    fixed_center = None if center is None else array("center", center, (rows.shape[1],))
    local = NormalisedWrenches.of(rows, fixed_center)
    if len(local.flat):
        warn(format_flat_directions(local.flat))
    excess: float | None = None
    if probability is None:
        ellipsoid = enclose_without_outliers(local.points, outliers, gap, fixed_center is not None)
        offset, axes, excess = ellipsoid.center, ellipsoid.axes, ellipsoid.gap
        if ellipsoid.gap > gap:
            text = f"the ellipsoid's volume is only known to be within {ellipsoid.gap:.2g} of the least, not {gap:.2g}"
            warn(text)
    else:
        offset, axes = _covariance(local.points, probability, fixed_center is not None)
    norms = ellipsoid_norms(local.points, offset, axes)
    return EnclosingEllipsoid(
        center=local.denormalise(offset),
        axes=local.denormalise_axes(axes),
        inside=norms <= 1.0 + INSIDE,
        gap=excess,
        flat=local.flat,
    )


@dataclass(frozen=True)
class EnclosingEllipsoid:
    """Enclosing ellipsoid ``{center + sum_j u_j axes_j, |u| <= 1}`` of wrenches.

    Parameters
    ----------
    center : (d,) array
    axes : (m, d) array
        One semi-axis per row; fewer than d for a flat ellipsoid.
    inside : (n,) bool array
        Which wrenches it contains.
    gap : float or None
        Certified relative excess of its volume over the minimum; ``None`` for a covariance.
    flat : (s, d) array
        Unit directions, components normalised by their extents, along which the wrenches are constant.
    """

    center: FloatArray
    axes: FloatArray
    inside: BoolArray
    gap: float | None
    flat: FloatArray


def _covariance(local: FloatArray, probability: float, centred: bool) -> tuple[FloatArray, FloatArray]:
    """Return centre and semi-axes of the covariance ellipsoid with the given probability of a normal distribution."""
    values, vectors = np.linalg.eigh(local.T @ local / max(len(local) - (not centred), 1))
    quantile = 2.0 * gammaincinv(0.5 * local.shape[1], probability)  # of chi squared; scipy.stats is slow to import
    return np.zeros(local.shape[1]), np.sqrt(quantile * values)[:, None] * vectors.T


def enclose_without_outliers(local: FloatArray, outliers: float, gap: float, centred: bool) -> MinVolumeEllipsoid:
    """Return the minimum-volume ellipsoid around all points but a fraction ``outliers`` of them."""
    count = len(local) - int(outliers * len(local))
    center = np.zeros(local.shape[1]) if centred else None
    inliers = np.arange(len(local))
    if count < len(local):
        deviations = local if centred else local - np.median(local, axis=0)
        for _ in range(SWEEPS):  # concentration steps: keep the points nearest in Mahalanobis distance
            distances = np.einsum(
                "ij,jk,ik->i", deviations, np.linalg.pinv(deviations[inliers].T @ deviations[inliers]), deviations
            )
            nearest = np.sort(np.argsort(distances, kind="stable")[:count])
            if np.array_equal(nearest, inliers):
                break
            inliers = nearest
            deviations = local if centred else local - local[inliers].mean(axis=0)
        least_volume = np.inf
        for _ in range(SWEEPS):  # the same with the minimum-volume ellipsoid, while it shrinks
            ellipsoid = min_volume_ellipsoid(_check_span(local[inliers], centred), max(gap, 1e-3), center)
            volume = float(np.prod(np.linalg.norm(ellipsoid.axes, axis=1)))
            if volume > (1.0 - SHRINKS) * least_volume:
                break
            least_volume = volume
            distances = ellipsoid_norms(local, ellipsoid.center, ellipsoid.axes)
            nearest = np.sort(np.argsort(distances, kind="stable")[:count])
            if np.array_equal(nearest, inliers):
                break
            inliers = nearest
    return min_volume_ellipsoid(_check_span(local[inliers], centred), gap, center)


def _check_span(points: FloatArray, centred: bool) -> FloatArray:
    """Return the points left after trimming; raise if they no longer span their space."""
    deviations = points if centred else points - points.mean(axis=0)
    sizes = np.linalg.svd(np.linalg.qr(deviations, mode="r"))[1]
    if len(sizes) < points.shape[1] or sizes[-1] <= FLAT * sizes[0]:
        message = f"a share that leaves {len(points)} wrenches, which do not differ in every direction"
        raise InputError("outliers", message, "fewer outliers, or more wrenches that differ")
    return points


@dataclass(frozen=True)
class NormalisedWrenches:
    """Wrenches in normalised coordinates: ``about + (points @ basis) * unit``.

    Parameters
    ----------
    points : (n, r) array
    about, unit : (d,) array
    basis : (r, d) array
    flat : (d - r, d) array
        The removed directions.
    """

    points: FloatArray
    about: FloatArray
    unit: FloatArray
    basis: FloatArray
    flat: FloatArray

    @classmethod
    def of(cls, rows: FloatArray, center: FloatArray | None = None) -> NormalisedWrenches:
        """Return the normalised coordinates of wrenches (n, d), about their mean or a given centre.

        Raises
        ------
        InputError
            When all wrenches are equal.
        """
        about = rows[0] + (rows - rows[0]).mean(axis=0) if center is None else center  # exact where all are the same
        extent = np.max(np.abs(rows - about), axis=0)
        varies = extent > ROUNDING * np.max(np.abs(rows), axis=0)
        if not np.any(varies):
            raise InputError("wrenches", f"{len(rows)} wrenches, all {rows[0].tolist()}", "wrenches that differ")
        unit = np.where(varies, extent, 1.0)
        scaled = np.where(varies, (rows - about) / unit, 0.0)
        _, sizes, basis = np.linalg.svd(np.linalg.qr(scaled, mode="r"))
        sizes = np.append(sizes, np.zeros(max(0, rows.shape[1] - len(sizes)))) / np.sqrt(len(rows))
        spanned = sizes > FLAT * sizes[0]
        return cls(scaled @ basis[spanned].T, about, unit, basis[spanned], basis[~spanned])

    def normalise(self, rows: FloatArray) -> FloatArray:
        """Map wrenches (n, d) to normalised coordinates (n, r)."""
        return np.asarray(((rows - self.about) / self.unit) @ self.basis.T)

    def normalise_axes(self, axes: FloatArray) -> FloatArray:
        """Map differences of wrenches (m, d) to normalised coordinates (m, r)."""
        return np.asarray((axes / self.unit) @ self.basis.T)

    def denormalise(self, point: FloatArray) -> FloatArray:
        """Map a point (r,) in normalised coordinates to a wrench (d,)."""
        return np.asarray(self.about + (point @ self.basis) * self.unit)

    def denormalise_axes(self, axes: FloatArray) -> FloatArray:
        """Map differences of points (m, r) to differences of wrenches (m, d)."""
        return np.asarray((axes @ self.basis) * self.unit)


def min_volume_ellipsoid(points: FloatArray, gap: float, center: FloatArray | None = None) -> MinVolumeEllipsoid:
    """Return the minimum-volume ellipsoid around points that span their space.

    Parameters
    ----------
    points : (m, d) array
        Well scaled: the caller normalises units.
    gap : float
        Relative excess of volume, the stopping tolerance.
    center : (d,) array, optional
        Fixed centre; free by default.
    """
    d = points.shape[1]
    lifted = np.c_[points, np.ones(len(points))] if center is None else points - center
    n = lifted.shape[1]
    weights = _dual_weights(lifted, 2.0 * gap / n * 0.9)
    if center is None:
        center = weights @ points
    deviations = points - center
    shape = (deviations * weights[:, None]).T @ deviations
    values, vectors = np.linalg.eigh(shape)
    local = (deviations @ vectors) / np.sqrt(values)
    # the radius sqrt(d) gives the weights' lower bound of the volume; the farthest point sets ours
    farthest = float(np.max(np.einsum("ij,ij->i", local, local))) * (1.0 + ROUNDING)
    axes = np.sqrt(farthest * values)[:, None] * vectors.T
    return MinVolumeEllipsoid(np.asarray(center), axes[::-1], float((farthest / d) ** (d / 2.0) - 1.0))


@dataclass(frozen=True)
class MinVolumeEllipsoid:
    """Minimum-volume ellipsoid ``{c + L u, |u| <= 1}`` around all points.

    Parameters
    ----------
    center : (d,) array
    axes : (d, d) array
        Orthogonal semi-axes, one per row.
    gap : float
        Certified: the volume is at most ``1 + gap`` times the minimum.
    """

    center: FloatArray
    axes: FloatArray
    gap: float


def ellipsoid_norms(points: FloatArray, center: FloatArray, axes: FloatArray) -> FloatArray:
    """Return the norms (m,) of points (m, d) relative to an ellipsoid: 1 on its surface, less inside.

    The norm is that for which the ellipsoid with the given center (d,) and semi-axes (d, d) is the unit ball.
    """
    return np.asarray(np.linalg.norm(np.linalg.solve(axes.T, (points - center).T), axis=0))


def _dual_weights(q: FloatArray, tolerance: float) -> FloatArray:
    """Return the dual weights (m,) of points (m, n), optimal within a relative tolerance.

    All ``q_i^T M^-1 q_i`` are at most ``n (1 + tolerance)`` for ``M = sum_i u_i q_i q_i^T``.
    """
    n = q.shape[1]
    independent = _independent_points(q)
    outermost = np.argsort(-_quadratic_forms(q, np.asarray(np.linalg.pinv(q.T @ q / len(q)))))[:CORE]
    core = np.concatenate([independent, np.setdiff1d(outermost, independent)])
    for iteration in range(ROUNDS):
        u = _interior_point_weights(q[core], 0.3 * tolerance)
        forms = _quadratic_forms(q, _inverse(q[core], u))
        if forms.max() <= n * (1.0 + tolerance):
            break
        farthest = np.argpartition(-forms, min(JOINING, len(forms)) - 1)[:JOINING]
        joining = np.setdiff1d(farthest[forms[farthest] > n * (1.0 + 0.3 * tolerance)], core)
        core = np.concatenate([core[u > (IDLE * u.max() if iteration < PRUNED else 0.0)], joining])
    result = np.zeros(len(q))
    result[core] = u
    return np.asarray(result / result.sum())


def _quadratic_forms(q: FloatArray, inner: FloatArray) -> FloatArray:
    """Return the quadratic form ``q_i^T inner q_i`` of each point, (m,), for points (m, n)."""
    return np.asarray(np.einsum("ij,ij->i", q @ inner, q))


def _independent_points(q: FloatArray) -> IntArray:
    """Return the indices of n linearly independent points among points (m, n).

    Each is the point farthest from the span of those before.
    """
    residuals = q.copy()
    indices = []
    for _ in range(q.shape[1]):
        indices.append(int(np.argmax(np.einsum("ij,ij->i", residuals, residuals))))
        direction = residuals[indices[-1]] / np.linalg.norm(residuals[indices[-1]])
        residuals -= np.outer(residuals @ direction, direction)
    return np.array(indices)


def _interior_point_weights(q: FloatArray, tolerance: float) -> FloatArray:
    """Return the optimal dual weights of a few points by a primal-dual interior-point method.

    ``min -ln det M + n sum u_i`` with ``M = sum u_i q_i q_i^T`` over u >= 0 has the optimality conditions
    ``w_i(u) + s_i = n`` and ``u_i s_i = 0`` with ``w_i = q_i^T M^-1 q_i``, whose derivative by u_j is
    ``-(q_i^T M^-1 q_j)^2``.
    """
    m, n = q.shape
    u, slack = np.full(m, 1.0 / m), np.full(m, float(n))
    for _ in range(STEPS):
        cross = q @ _inverse(q, u) @ q.T
        w = np.diag(cross)
        if np.max(w) * u.sum() <= n * (1.0 + tolerance):  # the largest w_i of weights with sum one
            break
        barrier = SHRINK * float(u @ slack) / m  # barrier parameter: u_i s_i = barrier
        system = cross**2 + np.diag(slack / u)
        step = np.linalg.solve(system, w - n + barrier / u)
        slack_step = (barrier - slack * step) / u - slack
        step_size = min(1.0, BACK_OFF / max(1e-300, float(np.max(-step / u)), float(np.max(-slack_step / slack))))
        u, slack = u + step_size * step, slack + step_size * slack_step
    u = np.where(u > NEGLIGIBLE * u.max(), u, 0.0)
    return np.asarray(u / u.sum())


def _inverse(q: FloatArray, u: FloatArray) -> FloatArray:
    """Return the inverse of ``sum_i u_i q_i q_i^T``."""
    return np.asarray(np.linalg.inv((q * u[:, None]).T @ q))


def wrench_rows(wrenches: ArrayLike) -> FloatArray:
    """Return wrenches as a validated array (m, d).

    Columns of a pandas frame are identified by name, in newtons and newton-metres unless they state units.
    """
    if hasattr(wrenches, "columns"):
        wrenches = _read_frame(wrenches)
    try:
        if np.asarray(wrenches).dtype.kind not in "iuf":
            raise TypeError
        rows = np.asarray(wrenches, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise InputError("wrenches", wrenches, "numbers of shape (m, 3) or (m, 6)") from None
    if rows.ndim != 2 or rows.shape[1] not in (3, 6) or not len(rows):
        raise InputError("wrenches", f"shape {rows.shape}", "shape (m, 3) or (m, 6), at least one wrench")
    invalid = np.flatnonzero(~np.all(np.isfinite(rows), axis=1))
    if len(invalid):
        raise InputError("wrenches", format_invalid_rows(invalid), "finite numbers in every row")
    return array("wrenches", rows, (None, None))


def _read_frame(frame: object) -> FloatArray:
    """Return the wrenches of a pandas frame, (m, d)."""
    table = table_of("wrenches", frame)
    if table.header is None:
        return table.numbers(list(range(table.width)))
    size = 3 if table.width == 3 else 6
    columns = columns_of(table.header, None, table.width, table.name, size)
    is_stated = any(unit is not None for unit in table.stated_units(columns))
    units = units_of(table, columns, None if is_stated else ("N", "Nm"))
    return table.numbers(columns) * scales_of(units)


def format_invalid_rows(rows: IntArray) -> str:
    """Return the text of a message about rows that are not finite."""
    indices = ", ".join(map(str, rows[:MOST_NAMED])) + (", ..." if len(rows) > MOST_NAMED else "")
    return f"{len(rows)} row{'s' * (len(rows) > 1)} with NaN or infinity ({indices})"


def format_flat_directions(flat: FloatArray) -> str:
    """Return a warning about directions along which the wrenches are constant."""
    names = COMPONENTS[flat.shape[1]]
    directions = []
    for row in flat:
        parts = [f"{v:+.2g} {n}" for v, n in zip(row, names, strict=True) if abs(v) > 1e-3]
        directions.append(parts[0].split(" ")[1] if len(parts) == 1 else " ".join(parts))
    return f"the wrenches do not differ along {'; '.join(directions)} (over their extents): the ellipsoid is flat there"
