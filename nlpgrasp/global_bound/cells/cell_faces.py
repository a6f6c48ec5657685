"""Faces of each kind of body as unions of surface cells."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nlpgrasp.bodies import Body, Box, Cylinder, Ellipsoid, Mesh, Polygon, Prism, Sphere, Torus
from nlpgrasp.bodies.base import exterior_angles
from nlpgrasp.bodies.chart_cover import uncovered_by_charts
from nlpgrasp.common.intervals import UnknownOperationError
from nlpgrasp.common.meshes.sharp_edges import SHARP
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import NotCoveredError
from nlpgrasp.global_bound.cells.cell import CellFace
from nlpgrasp.global_bound.cells.chart_cells import ChartFace
from nlpgrasp.global_bound.cells.ellipsoid_cells import EllipsoidFace
from nlpgrasp.global_bound.cells.flat_cells import FlatFaceCells, clip
from nlpgrasp.global_bound.cells.mesh_cells import MeshFace
from nlpgrasp.global_bound.cells.revolved_cells import DiscFace, RevolvedFace

Faces = list[CellFace]


def cell_faces(body: Body, margin: float) -> Faces | None:
    """Return the faces of a body as unions of cells; None for a kind of body without cells.

    They are in the order of the body's face names, or of its charts.

    Parameters
    ----------
    body : Body
    margin : float
        Distance from sharp edges, metres; faces smaller than it are omitted. Ignored for a mesh and for charts.

    Raises
    ------
    NotCoveredError
        Where the charts of a body do not cover its faces.
    """
    if type(body) in MAKERS:
        return MAKERS[type(body)](body, margin)
    charts, name = body.charts(), f"{type(body).__name__}.charts"
    if not charts or body.space == 2:
        return None
    if error := uncovered_by_charts(body):
        raise NotCoveredError(name, error, "charts that cover all faces")
    try:
        return [ChartFace(body, i) for i in range(len(charts))]
    except UnknownOperationError as error:
        raise NotCoveredError(name, str(error), "operations with bounds (docs/own_kinds.md)") from None


def _box_faces(body: Box, margin: float) -> Faces:
    """Return the faces of a box, reduced by a margin from its edges."""
    half = body.half_size
    result: Faces = []
    for name in body.face_names:
        axis, sign = "xyz".index(name[1]), 1.0 if name[0] == "+" else -1.0
        first, second = (i for i in range(3) if i != axis)
        if min(half[first], half[second]) <= margin:
            continue
        corners = np.zeros((4, 3))
        corners[:, axis] = sign * half[axis]
        corners[:, first] = (half[first] - margin) * np.array([1.0, -1.0, -1.0, 1.0])
        corners[:, second] = (half[second] - margin) * np.array([1.0, 1.0, -1.0, -1.0])
        result.append(FlatFaceCells(name, [corners], -sign * np.eye(3)[axis]))
    return result


def _polygon_faces(body: Polygon, margin: float) -> Faces:
    """Return the edges of a polygon, reduced by a margin from its sharp corners."""
    edges = enumerate(_polygon_edges(body.corners, margin))
    return [FlatFaceCells(f"edge{i}", [ends], normal) for i, (ends, normal) in edges if ends is not None]


def _prism_faces(body: Prism, margin: float) -> Faces:
    """Return the sides and ends of a prism, reduced by a margin from its sharp edges."""
    half = body.height / 2.0
    result: Faces = []
    for i, (ends, normal) in enumerate(_polygon_edges(body.corners, margin)):
        if ends is not None and half > margin:
            low, high = (np.column_stack([ends, np.full(2, z)]) for z in (margin - half, half - margin))
            result.append(FlatFaceCells(f"side{i}", [np.concatenate([low, high[::-1]])], np.append(normal, 0.0)))
    inset = _inset_polygon(body.corners, margin)
    for name, z in (("top", half), ("bottom", -half)) if len(inset) else ():
        corners = np.column_stack([inset, np.full(len(inset), z)])
        result.append(FlatFaceCells(name, [corners], np.array([0.0, 0.0, -np.sign(z)])))
    return result


def _polygon_edges(corners: FloatArray, margin: float) -> list[tuple[FloatArray | None, FloatArray]]:
    """Return the ends and inward unit normal of each edge, counter-clockwise, less a margin at sharp corners.

    The ends are None for an edge that is too short.
    """
    result: list[tuple[FloatArray | None, FloatArray]] = []
    setbacks = margin * (np.abs(exterior_angles(corners)) > SHARP)
    next_corners = zip(np.roll(corners, -1, axis=0), np.roll(setbacks, -1), strict=True)
    for start, start_setback, (end, end_setback) in zip(corners, setbacks, next_corners, strict=True):
        length = np.linalg.norm(end - start)
        along = (end - start) / length
        is_long = start_setback + end_setback < length
        ends = np.stack([start + start_setback * along, end - end_setback * along]) if is_long else None
        result.append((ends, np.array([-along[1], along[0]])))
    return result


def _inset_polygon(corners: FloatArray, margin: float) -> FloatArray:
    """Return the part of a convex polygon (m, 2), counter-clockwise, at a margin from all edges."""
    inset = corners
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True) if margin > 0.0 else ():
        along = (end - start) / np.linalg.norm(end - start)
        outward = np.array([along[1], -along[0]])
        inset = clip(inset, outward, float(outward @ start) - margin)
        if len(inset) < 3:
            return np.zeros((0, 2))
    return inset


def _cylinder_faces(body: Cylinder, margin: float) -> Faces:
    """Return the side and the ends of a cylinder, reduced by a margin from its edges."""
    half, radius = body.height / 2.0, body.radius - margin
    ends = [DiscFace(n, radius, s * half, np.array([0.0, 0.0, -s])) for n, s in (("top", 1.0), ("bottom", -1.0))]
    side = RevolvedFace("side", np.array([0.0, body.radius]), np.array([margin - half, half - margin]))
    return [*([side] if half > margin else []), *(ends if radius > 0.0 else [])]


MAKERS: dict[type[Body], Callable[..., Faces]] = {
    Box: _box_faces,
    Polygon: _polygon_faces,
    Prism: _prism_faces,
    Sphere: lambda body, _: [EllipsoidFace("surface", np.full(3, float(body.radius)))],
    Ellipsoid: lambda body, _: [EllipsoidFace("surface", body.half_size)],
    Cylinder: _cylinder_faces,
    Torus: lambda body, _: [
        RevolvedFace("surface", np.array([body.major_radius, body.minor_radius]), np.array([-np.pi, np.pi]))
    ],
    Mesh: lambda body, _: [MeshFace("surface", body)],
}
