"""Box friction cones: ``|x_j| <= c_j x_n`` for disjoint blocks of components."""

from __future__ import annotations

from abc import abstractmethod
from itertools import chain, combinations

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.base import ContactModel
from nlpgrasp.contacts.cones.terms import Blocks, upper_triangle

NOTHING = 1e-100  # norm of a block that counts as zero


class RangeContact(ContactModel):
    """A contact whose force domain is ``{x : x_n >= 0, |x_j| <= c_j x_n}`` with disjoint blocks j of components.

    Friction is one block of tangential forces, torsion one of a single moment. The normal force of the projection
    of z solves ``n - z_n - sum_j c_j (|z_j| - c_j n)_+ = 0``; the left side is the least, over sets S of blocks, of
    increasing linear functions of n, so n is the largest of their roots
    ``(z_n + sum_S c_j |z_j|) / (1 + sum_S c_j^2)``, and 0 if that is negative.
    """

    @abstractmethod
    def blocks(self, components: int) -> Blocks:
        """Return the blocks and their coefficients, given the number of components."""

    def project(self, z: FloatArray) -> FloatArray:
        """Return the projection of ``z`` (..., n_i): the normal force above, and every block clipped to its range."""
        blocks = self.blocks(z.shape[-1])
        sizes = [_size(z, where) for where, _ in blocks]
        pressing = _pressing(z[..., 0], sizes, [c for _, c in blocks])
        result = np.empty_like(z)
        result[..., 0] = pressing
        for (where, c), size in zip(blocks, sizes, strict=True):
            if where.stop - where.start == 1:
                result[..., where.start] = np.clip(z[..., where.start], -c * pressing, c * pressing)
            else:
                scale = np.minimum(size, c * pressing) / np.where(size > 0.0, size, 1.0)
                result[..., where] = z[..., where] * scale[..., None]
        return result

    def derivative_entries(self, z: FloatArray) -> FloatArray:
        """Return the Jacobian's upper triangle: ``v v^T / |v|^2`` plus block-diagonal terms.

        ``v = (1, c_j t_j)`` over the blocks at their limit, with unit vectors ``t_j = z_j / |z_j|``. A block within
        its range adds the identity, one at its limit ``(c_j n / |z_j|) (I - t_j t_j^T)``. Zero where n is 0.
        """
        n = z.shape[-1]
        blocks = self.blocks(n)
        sizes = [_size(z, where) for where, _ in blocks]
        pressing = _pressing(z[..., 0], sizes, [c for _, c in blocks])
        on = (pressing > 0.0).astype(float)
        limit = [on * (size > c * pressing) for (_, c), size in zip(blocks, sizes, strict=True)]
        weight = on / (1.0 + sum(c**2 * at for (_, c), at in zip(blocks, limit, strict=True)))
        row = {pair: i for i, pair in enumerate(upper_triangle(n))}
        result = np.empty((len(row), *pressing.shape))
        v: list[FloatArray] = [np.ones(1)] * n
        for (where, c), size, at in zip(blocks, sizes, limit, strict=True):
            inverse = 1.0 / np.where(size > NOTHING, size, 1.0)
            for a in range(where.start, where.stop):
                v[a] = (c * at) * inverse * z[..., a]
        result[0] = weight
        for (a, b), i in row.items():
            if i:
                np.multiply(weight * v[a], v[b], out=result[i])
        for (where, c), size, at in zip(blocks, sizes, limit, strict=True):
            inverse = 1.0 / np.where(size > NOTHING, size, 1.0)
            shrink = at * (c * pressing * inverse)  # of the part across t_j
            across = shrink * inverse**2
            for a in range(where.start, where.stop):
                result[row[a, a]] += on - at + shrink
                for b in range(a, where.stop):
                    result[row[a, b]] -= across * z[..., a] * z[..., b]
        return result

    def extreme(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support ``max(0, z_n + sum_j c_j |z_j|)`` of ``z`` (..., n_i), and a maximiser (..., n_i).

        The maximiser has unit normal force and every block at its limit.
        """
        result = np.empty_like(z)
        value = z[..., 0]
        for where, c in self.blocks(z.shape[-1]):
            size = _size(z, where)
            value = value + c * size
            result[..., where] = z[..., where] * (c / np.where(size > 0.0, size, 1.0))[..., None]
        pays = value > 0.0
        result[..., 0] = 1.0
        return np.where(pays, value, 0.0), result * pays[..., None]

    def cones(self, space: int) -> list[FloatArray]:
        """Return ``x_n >= 0`` and ``(c_j x_n, x_j)`` for every block; two half-spaces for a single component."""
        n = self.components(space)
        unit = np.eye(n)
        result = [unit[:1]]
        for where, c in self.blocks(n):
            if where.stop - where.start == 1:
                result += [c * unit[:1] - unit[where], c * unit[:1] + unit[where]]
            else:
                result.append(np.concatenate([c * unit[:1], unit[where]]))
        return result


def _size(z: FloatArray, where: slice) -> FloatArray:
    """Return the Euclidean norm of a block of components."""
    if where.stop - where.start == 1:
        return np.abs(z[..., where.start])
    total = z[..., where.start] ** 2
    for a in range(where.start + 1, where.stop):
        total = total + z[..., a] ** 2
    return np.asarray(np.sqrt(total))


def _pressing(normal: FloatArray, sizes: list[FloatArray], coefficients: list[float]) -> FloatArray:
    """Return the normal force of the projection: the largest root over sets of blocks, at least zero."""
    result = np.maximum(normal, 0.0)
    count = len(sizes)
    for chosen in chain.from_iterable(combinations(range(count), m) for m in range(1, count + 1)):
        total, weight = normal, 1.0
        for j in chosen:
            total = total + coefficients[j] * sizes[j]
            weight += coefficients[j] ** 2
        result = np.maximum(result, total / weight)
    return result
