"""Coverage of the allowed faces of a contact by the root cells of a certificate.

``uncovered_faces`` compares root cells with the faces of the body (``faces_of``): on a flat face polygons have to cover
the allowed part of its outline; of a curved face all cells that constraints do not exclude have to be among the roots.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.verify.bound.read_cells import read_cell
from nlpgrasp.verify.bound.stated_cells import StatedPolygonCell, clip_below
from nlpgrasp.verify.bound.stated_charts import chart_faces
from nlpgrasp.verify.bound.stated_regions import StatedRegion
from nlpgrasp.verify.check import NotCheckedError

DIVISIONS = {"sector": 8, "revolved": 4}  # initial divisions of a full turn, by kind of cell
SHARP_COSINE = 0.75**0.5  # cosine of 30 degrees: corners that turn by more are sharp
TOLERANCE = 1e-9  # tolerance relative to the body's size

Faces = dict[str, "FlatFaceOutline | list[Json] | None"]
"""Outline of each face, or cells that cover it; None for a mesh, whose triangles are in another file."""
NamedFace = tuple[str, "FlatFaceOutline | list[Json]"]
"""Name of a face, and its outline or the cells that cover it."""


@dataclass(frozen=True)
class FlatFaceOutline:
    """Flat face of a body: a polygon in space or a segment in the plane, with one normal.

    Parameters
    ----------
    corners : (m, space) array
        In order, metres.
    normal : (space,) array
        Unit, into the body.
    """

    corners: FloatArray
    normal: FloatArray


def uncovered_faces(faces: Faces, region: StatedRegion, roots: Sequence[Json], size: float) -> list[str]:
    """Return the names of faces with an allowed part that no root cell covers.

    Meshes are not checked here.
    """
    cells = [cell for root in roots for cell in _members(root)]
    uncovered = []
    for face_name, face in faces.items():
        if face_name not in region.faces or face is None:
            continue
        if isinstance(face, FlatFaceOutline):
            is_uncovered = _is_uncovered(face, region, [m for m in cells if _is_in_plane(m, face, size)], size)
        else:
            is_uncovered = not all(
                region.excludes(read_cell(c), TOLERANCE * size) or is_among(c, cells, size) for c in face
            )
        uncovered += [face_name] if is_uncovered else []
    return uncovered


def _is_in_plane(cell: Json, face: FlatFaceOutline, size: float) -> bool:
    """Return whether a cell is a polygon in the plane of a face and has the face's normal."""
    if cell["kind"] != "polygon":
        return False
    polygon = StatedPolygonCell(cell)
    if polygon.vertices.shape[1] != len(face.normal) or not np.all(np.abs(polygon.normal - face.normal) <= TOLERANCE):
        return False
    return bool(np.all(np.abs((polygon.vertices - face.corners[0]) @ face.normal) <= TOLERANCE * size))


def _is_uncovered(face: FlatFaceOutline, region: StatedRegion, cells: Sequence[Json], size: float) -> bool:
    """Return whether polygons in the plane of a flat face leave an allowed part of it uncovered."""
    polygons = [StatedPolygonCell(cell).vertices for cell in cells]
    if any(_have_same_corners(face.corners, p, TOLERANCE * size) for p in polygons):
        return False
    if not all(_is_convex(p, face.normal, size) for p in (face.corners, *polygons)):
        raise NotCheckedError("a face that is not convex, under constraints")
    pieces = [face.corners]
    for polygon in polygons:
        pieces = [part for piece in pieces for part in _outside(piece, *_polygon_sides(polygon, face.normal))]
    for A, b, radius in region.inside:
        for direction, offset in zip(A, b + radius * (A @ face.normal), strict=True):
            pieces = [clip_below(piece, piece @ direction - offset) for piece in pieces if len(piece)]
    for forbidden in region.outside:
        pieces = [part for piece in pieces for part in _outside(piece, *forbidden)]
    return any(_is_wide(piece, TOLERANCE * size) for piece in pieces)


def _have_same_corners(corners: FloatArray, others: FloatArray, tolerance: float) -> bool:
    """Return whether two polygons have the same corners in the same cyclic order."""
    if corners.shape != others.shape:
        return False
    rotations = [np.roll(others, shift, axis=0) for shift in range(len(others))]
    return any(np.all(np.abs(corners - rotated) <= tolerance) for rotated in rotations)


def _outside(piece: FloatArray, A: FloatArray, b: FloatArray) -> list[FloatArray]:
    """Return convex pieces that cover the part of a convex piece outside the convex region ``A p <= b``."""
    parts = []
    for direction, offset in zip(A, b, strict=True):
        if len(piece) < 2:
            break
        height = piece @ direction - offset
        parts.append(clip_below(piece, -height))
        piece = clip_below(piece, height)
    return [part for part in parts if len(part) >= 2]


def _polygon_sides(polygon: FloatArray, normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return outward unit normals and offsets of a convex polygon's sides, or of a segment's ends."""
    if len(polygon) == 2:
        direction = (polygon[1] - polygon[0]) / np.linalg.norm(polygon[1] - polygon[0])
        return np.stack([direction, -direction]), np.array([direction @ polygon[1], -direction @ polygon[0]])
    edges = np.roll(polygon, -1, axis=0) - polygon
    has_length = np.linalg.norm(edges, axis=1) > 0.0
    outward = np.cross(edges[has_length], normal)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    if np.sum(outward * (polygon[has_length] - polygon.mean(axis=0))) < 0.0:
        outward = -outward
    return outward, np.sum(outward * polygon[has_length], axis=1)


def _is_convex(polygon: FloatArray, normal: FloatArray, size: float) -> bool:
    """Return whether a polygon in a plane with this normal is convex, up to rounding."""
    A, b = _polygon_sides(polygon, normal)
    return bool(np.all(polygon @ A.T <= b + TOLERANCE * size))


def _is_wide(piece: FloatArray, least_width: float) -> bool:
    """Return whether a convex piece is wider than ``least_width`` in every direction of its plane.

    The width is the least singular value of the corners' positions about their mean.
    """
    if len(piece) < 2:
        return False
    singular_values = np.linalg.svd(piece - piece.mean(axis=0), compute_uv=False)
    return bool(singular_values[min(len(singular_values), piece.shape[1] - 1) - 1] > least_width)


def _members(root: Json) -> Iterator[Json]:
    """Yield the cells that form a root cell: the members of a union, or the cell itself."""
    if root["kind"] != "bundle":
        yield root
        return
    for member in root["members"]:
        yield from _members(member)


def is_among(cell: Json, others: Sequence[Json], size: float) -> bool:
    """Return whether a cell equals one of several others, up to rounding."""
    return any(_are_equal_cells(cell, other, TOLERANCE * max(size, 1.0)) for other in others)


def _are_equal_cells(cell: Json, other: Json, tolerance: float) -> bool:
    """Return whether two cells have the same kind and, within a tolerance, equal numbers."""
    if cell["kind"] != other["kind"]:
        return False
    for name, value in cell.items():
        if name == "body":
            if value != other[name]:
                return False
        elif name != "kind":
            values, other_values = np.asarray(value, dtype=float), np.asarray(other[name], dtype=float)
            if values.shape != other_values.shape or not np.all(np.abs(values - other_values) <= tolerance):
                return False
    return True


def faces_of(body: Json, margin: float) -> Faces:
    """Return the faces of a body by name, each reduced by a margin (metres) along its sharp edges.

    Edges sharper than 30 degrees have the margin. Faces that vanish are omitted; a mesh is not reduced.
    """
    kind = body["type"]
    if kind == "mesh":
        return {"surface": None}
    return dict(FACE_MAKERS[kind](body, margin) if kind in FACE_MAKERS else chart_faces(body))


def _box_outlines(body: Json, margin: float) -> Iterator[NamedFace]:
    """Yield name and outline of each face of a box."""
    half = array("extents", body["extents"], (3,)) / 2.0
    signs = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    for axis, sign in product(range(3), (1.0, -1.0)):
        half_sides = np.delete(half, axis) - margin
        if np.all(half_sides > 0.0):
            corners = np.insert(signs * half_sides, axis, sign * half[axis], axis=1)
            yield ("+" if sign > 0.0 else "-") + "xyz"[axis], FlatFaceOutline(corners, -sign * np.eye(3)[axis])


def _polygon_outlines(body: Json, margin: float) -> Iterator[NamedFace]:
    """Yield name and outline of each edge of a polygon."""
    for i, edge in _edge_outlines(array("vertices", body["vertices"], (None, 2)), margin):
        yield f"edge{i}", edge


def _edge_outlines(corners: FloatArray, margin: float) -> Iterator[tuple[int, FlatFaceOutline]]:
    """Yield index and outline of each edge of a counter-clockwise polygon (m, 2)."""
    directions = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(directions, axis=1)
    directions /= lengths[:, None]
    is_sharp = np.sum(np.roll(directions, 1, axis=0) * directions, axis=1) < SHARP_COSINE  # at each corner
    for i, (start, direction) in enumerate(zip(corners, directions, strict=True)):
        low, high = margin * is_sharp[i], lengths[i] - margin * is_sharp[(i + 1) % len(corners)]
        if low < high:
            yield (
                i,
                FlatFaceOutline(
                    np.stack([start + low * direction, start + high * direction]),
                    np.array([-direction[1], direction[0]]),
                ),
            )


def _prism_outlines(body: Json, margin: float) -> Iterator[NamedFace]:
    """Yield name and outline of each face of a prism."""
    corners = array("polygon", body["polygon"], (None, 2))
    half = number("height", body["height"], above=0.0) / 2.0
    for i, edge in _edge_outlines(corners, margin) if half > margin else ():
        low, high = (np.column_stack([edge.corners, np.full(2, z)]) for z in (margin - half, half - margin))
        yield f"side{i}", FlatFaceOutline(np.concatenate([low, high[::-1]]), np.append(edge.normal, 0.0))
    outline = corners
    for _, edge in _edge_outlines(corners, 0.0) if margin > 0.0 else ():
        outline = clip_below(outline, margin - (outline - edge.corners[0]) @ edge.normal)
        if len(outline) < 3:
            return
    for name, sign in (("top", 1.0), ("bottom", -1.0)):
        corners_of_end = np.column_stack([outline, np.full(len(outline), sign * half)])
        yield name, FlatFaceOutline(corners_of_end, np.array([0.0, 0.0, -sign]))


def _ellipsoid_outlines(body: Json, margin: float) -> Iterator[NamedFace]:
    """Yield name and cells of the only face of a sphere or ellipsoid: its eight octants."""
    del margin
    axes = [body["radius"]] * 3 if body["type"] == "sphere" else body["semi_axes"]
    octants = [np.diag(signs).tolist() for signs in product((1.0, -1.0), repeat=3)]
    yield "surface", [{"kind": "ellipsoid", "corners": octant, "semi_axes": axes} for octant in octants]


def _cylinder_outlines(body: Json, margin: float) -> Iterator[NamedFace]:
    """Yield name and cells of each face of a cylinder: sectors of equal angle."""
    radius, half = body["radius"], body["height"] / 2.0
    if half > margin:
        side = {"kind": "revolved", "radii": [0.0, radius], "along": [margin - half, half - margin]}
        yield "side", [{**side, "angles": angles} for angles in _divided_turn("revolved")]
    for name, sign in (("top", 1.0), ("bottom", -1.0)) if radius > margin else ():
        disc = {"kind": "sector", "radii": [0.0, radius - margin], "height": sign * half, "normal": [0.0, 0.0, -sign]}
        yield name, [{**disc, "angles": angles} for angles in _divided_turn("sector")]


def _torus_outlines(body: Json, margin: float) -> Iterator[NamedFace]:
    """Yield name and cells of the only face of a torus: patches of equal angles."""
    del margin
    torus = {"kind": "revolved", "radii": [body["major_radius"], body["minor_radius"]]}
    tube_angles = [[angle - np.pi for angle in angles] for angles in _divided_turn("revolved")]
    yield (
        "surface",
        [
            {**torus, "angles": angles, "along": angle}
            for angles, angle in product(_divided_turn("revolved"), tube_angles)
        ],
    )


def _divided_turn(kind: str) -> list[list[float]]:
    """Return the intervals, radians, into which a full turn is initially divided for a kind of cell."""
    ends = np.linspace(0.0, 2.0 * np.pi, DIVISIONS[kind] + 1).tolist()
    return [ends[i : i + 2] for i in range(DIVISIONS[kind])]


FACE_MAKERS = {
    "box": _box_outlines,
    "polygon": _polygon_outlines,
    "prism": _prism_outlines,
    "sphere": _ellipsoid_outlines,
    "ellipsoid": _ellipsoid_outlines,
    "cylinder": _cylinder_outlines,
    "torus": _torus_outlines,
}
