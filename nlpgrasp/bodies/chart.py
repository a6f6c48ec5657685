"""Chart of a curved face: the face as the image of a rectangle of two coordinates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from nlpgrasp.bodies.base import ON_FACE, Body
from nlpgrasp.common.evaluation import BatchEvaluator
from nlpgrasp.common.types import Expression
from nlpgrasp.common.validation import FloatArray


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

    def first_parts(self) -> list[FloatArray]:
        """Return the parts of the rectangle at first, (2, 2) each, as of ``rectangle``."""
        ends = [
            np.linspace(low, high, count + 1)
            for (low, high), count in zip(
                np.asarray(self.rectangle, float), np.asarray(self.divisions, int), strict=True
            )
        ]
        return [
            np.stack([ends[0][i : i + 2], ends[1][j : j + 2]])
            for i in range(len(ends[0]) - 1)
            for j in range(len(ends[1]) - 1)
        ]

    def contact_function(self, body: Body) -> ca.Function:
        """Return the function from coordinates (2,) to point, metres, and unit inward normal, (3,) each."""
        u, p = ca.SX.sym("u", 2), ca.SX.sym("p", 3)
        point = self.point(u)
        if self.normal is None:
            gradient = ca.Function("gradient", [p], [ca.gradient(body.face(self.face).surface(p), p)])(point)
            inward = -gradient / ca.norm_2(gradient)
        else:
            inward = -self.normal(u)
        return ca.Function("chart", [u], [point, inward], ["u"], ["p", "n"])


def uncovered_by_charts(body: Body, samples: int = 2000, grid: int = 24) -> str:
    """Return what charts leave uncovered, or where they leave the surface, as text; empty where neither is seen.

    Samples of each face are compared with a grid on each first part of its charts: they have to be as near to it as it
    is dense. This refutes, and does not prove.
    """
    rng = np.random.default_rng(0)
    points: dict[str, list[FloatArray]] = {}
    for chart in body.charts():
        contacts = BatchEvaluator(chart.contact_function(body))
        if chart.face not in body.face_names:
            return f"a chart of {chart.face!r}, which is no face"
        for part in chart.first_parts():
            ticks = [np.linspace(a, b, grid) for a, b in part.tolist()]
            on_grid, inward = contacts(np.stack(np.meshgrid(*ticks, indexing="ij"), axis=2).reshape(-1, 2))
            h, slope, outward, _ = body.evaluate(chart.face, on_grid)
            if not np.all(np.abs(h) <= ON_FACE * body.size * slope):
                return (
                    f"points of a chart {1e3 * float(np.nanmax(np.abs(h / slope))):.3g} mm off the face {chart.face!r}"
                )
            if not np.max(np.abs(outward + inward)) <= 1e-6:
                return f"another normal than that of the face {chart.face!r} at a point of a chart"
            square = on_grid.reshape(grid, grid, 3)
            steps = [float(np.max(np.linalg.norm(np.diff(square, axis=i), axis=2))) for i in range(2)]
            points.setdefault(chart.face, []).append(
                np.column_stack([on_grid, np.full(len(on_grid), np.linalg.norm(steps))])
            )
    for face in body.face_names:
        if face not in points:
            return f"no chart of the face {face!r}"
        covered = np.concatenate(points[face])
        distance, nearest = cKDTree(covered[:, :3]).query(body.sample(face, samples, rng))
        if np.any(distance > covered[nearest, 3]):
            return f"a point of the face {face!r} {1e3 * float(np.max(distance)):.3g} mm from its charts"
    return ""
