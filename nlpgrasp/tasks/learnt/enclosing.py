"""Enclosing ellipsoids of wrenches: minimum-volume or from a covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaincinv

from nlpgrasp.common.shown.said import warn
from nlpgrasp.common.shown.words import COMPONENTS
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.learnt.columns import columns_of, scales_of, states_units
from nlpgrasp.tasks.learnt.local import FLAT, Local
from nlpgrasp.tasks.learnt.min_volume import MinVolume, levels, min_volume_ellipsoid
from nlpgrasp.tasks.learnt.table import table_of

GAP = 1e-6  # certified relative excess of volume
SWEEPS = 50  # most trimming iterations
SHRINKS = 2e-3  # relative decrease of volume below which trimming stops
MOST_NAMED = 10  # rows listed in a message
NEAR = 1e-9  # relative tolerance of containment


@dataclass(frozen=True)
class Enclosing:
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
    inside: NDArray[np.bool_]
    gap: float | None
    flat: FloatArray


def enclose(
    wrenches: ArrayLike, outliers: float, probability: float | None, center: ArrayLike | None, gap: float
) -> Enclosing:
    """Return the minimum-volume or covariance ellipsoid of wrenches; see ``fit_ellipsoid``."""
    rows = wrench_rows(wrenches)
    outliers = number("outliers", outliers, at_least=0.0)
    gap = number("gap", gap, above=0.0)
    if outliers >= 0.5:
        raise InputError("outliers", outliers, "a share below 0.5")
    if probability is not None and (not 0.0 < number("probability", probability) < 1.0 or outliers > 0.0):
        raise InputError("probability", probability, "a share between 0 and 1, without outliers")
    middle = None if center is None else array("center", center, (rows.shape[1],))
    local = Local.of(rows, middle)
    if len(local.flat):
        warn(flat_words(local.flat))
    excess: float | None = None
    if probability is None:
        found = trimmed(local.points, outliers, gap, middle is not None)
        offset, axes, excess = found.center, found.axes, found.gap
        if found.gap > gap:
            text = f"the ellipsoid's volume is only known to be within {found.gap:.2g} of the least, not {gap:.2g}"
            warn(text)
    else:
        offset, axes = _covariance(local.points, probability, middle is not None)
    level = levels(local.points, offset, axes)
    return Enclosing(
        local.outward(offset),
        local.outward_axes(axes),
        level <= 1.0 + NEAR,
        excess,
        local.flat,
    )


def _covariance(local: FloatArray, probability: float, centred: bool) -> tuple[FloatArray, FloatArray]:
    """Return centre and axes of the covariance ellipsoid that contains a given share of normal points."""
    values, vectors = np.linalg.eigh(local.T @ local / max(len(local) - (not centred), 1))
    quantile = 2.0 * gammaincinv(0.5 * local.shape[1], probability)  # of chi squared; scipy.stats is slow to import
    return np.zeros(local.shape[1]), np.sqrt(quantile * values)[:, None] * vectors.T


def trimmed(local: FloatArray, outliers: float, gap: float, centred: bool) -> MinVolume:
    """Return the minimum-volume ellipsoid around all points but a share of outliers."""
    keep = len(local) - int(outliers * len(local))
    center = np.zeros(local.shape[1]) if centred else None
    chosen = np.arange(len(local))
    if keep < len(local):
        away = local if centred else local - np.median(local, axis=0)
        for _ in range(SWEEPS):  # concentration steps: keep the points nearest in Mahalanobis distance
            far = np.einsum("ij,jk,ik->i", away, np.linalg.pinv(away[chosen].T @ away[chosen]), away)
            nearest = np.sort(np.argsort(far, kind="stable")[:keep])
            if np.array_equal(nearest, chosen):
                break
            chosen = nearest
            away = local if centred else local - local[chosen].mean(axis=0)
        least = np.inf
        for _ in range(SWEEPS):  # the same with the minimum-volume ellipsoid, while it shrinks
            found = min_volume_ellipsoid(_spanning(local[chosen], centred), max(gap, 1e-3), center)
            volume = float(np.prod(np.linalg.norm(found.axes, axis=1)))
            if volume > (1.0 - SHRINKS) * least:
                break
            least = volume
            far = levels(local, found.center, found.axes)
            nearest = np.sort(np.argsort(far, kind="stable")[:keep])
            if np.array_equal(nearest, chosen):
                break
            chosen = nearest
    return min_volume_ellipsoid(_spanning(local[chosen], centred), gap, center)


def _spanning(kept: FloatArray, centred: bool) -> FloatArray:
    """Return the kept points; raise if they no longer span their space."""
    away = kept if centred else kept - kept.mean(axis=0)
    sizes = np.linalg.svd(np.linalg.qr(away, mode="r"))[1]
    if len(sizes) < kept.shape[1] or sizes[-1] <= FLAT * sizes[0]:
        given = f"a share that leaves {len(kept)} wrenches, which do not differ in every direction"
        raise InputError("outliers", given, "fewer outliers, or more wrenches that differ")
    return kept


def wrench_rows(wrenches: ArrayLike) -> FloatArray:
    """Return wrenches as a validated array (m, d).

    Columns of a pandas frame are identified by name, in newtons and newton-metres unless they state units.
    """
    if hasattr(wrenches, "columns"):
        wrenches = _of_frame(wrenches)
    try:
        if np.asarray(wrenches).dtype.kind not in "iuf":
            raise TypeError
        given = np.asarray(wrenches, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise InputError("wrenches", wrenches, "numbers of shape (m, 3) or (m, 6)") from None
    if given.ndim != 2 or given.shape[1] not in (3, 6) or not len(given):
        raise InputError("wrenches", f"shape {given.shape}", "shape (m, 3) or (m, 6), at least one wrench")
    bad = np.flatnonzero(~np.all(np.isfinite(given), axis=1))
    if len(bad):
        raise InputError("wrenches", bad_rows(bad), "finite numbers in every row")
    return array("wrenches", given, (None, None))


def _of_frame(frame: object) -> FloatArray:
    """Return the wrenches of a pandas frame, (m, d)."""
    table = table_of("wrenches", frame)
    if table.header is None:
        return table.numbers(list(range(table.width)))
    size = 3 if table.width == 3 else 6
    chosen = columns_of(table.header, None, table.width, table.name, size)
    stated = states_units(table.header, chosen)
    return table.numbers(chosen) * scales_of(table.header, chosen, None if stated else ("N", "Nm"), table.name)


def bad_rows(rows: NDArray[np.intp]) -> str:
    """Return the text of a message about rows that are not finite."""
    named = ", ".join(map(str, rows[:MOST_NAMED])) + (", ..." if len(rows) > MOST_NAMED else "")
    return f"{len(rows)} row{'s' * (len(rows) > 1)} with NaN or infinity ({named})"


def flat_words(flat: FloatArray) -> str:
    """Return a warning about directions along which the wrenches are constant."""
    names = COMPONENTS[flat.shape[1]]
    words = []
    for row in flat:
        parts = [f"{v:+.2g} {n}" for v, n in zip(row, names, strict=True) if abs(v) > 1e-3]
        words.append(parts[0].split(" ")[1] if len(parts) == 1 else " ".join(parts))
    return f"the wrenches do not differ along {'; '.join(words)} (over their extents): the ellipsoid is flat there"
