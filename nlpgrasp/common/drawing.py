"""Triangulated drawings of body and hand, for pictures and 3D scenes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.spatial import in_space
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, IntArray, array
from nlpgrasp.errors import InputError

DIGITS = 5  # significant digits of the largest coordinate, or of the longest side if that is less
NORMAL, CONE, FORCE = 0.25, 0.22, 0.8  # drawn lengths at a contact, of the body's drawn size


@dataclass(frozen=True)
class Triangles:
    """Triangulated surface with vertices and faces.

    Parameters
    ----------
    vertices : (n, 3) array
        Metres, body frame.
    faces : (m, 3) array of int
    """

    vertices: FloatArray
    faces: IntArray

    def to_dict(self) -> Json:
        """Return the triangles as JSON data, with coordinates rounded for display."""
        longest = np.max(self.vertices, axis=0, initial=-np.inf) - np.min(self.vertices, axis=0, initial=np.inf)
        largest = max(min(float(np.max(np.abs(self.vertices), initial=0.0)), float(np.max(longest))), 1e-12)
        decimals = DIGITS - 1 - int(np.floor(np.log10(largest)))
        return {"vertices": np.round(self.vertices, decimals).tolist(), "faces": self.faces.tolist()}

    @classmethod
    def from_dict(cls, data: object, name: str) -> Triangles:
        """Return triangles from JSON data, validated."""
        if not isinstance(data, Mapping):
            raise InputError(name, data, "vertices and faces")
        vertices = array(f"{name}.vertices", data.get("vertices", ()), (None, 3))
        faces = array(f"{name}.faces", data.get("faces", ()), (None, 3))
        if len(faces) and not (np.all(faces == np.round(faces)) and 0 <= faces.min() <= faces.max() < len(vertices)):
            raise InputError(f"{name}.faces", "numbers that name no vertex", f"whole numbers below {len(vertices)}")
        return cls(vertices, faces.astype(np.int64))


@dataclass(frozen=True)
class Drawing:
    """Triangulated drawing of the body and the hand in its posture.

    Parameters
    ----------
    body : Triangles
        Approximation of the body's surface; a planar body is a thin plate.
    links : tuple of (str, Triangles)
        Collision shapes of the hand's links, by name.
    """

    body: Triangles
    links: tuple[tuple[str, Triangles], ...] = ()

    def to_dict(self) -> Json:
        """Return the drawing as JSON data."""
        links = [{"link": name, **shape.to_dict()} for name, shape in self.links]
        return {"body": self.body.to_dict(), "links": links}

    @classmethod
    def from_dict(cls, data: object, name: str) -> Drawing | None:
        """Return the drawing from JSON data; None if the data are None."""
        if data is None:
            return None
        if not isinstance(data, Mapping) or not isinstance(data.get("links", []), list):
            raise InputError(name, data, "body and links")
        body = Triangles.from_dict(data.get("body"), f"{name}.body")
        links = [
            (
                str(link.get("link")) if isinstance(link, Mapping) else "",
                Triangles.from_dict(link, f"{name}.links[{i}]"),
            )
            for i, link in enumerate(data.get("links", []))
        ]
        return cls(body, tuple(links))


def drawing_size(drawing: Drawing | None, points: FloatArray | None) -> float:
    """Return half the diagonal of the drawn body's bounding box, metres.

    It is the reference length for arrows and cones.

    Parameters
    ----------
    drawing : Drawing or None
    points : (k, 2) or (k, 3) array, or None
        Contact points, used if there is no body; 1 m without either.
    """
    if drawing is not None and len(drawing.body.vertices):
        return 0.5 * float(np.linalg.norm(np.ptp(drawing.body.vertices, axis=0)))
    corners = np.zeros((1, 3)) if points is None else in_space(points)
    return 0.5 * float(np.linalg.norm(np.ptp(corners, axis=0))) or 1.0
