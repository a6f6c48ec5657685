"""Union of a mesh's parts by manifold3d, without closed cavities."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.common.meshes.crossings import meeting_boxes
from nlpgrasp.common.meshes.parts import Parts, with_own_vertices
from nlpgrasp.common.meshes.search_tree import IntArray
from nlpgrasp.common.validation import FloatArray

SAME = 1e-9  # relative change of area and volume below which parts do not overlap
FINEST = 1e-7  # of the size: edge length below which edges of a union are due to rounding
SMALLEST = 1e-300

Triangles = tuple[FloatArray, IntArray]


def outer_union(parts: Parts, grown: float = 0.0) -> tuple[Triangles, int] | None:
    """Return the outer surface of the union of the solid parts, and the number of closed cavities.

    The parts must be oriented outwards. All other triangles are appended unchanged.

    Parameters
    ----------
    parts : Parts
    grown : float
        Outward offset of the solid parts' vertices, which makes touching parts overlap, metres.

    Returns
    -------
    triangles : tuple of (v, 3) array and (f, 3) int array
        Vertices, metres, and triangles.
    hollows : int
        Number of closed cavities of the union, which are removed.
        None for both if the parts do not overlap, or manifold3d rejects one of them.
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
    if hollows:  # shells inside cavities are then inside another shell
        joined = with_own_vertices(found.vertices, found.faces[np.isin(found.labels, outside)])
        joined = _joined([found.mesh_of(part) for part in outside.tolist()], finest) or joined
    loose = np.flatnonzero(~np.isin(parts.labels, solid))
    if len(loose):
        vertices, faces = with_own_vertices(parts.vertices, parts.faces[loose])
        joined = np.concatenate([joined[0], vertices]), np.concatenate([joined[1], faces + len(joined[0])])
    return joined, hollows


def _grown(vertices: FloatArray, faces: IntArray, by: float) -> Triangles:
    """Return a shell offset outwards along area-weighted vertex normals."""
    if by == 0.0:
        return vertices, faces
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    across = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    normal = np.stack([np.bincount(faces.ravel(), across[:, i], len(vertices)) for i in range(3)], axis=1)
    return vertices + by * normal / np.maximum(np.linalg.norm(normal, axis=1), SMALLEST)[:, None], faces


def _joined(shells: Sequence[Triangles], finest: float) -> Triangles | None:
    """Return the union of closed outward shells, simplified within ``finest``, metres.

    None if manifold3d rejects a shell, or if nothing overlaps: the union has the area and volume of all together.
    trimesh's interface to manifold3d uses single precision, which would move every vertex.
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
