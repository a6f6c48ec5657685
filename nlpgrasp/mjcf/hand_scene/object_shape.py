"""Collision geoms of the object: primitives or convex decomposition."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import import_module
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from nlpgrasp.common.shown.drawing import Triangles
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import MissingExtraError
from nlpgrasp.mjcf.parts import numbers

CONVEX = 0.999  # of its hull's volume: volume above which a body counts as convex
CONCAVITY, PIECES, SEED = 0.02, 64, 0  # coacd: concavity threshold (relative), most pieces, seed
LOOK = {"rgba": "0.56 0.64 0.71 1"}

DECOMPOSING = "decomposing the body into convex pieces ..."
_last: dict[bytes, list[FloatArray]] = {}  # cache of the last body's pieces, which a simulation needs twice

Told = Callable[[str], None]
Size = Callable[[Json], Iterable[float]]
PRIMITIVES: dict[str, tuple[str, Size]] = {
    "box": ("box", lambda body: np.asarray(body["extents"], float) / 2.0),
    "sphere": ("sphere", lambda body: [body["radius"]]),
    "ellipsoid": ("ellipsoid", lambda body: body["semi_axes"]),
    "cylinder": ("cylinder", lambda body: [body["radius"], body["height"] / 2.0]),
}


def add_object_geoms(
    asset: Element,
    body: Element,
    stated: Json,
    drawn: Triangles,
    surface: dict[str, str],
    progress: Told | None = None,
) -> int:
    """Add the collision geoms to the object's MJCF body, and return their number.

    Boxes, spheres, ellipsoids and cylinders are MuJoCo primitives; a convex body is its hull; any other is decomposed
    into convex pieces (Wei et al. 2022, doi:10.1145/3528223.3530103).

    Parameters
    ----------
    asset, body : Element
    stated : mapping
        The body as JSON data.
    drawn : Triangles
        Its surface.
    surface : mapping
        Attributes of each geom: its friction.
    progress : callable, optional
        As for ``convex_pieces``.

    Raises
    ------
    MissingExtraError
        When a body has to be decomposed and coacd (extra ``sim``) is not installed.
    """
    known = PRIMITIVES.get(str(stated.get("type")))
    if known is not None:
        kind, size = known
        SubElement(body, "geom", {"name": "object", "type": kind, "size": numbers(size(stated)), **LOOK, **surface})
        return 1
    pieces = convex_pieces(drawn, progress)
    for i, vertices in enumerate(pieces):
        name = f"object_{i}"
        SubElement(asset, "mesh", name=name, vertex=numbers(vertices.ravel()))
        SubElement(body, "geom", {"name": name, "type": "mesh", "mesh": name, **LOOK, **surface})
    return len(pieces)


def convex_pieces(shape: Triangles, progress: Told | None = None) -> list[FloatArray]:
    """Return the vertices (m, 3), metres, of the pieces of a convex decomposition of a triangulated body.

    Parameters
    ----------
    shape : Triangles
    progress : callable, optional
        Called with a message before coacd runs; not for a convex or cached body.

    Raises
    ------
    MissingExtraError
        When more than one piece is needed and coacd is not installed.
    """
    import trimesh

    mesh = trimesh.Trimesh(shape.vertices, shape.faces)
    hull = mesh.convex_hull
    if mesh.is_watertight and mesh.volume > CONVEX * hull.volume:
        return [np.asarray(hull.vertices)]
    try:
        coacd = import_module("coacd")
    except ImportError:
        raise MissingExtraError("convex pieces of a body that is not convex (coacd)", "sim") from None
    vertices, faces = np.asarray(shape.vertices), np.asarray(shape.faces)
    key = vertices.tobytes() + faces.tobytes()
    pieces = _last.get(key)
    if pieces is None:
        if progress is not None:
            progress(DECOMPOSING)
        coacd.set_log_level("error")
        given = coacd.Mesh(vertices, faces)
        found = coacd.run_coacd(given, threshold=CONCAVITY, max_convex_hull=PIECES, seed=SEED)
        pieces = [np.asarray(corners, dtype=float) for corners, _ in found]
        _last.clear()
        _last[key] = pieces
    return list(pieces)
