"""Signed distances from bodies at many points."""

from __future__ import annotations

from collections.abc import Callable

from nlpgrasp.common.meshes.search_tree import SearchTree
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.verify.bodies.mesh import MeshSurface
from nlpgrasp.verify.placement import Surface

Distance = Callable[[FloatArray], FloatArray]


def fast_distance(surface: Surface) -> Distance:
    """Return the signed distance from a body, points (m, space) to metres; from a mesh by its search tree."""
    if isinstance(surface, MeshSurface):
        return SearchTree(surface.triangles.vertices, surface.triangles.faces).clearance
    return surface.distance
