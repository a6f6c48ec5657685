"""3D scene of a body: its surface and labels of its faces."""

from __future__ import annotations

import numpy as np

from nlpgrasp.bodies import Body
from nlpgrasp.bodies.mesh.triangles import triangles
from nlpgrasp.common.shown.drawing import CONE, NORMAL, Drawing, Triangles, drawn_size
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.report.scene.axes import body_axes
from nlpgrasp.report.scene.camera import FROM_ABOVE, FROM_ASIDE, framed
from nlpgrasp.report.scene.surfaces import cut, surface

MOST = 6000  # most triangles
ENOUGH = 2000  # triangles for locating the middle of a face
NAMED = 24  # most labelled faces
DOT = 0.02  # radius of the mark under a label, as a share of the body's size
DIGITS = 7  # decimals of coordinates for display, metres


def drawn_shape(body: Body) -> Triangles:
    """Return the triangles that are drawn for a body."""
    return Triangles(*triangles(body, MOST))


def scene(body: Body, shape: Triangles | None = None) -> Json:
    """Return the viewer's scene of a body; metres, body frame, in the format of ``report.scene``.

    The names of the faces are under ``contacts``; ``axes`` are those of the frame. ``shape`` is ``drawn_shape(body)``,
    if already computed.
    """
    shape = drawn_shape(body) if shape is None else shape
    size = drawn_size(Drawing(shape), None)
    low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
    axes = body_axes(low, high, size, body.space)
    seen = [framed(shape.vertices, (low + high) / 2.0, size), [axes["at"]], axes["ends"]]
    flat = body.space == 2
    return {
        "size": size,
        "flat": flat,
        "parts": [{"group": "body", "name": "body", **surface(shape).to_dict()}],
        "tables": [],
        "unseen": [],
        "contacts": _labels(body, shape),
        "palm": None,
        "arrows": [],
        "lengths": {"normal": NORMAL * size, "cone": CONE * size, "disc": DOT * size, "shaft": DOT * size, "pad": 0.0},
        "axes": axes,
        "frame": np.round(np.concatenate(seen), DIGITS).tolist(),
        "view": list(FROM_ABOVE if flat else FROM_ASIDE),
    }


def _labels(body: Body, shape: Triangles) -> list[Json]:
    """Return the labels of a body with several faces, each on its face near the middle."""
    if not 1 < len(body.faces) <= NAMED:
        return []
    corners = cut(shape, ENOUGH)
    centres, across = corners.mean(axis=1), np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(across, axis=1)
    near = np.stack([_distance(body, name, centres) for name in body.face_names])
    owner = np.argmin(near, axis=0)
    if body.space == 2:  # the plate's upper and lower sides are not faces of the body
        owner[np.abs(across[:, 2]) > 0.5 * np.maximum(areas, 1e-300)] = -1
    found = []
    for i, name in enumerate(body.face_names):
        own = np.flatnonzero((owner == i) & (areas > 0.0))
        if len(own):
            mean = np.average(centres[own], axis=0, weights=areas[own])
            at = own[np.argmin(np.linalg.norm(centres[own] - mean, axis=1))]
            found.append(_label(name, centres[at], -across[at] / areas[at]))
    return found


def _distance(body: Body, name: str, points: FloatArray) -> FloatArray:
    """Return approximate distances of points (m, 3) from a face, (m,), metres, from surface and extents."""
    h, slope, _, extent = body.evaluate(name, points[:, : body.space])
    return np.asarray(np.abs(h) / np.maximum(slope, 1e-12) + np.maximum(extent, 0.0))


def _label(name: str, at: FloatArray, inward: FloatArray) -> Json:
    place, normal = np.round(at, DIGITS).tolist(), np.round(inward, DIGITS).tolist()
    return {"at": place, "inward": normal, "tip": 0.0, "slope": None, "face": f"face {name}", "label": name}
