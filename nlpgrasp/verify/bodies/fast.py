"""Signed distances from bodies, tables and obstacles for many points at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from nlpgrasp.common.meshes.search_tree import SearchTree
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.verify.bodies.convex import convex_corners
from nlpgrasp.verify.bodies.mesh import MeshSurface
from nlpgrasp.verify.constraints.obstacle import in_body_frame, in_frame_of
from nlpgrasp.verify.placement import StatedPlacement, Surface

Distance = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Solid:
    """A solid that a hand may collide with.

    Parameters
    ----------
    name : str
    distance : callable
        Points (m, space), body frame, to signed distances (m,), metres, negative inside.
    clearance : float
        Required clearance of a hand, metres.
    rough : float
        Largest excess of the solver's distance over this one, metres.
    corners : (n, 3) array or None
        Corners of a convex solid in space, metres, body frame.
    """

    name: str
    distance: Distance
    clearance: float = 0.0
    rough: float = 0.0
    corners: FloatArray | None = None


def solid_body(name: str, data: Json, surface: Surface) -> Solid:
    """Return a body as a solid in its own frame.

    Parameters
    ----------
    name : str
    data : mapping
        The body's JSON data.
    surface : Surface
        The same body.
    """
    return Solid(name, fast_distance(surface), corners=convex_corners(data, surface))


def surroundings(constraints: Sequence[Json], placement: StatedPlacement) -> Iterator[Solid]:
    """Yield the tables and obstacles among constraints, as solids."""
    for data in constraints:
        if data["type"] == "table":
            clearance = number("clearance", data["clearance"], at_least=0.0)
            yield Solid("the table", partial(_above, number("height", data["height"])), clearance)
        elif data["type"] == "obstacle":
            clearance = number("clearance", data["clearance"], at_least=0.0)
            surface = placement.surface_of(data["body"])
            own = solid_body(str(data["name"]), data["body"], surface)
            corners = None if own.corners is None else in_body_frame(data, own.corners)
            yield Solid(own.name, partial(_beside, data, own.distance), clearance, surface.rough, corners)


def fast_distance(surface: Surface) -> Distance:
    """Return the signed distance function of a body, points (m, space) to metres; of a mesh by a search tree."""
    if isinstance(surface, MeshSurface):
        return SearchTree(surface.triangles.vertices, surface.triangles.faces).clearance
    return surface.distance


def _above(height: float, points: FloatArray) -> FloatArray:
    """Return the height of points (m, space) above a level along the last axis, metres."""
    return np.asarray(points[:, -1] - height)


def _beside(data: Json, distance: Distance, points: FloatArray) -> FloatArray:
    """Return the signed distance of points (m, space) from an obstacle, metres; ``distance`` is in its frame."""
    return distance(in_frame_of(data, points))
