"""Elliptic friction cone of a soft finger, ``|(f_t / mu, tau / mu_t)| <= f_n``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray

NEWTON, LAST = 60, 1e-9  # largest number of Newton steps; relative size of the last (convergence is quadratic)
AWAY = 1e-9  # distance kept from the multiplier 1, a removable singularity of the derivative


def project(z: FloatArray, mu: float, mu_t: float) -> FloatArray:
    """Return the Euclidean projection of ``(f_n, f_t1, f_t2, tau)`` onto the cone, (..., 4) to (..., 4)."""
    r, s = _sizes(z)
    pressing = _pressing(z[..., 0], r, s, mu, mu_t)
    tangential, torsion = _rest(z[..., 0], r, s, pressing, mu, mu_t)
    scale = tangential / np.where(r > 0.0, r, 1.0)
    result = np.empty_like(z)
    result[..., 0] = pressing
    result[..., 1:3] = z[..., 1:3] * scale[..., None]
    result[..., 3] = np.copysign(torsion, z[..., 3])
    return result


def derivative(z: FloatArray, mu: float, mu_t: float) -> FloatArray:
    """Return the Jacobian of the projection (..., 4, 4).

    On the boundary ``x = (I + t D)^-1 z`` with ``D = diag(-1, 1/mu^2, 1/mu^2, 1/mu_t^2)`` and ``<x, D x> = 0``;
    differentiating both gives ``M - M D x (M D x)^T / <D x, M D x>`` with ``M = (I + t D)^-1``.
    """
    inside = _inside(z[..., 0], *_sizes(z), mu, mu_t)
    x = project(z, mu, mu_t)
    D = np.array([-1.0, 1.0 / mu**2, 1.0 / mu**2, 1.0 / mu_t**2])
    safe = np.where(x[..., 0] > 0.0, x[..., 0], 1.0)
    t = np.maximum(1.0 - z[..., 0] / safe, 0.0)
    t = np.where(np.abs(t - 1.0) < AWAY, 1.0 + AWAY, t)
    M = 1.0 / (1.0 + t[..., None] * D)
    bent = M * D * x
    bottom = np.sum(D * x * bent, axis=-1)
    boundary = (
        np.eye(4) * M[..., None]
        - bent[..., :, None] * bent[..., None, :] / np.where(bottom != 0.0, bottom, 1.0)[..., None, None]
    )
    result = np.where(inside[..., None, None], np.eye(4), boundary)
    return np.asarray(np.where((x[..., 0] > 0.0)[..., None, None], result, 0.0))


def extreme(z: FloatArray, mu: float, mu_t: float) -> tuple[FloatArray, FloatArray]:
    """Return the support ``max(0, z_n + |(mu z_t, mu_t z_tau)|)`` of ``z`` (..., 4), and a maximiser (..., 4)."""
    r, s = _sizes(z)
    size = np.hypot(mu * r, mu_t * s)
    value = z[..., 0] + size
    safe = np.where(size > 0.0, size, 1.0)
    force = np.empty_like(z)
    force[..., 0] = 1.0
    force[..., 1:3] = z[..., 1:3] * (mu**2 / safe)[..., None]
    force[..., 3] = z[..., 3] * (mu_t**2 / safe)
    pays = value > 0.0
    return np.where(pays, value, 0.0), force * pays[..., None]


def _sizes(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    return np.hypot(z[..., 1], z[..., 2]), np.abs(z[..., 3])


def _inside(z: FloatArray, r: FloatArray, s: FloatArray, mu: float, mu_t: float) -> NDArray[np.bool_]:
    """Return where a force is in the cone."""
    return np.asarray(np.hypot(r / mu, s / mu_t) <= z)


def _pressing(z: FloatArray, r: FloatArray, s: FloatArray, mu: float, mu_t: float) -> FloatArray:
    """Return the normal force of the projection onto ``{(r/mu)^2 + (s/mu_t)^2 <= n^2, n >= 0}``.

    Over the cone's boundary points ``n (1, mu cos a, mu_t sin a)`` the best n for a given a is
    ``(z + mu r cos a + mu_t s sin a) / (1 + mu^2 cos^2 a + mu_t^2 sin^2 a)``. With the multiplier t of the
    cone constraint, n solves ``n^2 = (r mu / (mu^2 + t))^2 + (s mu_t / (mu_t^2 + t))^2``, ``n (1 - t) = z``. With
    u = t for z > 0, where t is in [0, 1), and u = 1/t for z < 0, where t is above 1, both are
    ``(1 - u) rho(u) = |z|`` for the root rho of the sum of squares of ``r mu / (mu^2 + u)``, or
    ``r mu / (1 + mu^2 u)``, and the same of s: the left side is positive, falls and is convex, so that Newton's
    method from u = 0 rises to the root.
    """
    inside = _inside(z, r, s, mu, mu_t)
    polar = np.hypot(mu * r, mu_t * s) <= -z
    positive = z > 0.0
    (p, q), (p_t, q_t) = ((np.where(positive, c**2, 1.0), np.where(positive, 1.0, c**2)) for c in (mu, mu_t))
    u, size = np.zeros_like(z), np.abs(z)
    open_ = ~inside & ~polar
    for _ in range(NEWTON):
        first, second = (r * mu / (p + q * u)) ** 2, (s * mu_t / (p_t + q_t * u)) ** 2
        rho = np.sqrt(first + second)
        safe = np.where(open_, rho, 1.0)
        slope = rho + (1.0 - u) * (first * q / (p + q * u) + second * q_t / (p_t + q_t * u)) / safe
        step = np.where(open_, ((1.0 - u) * rho - size) / np.where(open_, slope, 1.0), 0.0)
        u = np.minimum(u + np.maximum(step, 0.0), 1.0)
        if not np.any(step > LAST * u):
            break
    radius = np.hypot(r * mu / (p + q * u), s * mu_t / (p_t + q_t * u))
    return np.where(inside, z, np.where(polar, 0.0, np.where(positive, radius, u * radius)))


def _rest(
    z: FloatArray, r: FloatArray, s: FloatArray, pressing: FloatArray, mu: float, mu_t: float
) -> tuple[FloatArray, FloatArray]:
    """Return tangential force and torsion of the projection, given its normal force."""
    safe = np.where(pressing > 0.0, pressing, 1.0)
    t = np.where(pressing > 0.0, 1.0 - z / safe, np.inf)
    t = np.maximum(t, 0.0)
    tangential, torsion = r * mu**2 / (mu**2 + t), s * mu_t**2 / (mu_t**2 + t)
    over = np.sqrt((tangential / mu) ** 2 + (torsion / mu_t) ** 2)
    scale = np.where(over > pressing, pressing / np.where(over > 0.0, over, 1.0), 1.0)  # last-digit safety
    return tangential * scale, torsion * scale
