"""Chart of a curved face: the face as the image of a rectangle of two coordinates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise, product

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.types import Expression
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.errors import InputError


@dataclass(frozen=True)
class Chart:
    """A face, or a part of it, as the image of a rectangle; normals follow from the face's own surface ``h``.

    From it follow cells of the face for bounds over all placements (docs/how_close.md). Images of charts may overlap.
    The edges of a rectangle may be mapped to points, such as poles.

    Parameters
    ----------
    face : str
        Its name.
    point : callable
        ``point(u) -> p``: a CasADi column of two coordinates to one of three metres, smooth.
    rectangle : (2, 2) array
        Least and greatest value of the first coordinate, and of the second.
    divisions : (2,) array of int
        Into how many intervals each is divided at first, best so that the normal turns by less than a right angle.
    normal : callable, optional
        ``normal(u) -> n``: the outward normal there, unit, where it is simpler than by the gradient of h. Bounds are
        tighter the fewer operations there are.
    """

    face: str
    point: Callable[[Expression], Expression]
    rectangle: ArrayLike
    divisions: ArrayLike = (8, 4)
    normal: Callable[[Expression], Expression] | None = None

    def __post_init__(self) -> None:
        rectangle = array("Chart.rectangle", self.rectangle, (2, 2))
        if np.any(rectangle[:, 0] >= rectangle[:, 1]):
            raise InputError("Chart.rectangle", rectangle.tolist(), "a least value below the greatest, twice")
        counts = array("Chart.divisions", self.divisions, (2,))
        if np.any(counts < 1) or np.any(counts != np.round(counts)) or np.prod(counts) > 400:
            raise InputError("Chart.divisions", counts.tolist(), "two whole numbers from 1, with a product up to 400")

    def first_parts(self) -> list[FloatArray]:
        """Return the parts of the rectangle at first, (2, 2) each, as of ``rectangle``."""
        rectangle, counts = np.asarray(self.rectangle, float).tolist(), np.asarray(self.divisions, int).tolist()
        ticks = [np.linspace(low, high, count + 1) for (low, high), count in zip(rectangle, counts, strict=True)]
        return [np.array(sides) for sides in product(*map(pairwise, ticks))]

    def contact_function(self, surface: Callable[[Expression], Expression]) -> ca.Function:
        """Return the function from coordinates (2,) to point, metres, and unit inward normal, (3,) each.

        ``surface`` is the face's h.
        """
        u, p = ca.SX.sym("u", 2), ca.SX.sym("p", 3)
        point = self.point(u)
        shape = getattr(point, "shape", type(point).__name__)
        if shape != (3, 1):
            raise InputError("Chart.point", f"shape {shape}", "a column of three metres")
        if self.normal is None:
            gradient = ca.Function("gradient", [p], [ca.gradient(surface(p), p)])(point)
            inward = -gradient / ca.norm_2(gradient)
        else:
            inward = -self.normal(u)
        return ca.Function("chart", [u], [ca.densify(point), ca.densify(inward)], ["u"], ["p", "n"])
