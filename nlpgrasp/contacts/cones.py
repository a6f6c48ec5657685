"""Box and elliptic friction cones: projections, their Jacobians and support functions.

``RangeContact`` is the base class of contacts with a box, ``|x_j| <= c_j x_n`` for each block j of components. The
functions ``project_elliptic``, ``elliptic_projection_jacobian`` and ``elliptic_support`` are those of the elliptic cone
of soft contacts, ``(|f_t| / mu)^2 + (tau / mu_t)^2 <= f_n^2``.
"""

from __future__ import annotations

from abc import abstractmethod
from itertools import chain, combinations

import numpy as np

from nlpgrasp.common.validation import BoolArray, FloatArray
from nlpgrasp.contacts.base import Blocks, ContactModel, upper_triangle

ZERO_NORM = 1e-100  # norm of a block that counts as zero
# elliptic cone
NEWTON, LAST = 60, 1e-9  # largest number of Newton steps; relative size of the last (convergence is quadratic)
SINGULARITY_DISTANCE = 1e-9  # distance kept from the multiplier 1, a removable singularity of the derivative


class RangeContact(ContactModel):
    """A contact whose force domain is ``{x : x_n >= 0, |x_j| <= c_j x_n}`` with disjoint blocks j of components.

    Friction is one block of tangential forces, torsion one of a single moment. The normal force of the projection
    of z solves ``n - z_n - sum_j c_j (|z_j| - c_j n)_+ = 0``; the left side is the least, over sets S of blocks, of
    increasing linear functions of n, so n is the largest of their roots
    ``(z_n + sum_S c_j |z_j|) / (1 + sum_S c_j^2)``, and 0 if that is negative.
    """

    @abstractmethod
    def blocks(self, components: int) -> Blocks:
        """Return the blocks of components and their coefficients, given the number of components."""

    def isotropic_relaxation(self, space: int) -> ContactModel | None:
        """Return the contact itself if its blocks are the same in all directions about the normal.

        They are then all tangential forces, the moment about the normal, or both moments along the surface.
        """
        axes = self.axes(space)
        blocks = [tuple(axes[block]) for block, _ in self.blocks(len(axes))]
        return self if all(block in (tuple(range(1, space)), (3,), (4, 5)) for block in blocks) else None

    def project(self, z: FloatArray) -> FloatArray:
        """Return the projection of ``z`` (..., n_i) onto the force domain, with every block clipped to its limit."""
        blocks = self.blocks(z.shape[-1])
        sizes = [_block_norm(z, block) for block, _ in blocks]
        pressing = _normal_force_of_blocks(z[..., 0], sizes, [c for _, c in blocks])
        result = np.empty_like(z)
        result[..., 0] = pressing
        for (block, c), size in zip(blocks, sizes, strict=True):
            if block.stop - block.start == 1:
                result[..., block.start] = np.clip(z[..., block.start], -c * pressing, c * pressing)
            else:
                scale = np.minimum(size, c * pressing) / np.where(size > 0.0, size, 1.0)
                result[..., block] = z[..., block] * scale[..., None]
        return result

    def derivative_entries(self, z: FloatArray) -> FloatArray:
        """Return the upper triangle of the projection's Jacobian, row by row, (n_i (n_i + 1) / 2, ...).

        The Jacobian is ``v v^T / |v|^2`` plus block-diagonal terms. ``v = (1, c_j t_j)`` over the blocks at their
        limit, with unit vectors ``t_j = z_j / |z_j|``. A block within its range adds the identity, one at its limit
        ``(c_j n / |z_j|) (I - t_j t_j^T)``. Zero where n is 0.
        """
        n = z.shape[-1]
        blocks = self.blocks(n)
        sizes = [_block_norm(z, block) for block, _ in blocks]
        pressing = _normal_force_of_blocks(z[..., 0], sizes, [c for _, c in blocks])
        pressed = (pressing > 0.0).astype(float)
        limit = [pressed * (size > c * pressing) for (_, c), size in zip(blocks, sizes, strict=True)]
        weight = pressed / (1.0 + sum(c**2 * at_limit for (_, c), at_limit in zip(blocks, limit, strict=True)))
        row = {pair: i for i, pair in enumerate(upper_triangle(n))}
        result = np.empty((len(row), *pressing.shape))
        v: list[FloatArray] = [np.ones(1)] * n
        for (block, c), size, at_limit in zip(blocks, sizes, limit, strict=True):
            inverse = 1.0 / np.where(size > ZERO_NORM, size, 1.0)
            for a in range(block.start, block.stop):
                v[a] = (c * at_limit) * inverse * z[..., a]
        result[0] = weight
        for (a, b), i in row.items():
            if i:
                np.multiply(weight * v[a], v[b], out=result[i])
        for (block, c), size, at_limit in zip(blocks, sizes, limit, strict=True):
            inverse = 1.0 / np.where(size > ZERO_NORM, size, 1.0)
            shrink = at_limit * (c * pressing * inverse)  # of the part across t_j
            transverse = shrink * inverse**2
            for a in range(block.start, block.stop):
                result[row[a, a]] += pressed - at_limit + shrink
                for b in range(a, block.stop):
                    result[row[a, b]] -= transverse * z[..., a] * z[..., b]
        return result

    def extreme(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support ``max(0, z_n + sum_j c_j |z_j|)`` of ``z`` (..., n_i), and a maximiser (..., n_i).

        The maximiser has unit normal force and every block at its limit.
        """
        result = np.empty_like(z)
        value = z[..., 0]
        for block, c in self.blocks(z.shape[-1]):
            size = _block_norm(z, block)
            value = value + c * size
            result[..., block] = z[..., block] * (c / np.where(size > 0.0, size, 1.0))[..., None]
        is_positive = value > 0.0
        result[..., 0] = 1.0
        return np.where(is_positive, value, 0.0), result * is_positive[..., None]

    def cones(self, space: int) -> list[FloatArray]:
        """Return matrices (r, n_i) that map x into second-order cones: ``x_n``, and each ``(c_j x_n, x_j)``.

        A block x_j of a single component has two half-spaces instead, ``c_j x_n - x_j`` and ``c_j x_n + x_j``.
        """
        n = self.components(space)
        unit = np.eye(n)
        result = [unit[:1]]
        for block, c in self.blocks(n):
            if block.stop - block.start == 1:
                result += [c * unit[:1] - unit[block], c * unit[:1] + unit[block]]
            else:
                result.append(np.concatenate([c * unit[:1], unit[block]]))
        return result


def _block_norm(z: FloatArray, block: slice) -> FloatArray:
    """Return the Euclidean norm of one block of components."""
    if block.stop - block.start == 1:
        return np.abs(z[..., block.start])
    total = z[..., block.start] ** 2
    for a in range(block.start + 1, block.stop):
        total = total + z[..., a] ** 2
    return np.asarray(np.sqrt(total))


def _normal_force_of_blocks(normal: FloatArray, sizes: list[FloatArray], coefficients: list[float]) -> FloatArray:
    """Return the normal force of the projection, in closed form.

    It is the largest root over sets of blocks, at least zero (see ``RangeContact``).
    """
    result = np.maximum(normal, 0.0)
    count = len(sizes)
    for subset in chain.from_iterable(combinations(range(count), m) for m in range(1, count + 1)):
        total, weight = normal, 1.0
        for j in subset:
            total = total + coefficients[j] * sizes[j]
            weight += coefficients[j] ** 2
        result = np.maximum(result, total / weight)
    return result


def project_elliptic(z: FloatArray, mu: float, mu_t: float) -> FloatArray:
    """Return the projection of ``z = (f_n, f_t1, f_t2, tau)``, (..., 4), onto the elliptic cone."""
    r, s = _tangential_sizes(z)
    pressing = _normal_force_of_ellipse(z[..., 0], r, s, mu, mu_t)
    tangential, torsion = _tangential_part(z[..., 0], r, s, pressing, mu, mu_t)
    scale = tangential / np.where(r > 0.0, r, 1.0)
    result = np.empty_like(z)
    result[..., 0] = pressing
    result[..., 1:3] = z[..., 1:3] * scale[..., None]
    result[..., 3] = np.copysign(torsion, z[..., 3])
    return result


def elliptic_projection_jacobian(z: FloatArray, mu: float, mu_t: float) -> FloatArray:
    """Return the Jacobian of the projection onto the elliptic cone, (..., 4, 4).

    On the boundary ``x = (I + t D)^-1 z`` with ``D = diag(-1, 1/mu^2, 1/mu^2, 1/mu_t^2)`` and ``<x, D x> = 0``;
    differentiating both gives ``M - M D x (M D x)^T / <D x, M D x>`` with ``M = (I + t D)^-1``.
    """
    is_inside = _is_in_cone(z[..., 0], *_tangential_sizes(z), mu, mu_t)
    x = project_elliptic(z, mu, mu_t)
    D = np.array([-1.0, 1.0 / mu**2, 1.0 / mu**2, 1.0 / mu_t**2])
    safe = np.where(x[..., 0] > 0.0, x[..., 0], 1.0)
    t = np.maximum(1.0 - z[..., 0] / safe, 0.0)
    t = np.where(np.abs(t - 1.0) < SINGULARITY_DISTANCE, 1.0 + SINGULARITY_DISTANCE, t)
    M = 1.0 / (1.0 + t[..., None] * D)
    Mx = M * D * x
    denominator = np.sum(D * x * Mx, axis=-1)
    boundary = (
        np.eye(4) * M[..., None]
        - Mx[..., :, None] * Mx[..., None, :] / np.where(denominator != 0.0, denominator, 1.0)[..., None, None]
    )
    result = np.where(is_inside[..., None, None], np.eye(4), boundary)
    return np.asarray(np.where((x[..., 0] > 0.0)[..., None, None], result, 0.0))


def elliptic_support(z: FloatArray, mu: float, mu_t: float) -> tuple[FloatArray, FloatArray]:
    """Return the elliptic cone's support ``max(0, z_n + |(mu z_t, mu_t z_tau)|)``, and a maximiser (..., 4)."""
    r, s = _tangential_sizes(z)
    size = np.hypot(mu * r, mu_t * s)
    value = z[..., 0] + size
    safe = np.where(size > 0.0, size, 1.0)
    force = np.empty_like(z)
    force[..., 0] = 1.0
    force[..., 1:3] = z[..., 1:3] * (mu**2 / safe)[..., None]
    force[..., 3] = z[..., 3] * (mu_t**2 / safe)
    is_positive = value > 0.0
    return np.where(is_positive, value, 0.0), force * is_positive[..., None]


def _tangential_sizes(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the magnitudes of tangential force and torsion."""
    return np.hypot(z[..., 1], z[..., 2]), np.abs(z[..., 3])


def _is_in_cone(z: FloatArray, r: FloatArray, s: FloatArray, mu: float, mu_t: float) -> BoolArray:
    """Return whether a force is in the elliptic cone."""
    return np.asarray(np.hypot(r / mu, s / mu_t) <= z)


def _normal_force_of_ellipse(z: FloatArray, r: FloatArray, s: FloatArray, mu: float, mu_t: float) -> FloatArray:
    """Return the normal force of the projection onto ``{(r/mu)^2 + (s/mu_t)^2 <= n^2, n >= 0}``.

    Over the cone's boundary points ``n (1, mu cos a, mu_t sin a)`` the best n for a given a is
    ``(z + mu r cos a + mu_t s sin a) / (1 + mu^2 cos^2 a + mu_t^2 sin^2 a)``. With the multiplier t of the
    cone constraint, n solves ``n^2 = (r mu / (mu^2 + t))^2 + (s mu_t / (mu_t^2 + t))^2``, ``n (1 - t) = z``. With
    u = t for z > 0, where t is in [0, 1), and u = 1/t for z < 0, where t is above 1, both are
    ``(1 - u) rho(u) = |z|`` for the root rho of the sum of squares of ``r mu / (mu^2 + u)``, or
    ``r mu / (1 + mu^2 u)``, and the same of s: the left side is positive, falls and is convex, so that Newton's
    method from u = 0 rises to the root.
    """
    is_inside = _is_in_cone(z, r, s, mu, mu_t)
    is_polar = np.hypot(mu * r, mu_t * s) <= -z
    positive = z > 0.0
    (p, q), (p_t, q_t) = ((np.where(positive, c**2, 1.0), np.where(positive, 1.0, c**2)) for c in (mu, mu_t))
    u, size = np.zeros_like(z), np.abs(z)
    is_outside = ~is_inside & ~is_polar
    for _ in range(NEWTON):
        first, second = (r * mu / (p + q * u)) ** 2, (s * mu_t / (p_t + q_t * u)) ** 2
        rho = np.sqrt(first + second)
        safe = np.where(is_outside, rho, 1.0)
        slope = rho + (1.0 - u) * (first * q / (p + q * u) + second * q_t / (p_t + q_t * u)) / safe
        step = np.where(is_outside, ((1.0 - u) * rho - size) / np.where(is_outside, slope, 1.0), 0.0)
        u = np.minimum(u + np.maximum(step, 0.0), 1.0)
        if not np.any(step > LAST * u):
            break
    radius = np.hypot(r * mu / (p + q * u), s * mu_t / (p_t + q_t * u))
    return np.where(is_inside, z, np.where(is_polar, 0.0, np.where(positive, radius, u * radius)))


def _tangential_part(
    z: FloatArray, r: FloatArray, s: FloatArray, pressing: FloatArray, mu: float, mu_t: float
) -> tuple[FloatArray, FloatArray]:
    """Return tangential force and torsion of the projection of (z, r, s) onto the elliptic cone.

    The cone is ``(r / mu)^2 + (s / mu_t)^2 <= z^2``. With the multiplier t of that constraint, the projection is
    ``z / (1 - t)``, which is given as ``pressing``, ``r mu^2 / (mu^2 + t)`` and ``s mu_t^2 / (mu_t^2 + t)``.
    """
    safe = np.where(pressing > 0.0, pressing, 1.0)
    t = np.where(pressing > 0.0, 1.0 - z / safe, np.inf)
    t = np.maximum(t, 0.0)
    tangential, torsion = r * mu**2 / (mu**2 + t), s * mu_t**2 / (mu_t**2 + t)
    ratio = np.sqrt((tangential / mu) ** 2 + (torsion / mu_t) ** 2)
    scale = np.where(ratio > pressing, pressing / np.where(ratio > 0.0, ratio, 1.0), 1.0)  # not outside by rounding
    return tangential * scale, torsion * scale
