"""Check that the root cells of a certificate cover the faces that a contact may use.

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
from nlpgrasp.verify.bound.stated_cells import StatedPolygonCell, clip_below, read_cell
from nlpgrasp.verify.bound.stated_regions import StatedRegion
from nlpgrasp.verify.check import NotCheckedError

TURNS = {"sector": 8, "revolved": 4}  # initial divisions of a full turn
COSINE = 0.75**0.5  # of 30 degrees: a corner that turns by more is sharp
SAME = 1e-9  # tolerance relative to the body's size

Faces = dict[str, "FlatFaceOutline | list[Json] | None"]
"""Of each face its outline, or cells that cover it; None of a mesh, whose triangles are in a file of their own."""
Named = tuple[str, "FlatFaceOutline | list[Json]"]


@dataclass(frozen=True)
class FlatFaceOutline:
    """A flat face: a polygon, or a segment, with one normal.

    Parameters
    ----------
    corners : (m, space) array
        In order, metres.
    normal : (space,) array
        Unit, into the body.
    """

    corners: FloatArray
    normal: FloatArray


def uncovered_faces(faces: Faces, own: StatedRegion, roots: Sequence[Json], size: float) -> list[str]:
    """Return the faces with an allowed part that no root cell covers; meshes are not checked here."""
    members = [cell for root in roots for cell in _members(root)]
    missing = []
    for name, face in faces.items():
        if name not in own.faces or face is None:
            continue
        if isinstance(face, FlatFaceOutline):
            left = _is_uncovered(face, own, [m for m in members if _is_in_plane(m, face, size)], size)
        else:
            left = not all(own.exclude(read_cell(c), SAME * size) or is_among(c, members, size) for c in face)
        missing += [name] if left else []
    return missing


def _is_in_plane(cell: Json, face: FlatFaceOutline, size: float) -> bool:
    """Return whether a cell is a polygon in the plane of a face, with its normal."""
    if cell["kind"] != "polygon":
        return False
    polygon = StatedPolygonCell(cell)
    if polygon.vertices.shape[1] != len(face.normal) or not np.all(np.abs(polygon.normal - face.normal) <= SAME):
        return False
    return bool(np.all(np.abs((polygon.vertices - face.corners[0]) @ face.normal) <= SAME * size))


def _is_uncovered(face: FlatFaceOutline, own: StatedRegion, cells: Sequence[Json], size: float) -> bool:
    """Return whether an allowed part of a flat face is left outside polygons in its plane."""
    polygons = [StatedPolygonCell(cell).vertices for cell in cells]
    if any(_same_corners(face.corners, p, SAME * size) for p in polygons):
        return False
    if not all(_convex(p, face.normal, size) for p in (face.corners, *polygons)):
        raise NotCheckedError("a face that is not convex, under constraints")
    left = [face.corners]
    for polygon in polygons:
        left = [part for piece in left for part in _outside(piece, *_polygon_sides(polygon, face.normal))]
    for A, b, radius in own.inside:
        for row, offset in zip(A, b + radius * (A @ face.normal), strict=True):
            left = [clip_below(piece, piece @ row - offset) for piece in left if len(piece)]
    for hole in own.outside:
        left = [part for piece in left for part in _outside(piece, *hole)]
    return any(_wide(piece, SAME * size) for piece in left)


def _same_corners(corners: FloatArray, others: FloatArray, tolerance: float) -> bool:
    """Return whether two polygons have the same corners in the same cyclic order."""
    if corners.shape != others.shape:
        return False
    turns = [np.roll(others, shift, axis=0) for shift in range(len(others))]
    return any(np.all(np.abs(corners - turned) <= tolerance) for turned in turns)


def _outside(piece: FloatArray, A: FloatArray, b: FloatArray) -> list[FloatArray]:
    """Return convex pieces that cover the part of a convex piece outside a convex region ``A p <= b``."""
    parts = []
    for row, offset in zip(A, b, strict=True):
        if len(piece) < 2:
            break
        height = piece @ row - offset
        parts.append(clip_below(piece, -height))
        piece = clip_below(piece, height)
    return [part for part in parts if len(part) >= 2]


def _polygon_sides(polygon: FloatArray, normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return outward unit normals and offsets of the sides of a convex polygon, or of the ends of a segment."""
    if len(polygon) == 2:
        along = (polygon[1] - polygon[0]) / np.linalg.norm(polygon[1] - polygon[0])
        return np.stack([along, -along]), np.array([along @ polygon[1], -along @ polygon[0]])
    edges = np.roll(polygon, -1, axis=0) - polygon
    long = np.linalg.norm(edges, axis=1) > 0.0
    outward = np.cross(edges[long], normal)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    if np.sum(outward * (polygon[long] - polygon.mean(axis=0))) < 0.0:
        outward = -outward
    return outward, np.sum(outward * polygon[long], axis=1)


def _convex(polygon: FloatArray, normal: FloatArray, size: float) -> bool:
    A, b = _polygon_sides(polygon, normal)
    return bool(np.all(polygon @ A.T <= b + SAME * size))


def _wide(piece: FloatArray, least: float) -> bool:
    """Return whether a convex piece is wider than a length in every direction; for a segment, longer."""
    if len(piece) < 2:
        return False
    spread = np.linalg.svd(piece - piece.mean(axis=0), compute_uv=False)
    return bool(spread[min(len(spread), piece.shape[1] - 1) - 1] > least)


def _members(root: Json) -> Iterator[Json]:
    """Yield the member cells of a root cell."""
    if root["kind"] != "bundle":
        yield root
        return
    for member in root["members"]:
        yield from _members(member)


def is_among(cell: Json, others: Sequence[Json], size: float) -> bool:
    """Return whether a cell equals one of others, up to rounding."""
    return any(_are_equal_cells(cell, other, SAME * max(size, 1.0)) for other in others)


def _are_equal_cells(cell: Json, other: Json, tolerance: float) -> bool:
    if cell["kind"] != other["kind"]:
        return False
    for name, value in cell.items():
        if name != "kind":
            mine, given = np.asarray(value, dtype=float), np.asarray(other[name], dtype=float)
            if mine.shape != given.shape or not np.all(np.abs(mine - given) <= tolerance):
                return False
    return True


def faces_of(body: Json, margin: float) -> Faces:
    """Return the faces of a body by name, drawn back by a margin, metres, from edges sharper than 30 degrees.

    Faces that vanish are left out; a mesh is not drawn back.
    """
    kind = body["type"]
    if kind == "mesh":
        return {"surface": None}
    if kind not in MAKERS:
        raise NotCheckedError(f"nothing recomputes the cells of a {kind}")
    return dict(MAKERS[kind](body, margin))


def _box_outlines(body: Json, margin: float) -> Iterator[Named]:
    half = array("extents", body["extents"], (3,)) / 2.0
    around = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    for axis, sign in product(range(3), (1.0, -1.0)):
        within = np.delete(half, axis) - margin
        if np.all(within > 0.0):
            corners = np.insert(around * within, axis, sign * half[axis], axis=1)
            yield ("+" if sign > 0.0 else "-") + "xyz"[axis], FlatFaceOutline(corners, -sign * np.eye(3)[axis])


def _polygon_outlines(body: Json, margin: float) -> Iterator[Named]:
    for i, edge in _edge_outlines(array("vertices", body["vertices"], (None, 2)), margin):
        yield f"edge{i}", edge


def _edge_outlines(corners: FloatArray, margin: float) -> Iterator[tuple[int, FlatFaceOutline]]:
    """Yield the edges of a counter-clockwise polygon (m, 2), with their numbers."""
    along = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(along, axis=1)
    along /= lengths[:, None]
    sharp = np.sum(np.roll(along, 1, axis=0) * along, axis=1) < COSINE  # at each corner
    for i, (start, unit) in enumerate(zip(corners, along, strict=True)):
        low, high = margin * sharp[i], lengths[i] - margin * sharp[(i + 1) % len(corners)]
        if low < high:
            yield i, FlatFaceOutline(np.stack([start + low * unit, start + high * unit]), np.array([-unit[1], unit[0]]))


def _prism_outlines(body: Json, margin: float) -> Iterator[Named]:
    corners = array("polygon", body["polygon"], (None, 2))
    half = number("height", body["height"], above=0.0) / 2.0
    for i, edge in _edge_outlines(corners, margin) if half > margin else ():
        low, high = (np.column_stack([edge.corners, np.full(2, z)]) for z in (margin - half, half - margin))
        yield f"side{i}", FlatFaceOutline(np.concatenate([low, high[::-1]]), np.append(edge.normal, 0.0))
    inside = corners
    for _, edge in _edge_outlines(corners, 0.0) if margin > 0.0 else ():
        inside = clip_below(inside, margin - (inside - edge.corners[0]) @ edge.normal)
        if len(inside) < 3:
            return
    for name, sign in (("top", 1.0), ("bottom", -1.0)):
        level = np.column_stack([inside, np.full(len(inside), sign * half)])
        yield name, FlatFaceOutline(level, np.array([0.0, 0.0, -sign]))


def _ellipsoid_outlines(body: Json, margin: float) -> Iterator[Named]:
    del margin
    axes = [body["radius"]] * 3 if body["type"] == "sphere" else body["semi_axes"]
    octants = [np.diag(signs).tolist() for signs in product((1.0, -1.0), repeat=3)]
    yield "surface", [{"kind": "ellipsoid", "corners": octant, "semi_axes": axes} for octant in octants]


def _cylinder_outlines(body: Json, margin: float) -> Iterator[Named]:
    radius, half = body["radius"], body["height"] / 2.0
    if half > margin:
        side = {"kind": "revolved", "radii": [0.0, radius], "along": [margin - half, half - margin]}
        yield "side", [{**side, "angles": angles} for angles in _turn_outline("revolved")]
    for name, sign in (("top", 1.0), ("bottom", -1.0)) if radius > margin else ():
        disc = {"kind": "sector", "radii": [0.0, radius - margin], "height": sign * half, "normal": [0.0, 0.0, -sign]}
        yield name, [{**disc, "angles": angles} for angles in _turn_outline("sector")]


def _torus_outlines(body: Json, margin: float) -> Iterator[Named]:
    del margin
    whole = {"kind": "revolved", "radii": [body["major_radius"], body["minor_radius"]]}
    ways = [[t - np.pi for t in turn] for turn in _turn_outline("revolved")]
    yield "surface", [{**whole, "angles": a, "along": t} for a, t in product(_turn_outline("revolved"), ways)]


def _turn_outline(kind: str) -> list[list[float]]:
    ends = np.linspace(0.0, 2.0 * np.pi, TURNS[kind] + 1).tolist()
    return [ends[i : i + 2] for i in range(TURNS[kind])]


MAKERS = {
    "box": _box_outlines,
    "polygon": _polygon_outlines,
    "prism": _prism_outlines,
    "sphere": _ellipsoid_outlines,
    "ellipsoid": _ellipsoid_outlines,
    "cylinder": _cylinder_outlines,
    "torus": _torus_outlines,
}
