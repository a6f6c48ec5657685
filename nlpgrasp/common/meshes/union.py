"""The union of a mesh's parts, from manifold3d, without what no finger can reach."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.common.meshes.crossings import meeting_boxes
from nlpgrasp.common.meshes.parts import Parts, with_own_vertices
from nlpgrasp.common.meshes.search_tree import IntArray
from nlpgrasp.common.validation import FloatArray

SAME = 1e-9  # of area and volume: parts that overlap by less do not
FINEST = 1e-7  # of the size: shorter edges of a union come from rounding
SMALLEST = 1e-300

Triangles = tuple[FloatArray, IntArray]


def outer_union(parts: Parts, grown: float = 0.0) -> tuple[Triangles, int] | None:
    """Return the outer surface of the union of the solid parts, and how many hollows between them are walled in.

    The parts have to face outwards. Other triangles than theirs follow unchanged.

    Parameters
    ----------
    parts : Parts
    grown : float
        How far the vertices of the solid parts move outwards first, so that parts that touch up to rounding overlap,
        metres.

    Returns
    -------
    triangles : tuple of (v, 3) array and (f, 3) int array
        Vertices, metres, and triangles.
    hollows : int
        Shells of the union that no way leads to from outside: left out.
        None for both where the parts do not overlap, or manifold3d cannot use one of them.
    """
    if len(parts.volumes) < 2 or len(solid := parts.solid) < 2:
        return None
    lower, upper = parts.boxes()
    if not len(meeting_boxes(lower[solid] - grown, upper[solid] + grown)):
        return None
    finest = max(FINEST * float(np.linalg.norm(np.ptp(parts.vertices, axis=0))), grown)
    joined = _joined([_grown(*parts.mesh_of(part), grown) for part in solid.tolist()], finest)
    if joined is None:
        return None
    found = Parts(*joined)
    outside = np.flatnonzero(found.volumes > 0.0)
    hollows = len(found.volumes) - len(outside)
    if hollows:  # what was in them is in another shell then
        joined = with_own_vertices(found.vertices, found.faces[np.isin(found.labels, outside)])
        joined = _joined([found.mesh_of(part) for part in outside.tolist()], finest) or joined
    loose = np.flatnonzero(~np.isin(parts.labels, solid))
    if len(loose):
        vertices, faces = with_own_vertices(parts.vertices, parts.faces[loose])
        joined = np.concatenate([joined[0], vertices]), np.concatenate([joined[1], faces + len(joined[0])])
    return joined, hollows


def _grown(vertices: FloatArray, faces: IntArray, by: float) -> Triangles:
    """Return a shell whose vertices moved outwards, along the mean normal of the area around them."""
    if by == 0.0:
        return vertices, faces
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    across = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    normal = np.stack([np.bincount(faces.ravel(), across[:, i], len(vertices)) for i in range(3)], axis=1)
    return vertices + by * normal / np.maximum(np.linalg.norm(normal, axis=1), SMALLEST)[:, None], faces


def _joined(shells: Sequence[Triangles], finest: float) -> Triangles | None:
    """Return the union of closed shells that face outwards, simplified within ``finest``, metres.

    None where manifold3d cannot use a shell, and where the union has the area and volume of all together: nothing of
    them overlaps. trimesh's own way to manifold3d goes over numbers of 32 bits, which would move every vertex.
    """
    import manifold3d

    each = [
        manifold3d.Manifold(manifold3d.Mesh64(np.ascontiguousarray(v), np.ascontiguousarray(f, dtype=np.uint64)))
        for v, f in shells
    ]
    if any(shell.status() != manifold3d.Error.NoError for shell in each):
        return None
    union = manifold3d.Manifold.batch_boolean(each, manifold3d.OpType.Add)
    together = np.sum([[shell.surface_area(), shell.volume()] for shell in each], axis=0)
    if union.is_empty() or np.all(np.abs([union.surface_area(), union.volume()] - together) <= SAME * together):
        return None
    mesh = union.simplify(finest).to_mesh64()
    return np.array(mesh.vert_properties, dtype=float)[:, :3], np.array(mesh.tri_verts).astype(np.int64)
