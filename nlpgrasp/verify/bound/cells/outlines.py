"""Faces of each kind of body that the root cells of a certificate have to cover."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.verify.bound.cells.polygon import below
from nlpgrasp.verify.check import NotMadeError

TURNS = {"sector": 8, "revolved": 4}  # initial divisions of a full turn
COSINE = 0.75**0.5  # cosine of 30 degrees, the least angle of a sharp corner
Faces = dict[str, "FlatFace | list[Json] | None"]
"""Of each face its outline, or cells that cover it; None of a mesh, whose triangles are in a file of their own."""
Named = tuple[str, "FlatFace | list[Json]"]


@dataclass(frozen=True)
class FlatFace:
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


def faces_of(body: Json, margin: float) -> Faces:
    """Return the faces of a body by name, drawn back by a margin, metres, from edges sharper than 30 degrees.

    Faces that vanish are left out; a mesh is not drawn back.
    """
    kind = body["type"]
    if kind == "mesh":
        return {"surface": None}
    if kind not in MAKERS:
        raise NotMadeError(f"nothing recomputes the cells of a {kind}")
    return dict(MAKERS[kind](body, margin))


def _box(body: Json, margin: float) -> Iterator[Named]:
    half = array("extents", body["extents"], (3,)) / 2.0
    around = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    for axis, sign in product(range(3), (1.0, -1.0)):
        within = np.delete(half, axis) - margin
        if np.all(within > 0.0):
            corners = np.insert(around * within, axis, sign * half[axis], axis=1)
            yield ("+" if sign > 0.0 else "-") + "xyz"[axis], FlatFace(corners, -sign * np.eye(3)[axis])


def _polygon(body: Json, margin: float) -> Iterator[Named]:
    for i, edge in _edges(array("vertices", body["vertices"], (None, 2)), margin):
        yield f"edge{i}", edge


def _edges(corners: FloatArray, margin: float) -> Iterator[tuple[int, FlatFace]]:
    """Yield the edges of a counter-clockwise polygon (m, 2), with their numbers."""
    along = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(along, axis=1)
    along /= lengths[:, None]
    sharp = np.sum(np.roll(along, 1, axis=0) * along, axis=1) < COSINE  # at each corner
    for i, (start, unit) in enumerate(zip(corners, along, strict=True)):
        low, high = margin * sharp[i], lengths[i] - margin * sharp[(i + 1) % len(corners)]
        if low < high:
            yield i, FlatFace(np.stack([start + low * unit, start + high * unit]), np.array([-unit[1], unit[0]]))


def _prism(body: Json, margin: float) -> Iterator[Named]:
    corners = array("polygon", body["polygon"], (None, 2))
    half = number("height", body["height"], above=0.0) / 2.0
    for i, edge in _edges(corners, margin) if half > margin else ():
        low, high = (np.column_stack([edge.corners, np.full(2, z)]) for z in (margin - half, half - margin))
        yield f"side{i}", FlatFace(np.concatenate([low, high[::-1]]), np.append(edge.normal, 0.0))
    inside = corners
    for _, edge in _edges(corners, 0.0) if margin > 0.0 else ():
        inside = below(inside, margin - (inside - edge.corners[0]) @ edge.normal)
        if len(inside) < 3:
            return
    for name, sign in (("top", 1.0), ("bottom", -1.0)):
        level = np.column_stack([inside, np.full(len(inside), sign * half)])
        yield name, FlatFace(level, np.array([0.0, 0.0, -sign]))


def _ellipsoid(body: Json, margin: float) -> Iterator[Named]:
    del margin
    axes = [body["radius"]] * 3 if body["type"] == "sphere" else body["semi_axes"]
    octants = [np.diag(signs).tolist() for signs in product((1.0, -1.0), repeat=3)]
    yield "surface", [{"kind": "ellipsoid", "corners": octant, "semi_axes": axes} for octant in octants]


def _cylinder(body: Json, margin: float) -> Iterator[Named]:
    radius, half = body["radius"], body["height"] / 2.0
    if half > margin:
        side = {"kind": "revolved", "radii": [0.0, radius], "along": [margin - half, half - margin]}
        yield "side", [{**side, "angles": angles} for angles in _turn("revolved")]
    for name, sign in (("top", 1.0), ("bottom", -1.0)) if radius > margin else ():
        disc = {"kind": "sector", "radii": [0.0, radius - margin], "height": sign * half, "normal": [0.0, 0.0, -sign]}
        yield name, [{**disc, "angles": angles} for angles in _turn("sector")]


def _torus(body: Json, margin: float) -> Iterator[Named]:
    del margin
    whole = {"kind": "revolved", "radii": [body["major_radius"], body["minor_radius"]]}
    ways = [[t - np.pi for t in turn] for turn in _turn("revolved")]
    yield "surface", [{**whole, "angles": a, "along": t} for a, t in product(_turn("revolved"), ways)]


def _turn(kind: str) -> list[list[float]]:
    ends = np.linspace(0.0, 2.0 * np.pi, TURNS[kind] + 1).tolist()
    return [ends[i : i + 2] for i in range(TURNS[kind])]


MAKERS = {
    "box": _box,
    "polygon": _polygon,
    "prism": _prism,
    "sphere": _ellipsoid,
    "ellipsoid": _ellipsoid,
    "cylinder": _cylinder,
    "torus": _torus,
}
