"""Comparison of charts with the faces of their body, at samples."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from nlpgrasp.bodies.base import ON_FACE, Body
from nlpgrasp.common.evaluation import BatchEvaluator
from nlpgrasp.common.validation import FloatArray


def uncovered_by_charts(body: Body, samples: int = 2000, grid: int = 24) -> str:
    """Return what charts leave uncovered, or where they leave the surface, as text; empty where neither is seen.

    Samples of each face are compared with a grid on each first part of its charts: they have to be as near to it as it
    is dense. This refutes, and does not prove.
    """
    rng = np.random.default_rng(0)
    points: dict[str, list[FloatArray]] = {}
    for chart in body.charts():
        if chart.face not in body.face_names:
            return f"a chart of {chart.face!r}, which is no face"
        contacts = BatchEvaluator(chart.contact_function(body.face(chart.face).surface))
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
