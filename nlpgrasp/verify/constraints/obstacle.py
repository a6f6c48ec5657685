"""Numeric obstacle constraint: distances of fingertips and links from another body."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.verify.constraints.regions import unit
from nlpgrasp.verify.placement import StatedPlacement
from nlpgrasp.verify.rows import RowValue


def obstacle(data: Json, placement: StatedPlacement) -> Iterator[RowValue]:
    """Yield the distance of every fingertip's and link's centre from the obstacle, at least radius plus clearance.

    For a mesh, the solver uses a spline through distances on a grid, and a lower bound far away: the stated value may
    be smaller there, and may exceed the distance to the mesh itself by half a cell.
    """
    surface = placement.surface_of(data["body"])
    clearance, name = number("clearance", data["clearance"], at_least=0.0), str(data["name"])

    def row(part: str, centre: FloatArray, radius: float, error: float) -> RowValue:
        value = float(surface.distance(in_frame_of(data, centre)[None])[0])
        lower, doubt = radius + clearance, error + surface.rough
        return RowValue(
            f"{name}, {part}", value, lower, scale=placement.size, error=doubt, stated_below=surface.rough > 0.0
        )

    for i, (tip, radius) in enumerate(zip(placement.tips, placement.radii, strict=True)):
        yield row(f"finger {i}", tip, radius, 0.0)
    for ball in placement.links:
        yield row(ball.name, ball.centre, ball.radius, placement.error)


def in_frame_of(data: Json, points: FloatArray) -> FloatArray:
    """Return a point (space,), or points (m, space), of the body's frame in the obstacle's frame."""
    point = points
    if data["position"] is not None:
        point = point - array("position", data["position"], point.shape[-1:])
    return point if data["quaternion_wxyz"] is None else np.asarray(_turn(data).inv().apply(point))


def in_body_frame(data: Json, points: FloatArray) -> FloatArray:
    """Return points (m, space) of the obstacle's frame in the held body's frame."""
    turned = points if data["quaternion_wxyz"] is None else np.asarray(_turn(data).apply(points))
    return turned if data["position"] is None else turned + array("position", data["position"], points.shape[-1:])


def _turn(data: Json) -> Rotation:
    """Return the obstacle's orientation in the held body's frame."""
    return Rotation.from_quat(unit("quaternion_wxyz", data["quaternion_wxyz"], 4), scalar_first=True)
