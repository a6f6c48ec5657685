"""Distances of contacts from sharp edges, those at which a body's surface turns by more than 30 degrees."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from nlpgrasp.common.rows import EDGE_MARGIN
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.verify.bodies.triangles import TriangleSurface
from nlpgrasp.verify.check import NO_BODY, NotMadeError
from nlpgrasp.verify.placement import Surface
from nlpgrasp.verify.rows import RowValue

COSINE = 0.75**0.5  # cosine of 30 degrees
FLAT = 1e-12  # area over squared size below which a triangle counts as degenerate
Distance = Callable[[FloatArray], float]
"""Of a point (space,) of a face from the face's own sharp edges, metres; infinite where it has none."""


def from_corners(v: FloatArray, i: int) -> Distance:
    """Return the distance function from the sharp ends, by more than 30 degrees, of edge i of a polygon (n, 2)."""
    before, here, there, after = (v[(i + j) % len(v)] for j in (-1, 0, 1, 2))
    ends = [end for a, end, b in ((before, here, there), (here, there, after)) if _cosine(end - a, b - end) < COSINE]
    return lambda p: min((float(np.linalg.norm(p[:2] - end)) for end in ends), default=np.inf)


def sharp_segments(surface: TriangleSurface) -> FloatArray:
    """Return the ends of the edges between two triangles whose normals differ by more than 30 degrees, (m, 2, 3)."""
    faces = surface.faces
    ends = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(faces)), 3)
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    ends, owner = ends[order], owner[order]
    new = np.concatenate([[True], np.any(ends[1:] != ends[:-1], axis=1)])
    first = np.flatnonzero(new)
    twice = first[np.diff(np.append(first, len(ends))) == 2]  # edges of exactly two triangles
    one, other = owner[twice], owner[twice + 1]
    a, b, c = (surface.corners[:, i] for i in range(3))
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    solid = np.minimum(areas[one], areas[other]) > FLAT * float(np.sum(np.ptp(surface.vertices, axis=0) ** 2))
    sharp = solid & (np.sum(surface.normals[one] * surface.normals[other], axis=1) < COSINE)
    return np.asarray(surface.vertices[ends[twice[sharp]]])


def from_segments(segments: FloatArray) -> Distance:
    """Return the distance function from segments (m, 2, 3)."""
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    lengths = np.maximum(np.sum(along**2, axis=1), 1e-300)

    def distance(p: FloatArray) -> float:
        t = np.clip(np.sum((p - start) * along, axis=1) / lengths, 0.0, 1.0)
        return float(np.min(np.linalg.norm(p - start - t[:, None] * along, axis=1), initial=np.inf))

    return distance


def margin_rows(problem: Json, faces: tuple[str, ...], grasp: Grasp, surface: Surface | None) -> Iterator[RowValue]:
    """Yield the distance of each contact from its face's sharp edges, where the problem states a margin."""
    margin = number("edge_margin", problem["edge_margin"], at_least=0.0)
    if surface is None:
        raise NotMadeError(NO_BODY)
    size = float(np.linalg.norm(surface.bounds[1] - surface.bounds[0])) / 2.0
    for i, (face, point) in enumerate(zip(faces, grasp.points, strict=True)):
        value = surface.edge_distance(face, point)
        if np.isfinite(value):
            yield RowValue(f"{EDGE_MARGIN}, finger {i}", value, margin, scale=size)


def _cosine(a: FloatArray, b: FloatArray) -> float:
    return float(a @ b) / float(np.linalg.norm(a) * np.linalg.norm(b))
