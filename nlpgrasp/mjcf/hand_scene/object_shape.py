"""What the object collides as: the primitive that it is, or convex pieces."""

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

CONVEX = 0.999  # of its hull's volume: a body that counts as convex
CONCAVITY, PIECES, SEED = 0.02, 64, 0  # how far pieces may be from convex (relative, as coacd has it), and how many
LOOK = {"rgba": "0.56 0.64 0.71 1"}

DECOMPOSING = "decomposing the body into convex pieces ..."
_last: dict[bytes, list[FloatArray]] = {}  # the pieces of the last body: a simulation asks for them twice

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
    """Add to the object's MJCF body what it collides as, and return how many geoms that are.

    Boxes, spheres, ellipsoids and cylinders are MuJoCo's own; a convex body is its hull, any other convex pieces of
    its triangles (Wei et al. 2022, doi:10.1145/3528223.3530103).

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
        When a body that is not convex has to be taken apart without coacd (extra ``sim``).
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
    """Return the corners (m, 3) of convex pieces that make up a body of triangles, metres.

    Parameters
    ----------
    shape : Triangles
    progress : callable, optional
        Told in words before coacd begins; not told where there is one piece, or the same body comes again.

    Raises
    ------
    MissingExtraError
        When there has to be more than one piece and coacd is not installed.
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
