"""Outer surface of a mesh: oriented, united parts without cavities and buried triangles."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.meshes.parts import Parts
from nlpgrasp.common.meshes.search_tree import IntArray
from nlpgrasp.common.meshes.unburied import without_buried
from nlpgrasp.common.meshes.union import outer_union
from nlpgrasp.common.meshes.winding import OPEN_SHARE, buried_share, unclear_share
from nlpgrasp.common.stored.cache import kept
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError

GROWN = 2e-6  # of the size: outward offset that makes touching parts overlap
MOST_BURIED = 5e-4  # of the surface area: buried share that is tolerated


def outer_surface(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray, tuple[str, ...]]:
    """Return vertices (v, 3) and triangles (f, 3) of a mesh's outer surface, and the repairs as sentences.

    A mesh that is its own outer surface is returned unchanged. Results are cached.

    Parameters
    ----------
    vertices : (v, 3) array
        Metres, without duplicates.
    faces : (f, 3) int array

    Raises
    ------
    InputError
        When overlapping parts cannot be united and the remaining surface has an ambiguous inside.
    """
    found = kept("outer", [vertices, faces], lambda: _found(vertices, faces))
    notes = tuple(bytes(found["notes"].astype(np.uint8)).decode().splitlines())
    if not notes:
        return vertices, faces, ()
    return found["vertices"], np.asarray(found["faces"], dtype=np.int64), notes


def _found(vertices: FloatArray, faces: IntArray) -> dict[str, FloatArray]:
    """Return the outer surface as arrays for the cache; no triangles if it is unchanged."""
    notes: list[str] = []
    parts = Parts(vertices, faces)
    hollows = parts.cavities()
    parts = _facing_outwards(parts, hollows, notes)
    parts = _without_buried(_joined(parts, hollows, notes), notes)
    said = np.frombuffer("\n".join(notes).encode(), dtype=np.uint8).astype(float)
    return {"notes": said, "vertices": parts.vertices, "faces": parts.faces.astype(float)} if notes else {"notes": said}


def _facing_outwards(parts: Parts, hollows: IntArray, notes: list[str]) -> Parts:
    """Return the parts with all closed ones, cavity walls included, oriented outwards.

    For a mesh of one part or without closed parts, all triangles are reversed or none.
    """
    if len(parts.volumes) > 1 and len(solid := parts.solid):
        inwards = solid[parts.volumes[solid] < 0.0]
        wrong, every = np.setdiff1d(inwards, hollows), np.setdiff1d(solid, hollows)
    else:
        wrong = every = inwards = np.arange(len(parts.volumes) if parts.volumes.sum() < 0.0 else 0)
    if not len(inwards):
        return parts
    if len(wrong) == len(every):
        notes.append("turned inside out: the triangles faced inwards")
    elif len(wrong):
        notes.append(f"turned {len(wrong)} of {len(every)} parts inside out: their triangles faced inwards")
    turned = np.isin(parts.labels, inwards)
    return Parts(parts.vertices, np.where(turned[:, None], parts.faces[:, ::-1], parts.faces))


def _joined(parts: Parts, hollows: IntArray, notes: list[str]) -> Parts:
    """Return the union of the parts; touching parts are offset outwards so that they overlap."""
    united, how = outer_union(parts), ""
    if len(parts.volumes) > 1 and _buried(Parts(*united[0]) if united else parts) > MOST_BURIED:
        by = GROWN * float(np.linalg.norm(np.ptp(parts.vertices, axis=0)))
        grown = outer_union(parts, by)
        if grown is not None and _buried(Parts(*grown[0])) <= MOST_BURIED:
            united, how = grown, f", grown by {by:.1g} m so that those that touch overlap"
    if united is None:
        return parts
    if len(parts.solid) - len(hollows) > 1:
        notes.append(f"joined {len(parts.solid) - len(hollows)} parts{how}: the outer surface of their union is left")
    closed = len(hollows) + united[1]
    if closed:
        walls = "a closed hollow" if closed == 1 else f"{closed} closed hollows"
        notes.append(f"left out the walls of {walls}: no finger gets there, and the body counts as filled")
    return Parts(*united[0])


def _without_buried(parts: Parts, notes: list[str]) -> Parts:
    """Return the mesh without buried triangles; raise if its inside is then ambiguous."""
    share = _buried(parts)
    if share <= MOST_BURIED:
        return parts
    left = Parts(*without_buried(parts.vertices, parts.faces))
    if not len(left.faces) or unclear_share(left.vertices, left.faces) > OPEN_SHARE or _buried(left) > MOST_BURIED:
        raise InputError(
            "Mesh.mesh",
            f"a surface with {share:.2g} of its area inside the body, which cannot be parted from the rest",
            "parts that are closed, or joined to one closed surface",
        )
    notes.append(f"left out triangles inside the body: {share:.2g} of the area was buried")
    return left


def _buried(parts: Parts) -> float:
    return buried_share(parts.vertices, parts.faces)
