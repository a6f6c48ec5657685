"""Bodies bounded by a user-defined implicit surface or curve ``h(p) = 0``."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import ClassVar, NoReturn

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.bodies.base import Body, Face
from nlpgrasp.common.registry import incomplete_data
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, array, read_only
from nlpgrasp.common.value_digest import expression_digest
from nlpgrasp.errors import InputError

SIDE_SAMPLES = 400  # points of each side of the box at which h is checked
BEYOND = 1e-9  # over the body's size: h, metres, below minus this at a side means that the body reaches beyond the box


class Implicit(Body):
    """An implicit body ``{h(p) <= 0}`` within a box; one face, ``surface``.

    Parameters
    ----------
    h : callable
        ``h(p)`` of a CasADi column p (3,), metres: negative inside, positive outside, smooth near zero.
    bounds : (2, 3) array
        Lower and upper corner of a box around the body, metres.

    Raises
    ------
    InputError
        When h is not a scalar CasADi expression of p, is nowhere negative, or its zero set leaves the box.
    """

    kind: ClassVar[str] = "implicit"
    tight: ClassVar[bool] = False

    def __init__(self, h: Callable[[Expression], Expression], bounds: ArrayLike) -> None:
        name = type(self).__name__
        if not callable(h):
            raise InputError(f"{name}.h", h, "a function of a CasADi point p")
        box = array(f"{name}.bounds", bounds, (2, self.space))
        if np.any(box[1] <= box[0]):
            raise InputError(f"{name}.bounds", bounds, "a lower corner below the upper corner in every axis")
        self.h = h
        self._box = read_only(box)
        try:
            value = h(self.point())
        except Exception as error:
            raise InputError(f"{name}.h", f"{type(error).__name__}: {error}", "CasADi operations on p only") from None
        if getattr(value, "shape", None) != (1, 1):
            raise InputError(
                f"{name}.h", f"shape {getattr(value, 'shape', type(value).__name__)}", "a scalar expression"
            )
        self._check_closed()

    def __repr__(self) -> str:
        return f"{type(self).__name__}(h={getattr(self.h, '__name__', 'h')}, bounds={self._box.tolist()})"

    @property
    def bounds(self) -> FloatArray:
        """The given bounding box, (2, 3), or (2, 2) in the plane, metres."""
        return self._box

    @cached_property
    def centroid(self) -> FloatArray:
        """Approximate centroid, (space,), metres: mean of the grid points with ``h <= 0``, 60 per side."""
        return _grid_centroid(self)

    def make_faces(self) -> tuple[Face, ...]:
        """Return the one face ``h = 0``."""
        return (Face("surface", self.h),)

    def to_dict(self) -> Json:
        """Return the expression as text (for reading only) with its digest, and the box, as JSON data."""
        p = ca.SX.sym("p", self.space)
        return {
            "type": self.kind,
            "h": str(self.h(p)),
            "function": expression_digest(self.h, [p]),
            "bounds": self.bounds.tolist(),
        }

    @classmethod
    def from_dict(cls, data: Json) -> NoReturn:
        """Raise: the expression's text cannot be turned back into a function."""
        raise incomplete_data(f"body of type {cls.kind}", "its function h, which stays in the script that made it")

    def _check_closed(self) -> None:
        """Raise if the body has no interior or reaches beyond the sides of its box, at sampled points."""
        _ = self.centroid  # raises without an interior
        lower, upper = self.bounds
        rng = np.random.default_rng(0)
        for axis in range(self.space):
            for side in (lower, upper):
                points = rng.uniform(lower, upper, (SIDE_SAMPLES, self.space))
                points[:, axis] = side[axis]
                if np.any(self.evaluate("surface", points)[0] < -BEYOND * self.size):
                    raise InputError(
                        f"{type(self).__name__}.bounds",
                        self.bounds.tolist(),
                        "a box with the whole body inside",
                    )


class PlanarImplicit(Implicit):
    """A planar implicit body ``{h(p) <= 0}`` within a rectangle; one face, ``surface``.

    Parameters
    ----------
    h : callable
        ``h(p)`` of a CasADi column p (2,), metres: negative inside, positive outside.
    bounds : (2, 2) array
        Lower and upper corner of a rectangle around the body, metres.
    """

    kind: ClassVar[str] = "planar_implicit"

    @property
    def space(self) -> int:
        """Dimension of the space: 2, the plane."""
        return 2


def _grid_centroid(body: Body, resolution: int = 60) -> FloatArray:
    """Return the mean of the grid points inside a body with one face, (space,), metres."""
    lower, upper = body.bounds
    axes = [
        np.linspace(a, b, resolution, endpoint=False) + (b - a) / (2 * resolution)
        for a, b in zip(lower, upper, strict=True)
    ]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, body.space)
    h = body.evaluate(body.face_names[0], points)[0]
    interior = points[h <= 0.0]
    if not len(interior):
        raise InputError(f"{type(body).__name__}.h", "no point of the bounds with h <= 0", "h negative inside the body")
    return np.asarray(interior.mean(axis=0))
