"""Check that the root cells of a certificate cover the faces that a contact may use."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.verify.bound.cells.bundle import cell_of
from nlpgrasp.verify.bound.cells.outlines import Faces, FlatFace
from nlpgrasp.verify.bound.cells.polygon import Polygon, below
from nlpgrasp.verify.bound.places import Places
from nlpgrasp.verify.check import NotMadeError

SAME = 1e-9  # tolerance relative to the body's size


def uncovered(faces: Faces, own: Places, roots: Sequence[Json], size: float) -> list[str]:
    """Return the faces with an allowed part that no root cell covers; meshes are not checked here."""
    members = [cell for root in roots for cell in _members(root)]
    missing = []
    for name, face in faces.items():
        if name not in own.faces or face is None:
            continue
        if isinstance(face, FlatFace):
            left = _left(face, own, [m for m in members if _on(m, face, size)], size)
        else:
            left = not all(own.exclude(cell_of(c), SAME * size) or is_among(c, members, size) for c in face)
        missing += [name] if left else []
    return missing


def _members(root: Json) -> Iterator[Json]:
    """Yield the member cells of a root cell."""
    if root["kind"] != "bundle":
        yield root
        return
    for member in root["members"]:
        yield from _members(member)


def is_among(cell: Json, others: Sequence[Json], size: float) -> bool:
    """Return whether a cell equals one of others, up to rounding."""
    return any(_alike(cell, other, SAME * max(size, 1.0)) for other in others)


def _alike(cell: Json, other: Json, tolerance: float) -> bool:
    if cell["kind"] != other["kind"]:
        return False
    for name, value in cell.items():
        if name != "kind":
            mine, given = np.asarray(value, dtype=float), np.asarray(other[name], dtype=float)
            if mine.shape != given.shape or not np.all(np.abs(mine - given) <= tolerance):
                return False
    return True


def _on(cell: Json, face: FlatFace, size: float) -> bool:
    """Return whether a cell is a polygon in the plane of a face, with its normal."""
    if cell["kind"] != "polygon":
        return False
    polygon = Polygon(cell)
    if polygon.vertices.shape[1] != len(face.normal) or not np.all(np.abs(polygon.normal - face.normal) <= SAME):
        return False
    return bool(np.all(np.abs((polygon.vertices - face.corners[0]) @ face.normal) <= SAME * size))


def _left(face: FlatFace, own: Places, cells: Sequence[Json], size: float) -> bool:
    """Return whether an allowed part of a flat face is left outside polygons in its plane."""
    polygons = [Polygon(cell).vertices for cell in cells]
    if any(_same_corners(face.corners, p, SAME * size) for p in polygons):
        return False
    if not all(_convex(p, face.normal, size) for p in (face.corners, *polygons)):
        raise NotMadeError("a face that is not convex, under constraints")
    left = [face.corners]
    for polygon in polygons:
        left = [part for piece in left for part in _outside(piece, *_sides(polygon, face.normal))]
    for A, b, radius in own.inside:
        for row, offset in zip(A, b + radius * (A @ face.normal), strict=True):
            left = [below(piece, piece @ row - offset) for piece in left if len(piece)]
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
        parts.append(below(piece, -height))
        piece = below(piece, height)
    return [part for part in parts if len(part) >= 2]


def _sides(polygon: FloatArray, normal: FloatArray) -> tuple[FloatArray, FloatArray]:
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
    A, b = _sides(polygon, normal)
    return bool(np.all(polygon @ A.T <= b + SAME * size))


def _wide(piece: FloatArray, least: float) -> bool:
    """Return whether a convex piece is wider than a length in every direction; for a segment, longer."""
    if len(piece) < 2:
        return False
    spread = np.linalg.svd(piece - piece.mean(axis=0), compute_uv=False)
    return bool(spread[min(len(spread), piece.shape[1] - 1) - 1] > least)
