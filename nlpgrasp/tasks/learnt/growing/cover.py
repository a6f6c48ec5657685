"""Ellipsoidal covers of discarded wrenches, and their largest level in another ellipsoid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.learnt.local import Local
from nlpgrasp.tasks.learnt.min_volume import MinVolume

HALVINGS = 60  # bisection steps for the multiplier


@dataclass(frozen=True)
class Shape:
    """Ellipsoid ``{center + sum_j v_j axes_j, |v| <= 1}``.

    Parameters
    ----------
    center : (d,) array
    axes : (m, d) array
    """

    center: FloatArray
    axes: FloatArray

    def ends(self) -> FloatArray:
        """Return the end points of its semi-axes, (2 m, d)."""
        return np.concatenate([self.center + self.axes, self.center - self.axes])

    def within(self, local: Local) -> Shape:
        """Return the ellipsoid in normalised coordinates."""
        return Shape(local.inward(self.center[None])[0], local.inward_axes(self.axes))

    def to_dict(self) -> Json:
        """Return centre and semi-axes as JSON data."""
        return {"center": self.center.tolist(), "axes": self.axes.tolist()}

    @classmethod
    def from_dict(cls, data: Json, dimension: int, field: str) -> Shape:
        """Return the ellipsoid from the data of its ``to_dict``, checked against the dimension."""
        axes = array(f"{field}.axes", data["axes"], (None, dimension))
        if not np.any(axes):
            raise InputError(f"{field}.axes", "nothing but zeros", "at least one semi-axis")
        return cls(array(f"{field}.center", data["center"], (dimension,)), axes)


@dataclass(frozen=True)
class Cover:
    """Cover of discarded wrenches: an intersection of ellipsoids that contains all of them.

    Parameters
    ----------
    shapes : tuple of Shape
        At least one.
    given : bool
        Whether it is a task given as an ellipsoid, all of which has to be enclosed; it is then the only one.
    """

    shapes: tuple[Shape, ...]
    given: bool = False

    def ends(self) -> FloatArray:
        """Return the end points of the first ellipsoid's semi-axes, (2 m, d)."""
        return self.shapes[0].ends()

    def within(self, local: Local) -> Cover:
        """Return the cover in normalised coordinates."""
        return Cover(tuple(shape.within(local) for shape in self.shapes), self.given)

    def farthest(self, ellipsoid: MinVolume) -> tuple[float, FloatArray]:
        """Return an upper bound of its level in an ellipsoid, and the farthest point (r,) of the decisive shape."""
        return min((farthest(shape, ellipsoid) for shape in self.shapes), key=lambda found: found[0])

    def to_dict(self) -> Json:
        """Return the cover as JSON data."""
        return {"in": [shape.to_dict() for shape in self.shapes], "given": self.given}

    @classmethod
    def from_dict(cls, data: Json, dimension: int, field: str) -> Cover:
        """Return the cover from the data of its ``to_dict``, checked against the dimension."""
        shapes = [Shape.from_dict(one, dimension, f"{field}.in.{i}") for i, one in enumerate(data["in"])]
        return cls(tuple(shapes), data["given"])


def farthest(shape: Shape, ellipsoid: MinVolume) -> tuple[float, FloatArray]:
    """Return a tight upper bound of one ellipsoid's level in another, and the farthest point (r,).

    In the other ellipsoid's coordinates it is the largest ``|b + B v|`` over ``|v| <= 1``, a trust-region subproblem:
    for every ``lam`` above the eigenvalues s of ``S = B^T B``, with ``g = B^T b``,

        ``|b + B v|^2 <= |b|^2 + lam + sum_i g_i^2 / (lam - s_i)``,

    since ``v^T S v + 2 g^T v - lam |v|^2`` is concave in v. The least of these bounds is attained (More and Sorensen
    1983, doi:10.1137/0904038): where ``sum_i g_i^2 / (lam - s_i)^2 = 1``, or at the largest eigenvalue.
    """
    out = np.linalg.solve(ellipsoid.axes.T, np.column_stack([shape.center - ellipsoid.center, shape.axes.T]))
    b, B = out[:, 0], out[:, 1:]
    s, vectors = np.linalg.eigh(B.T @ B)
    g = vectors.T @ (B.T @ b)

    def point(lam: float) -> FloatArray:
        return np.asarray(np.divide(g, lam - s, out=np.zeros_like(g), where=(g != 0.0) & (lam > s)))

    low, high = s[-1] + abs(g[-1]), s[-1] + float(np.linalg.norm(g))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if float(np.sum(point(middle) ** 2)) > 1.0:
            low = middle
        else:
            high = middle
    v = point(high)
    bound = float(b @ b + high + g @ v)
    v[-1] += np.copysign(max(0.0, 1.0 - float(v @ v)) ** 0.5, g[-1])  # hard case: along the last eigenvector
    v /= max(1.0, float(np.linalg.norm(v)))
    return max(bound, 0.0) ** 0.5, shape.center + (vectors @ v) @ shape.axes
