"""Outer surface of a mesh: union of its parts, without cavities and buried triangles.

Closed parts are oriented outwards and united (``outer_union``). Of parts that cannot be united, buried triangles are
removed (``exposed_surface``): a triangle that no other intersects is buried entirely or not at all. Intersected
triangles are bisected repeatedly until no piece is intersected; small pieces that still are intersected are removed,
which leaves a slit along the seam.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.common.cache import cached_arrays
from nlpgrasp.common.meshes.intersections import (
    in_plane,
    intersecting_boxes,
    intersecting_triangles,
    is_covered,
    normals_of,
    triangles_intersect,
)
from nlpgrasp.common.meshes.search_tree import OPEN_SHARE, TEST_OFFSET, buried_fraction, is_buried, unclear_fraction
from nlpgrasp.common.meshes.topology import MeshParts, drop_unused_vertices
from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray
from nlpgrasp.errors import InputError

SAME = 1e-9  # relative change of area and volume below which parts do not overlap
FINEST = 1e-7  # of the size: edge length below which edges of a union are due to rounding
SMALLEST = 1e-300  # against division by zero
SMALL = 1e-3  # of the size: length below which triangles are not bisected
MOST_PIECES = 1_000_000  # of bisected triangles
GROWN = 2e-6  # of the size: outward offset that makes touching parts overlap
MOST_BURIED = 5e-4  # of the surface area: buried share that is tolerated
MOST_LEFT = 0.01  # of the surface area: share that may seem buried beside the slits of triangles left out
HOLLOW = "left out the walls of "  # beginning of the note on closed hollows
OVERLAP = 0.5  # rise of the winding number through a wall above which it is no wall of a slit


Triangles = tuple[FloatArray, IntArray]


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
    arrays = cached_arrays("outer", [vertices, faces], lambda: _cached_outer_surface(vertices, faces))
    notes = tuple(bytes(arrays["notes"].astype(np.uint8)).decode().splitlines())
    if not notes:
        return vertices, faces, ()
    return arrays["vertices"], np.asarray(arrays["faces"], dtype=np.int64), notes


def _cached_outer_surface(vertices: FloatArray, faces: IntArray) -> dict[str, FloatArray]:
    """Return the outer surface of a mesh as arrays for the cache.

    Vertices and faces are left out if the mesh is its outer surface already.
    """
    notes: list[str] = []
    parts = _remove_sheets(MeshParts(vertices, faces), notes)
    hollows = parts.cavities()
    parts = _orient_outwards(parts, hollows, notes)
    parts = _remove_buried(_unite_parts(parts, hollows, notes), notes)
    text = np.frombuffer("\n".join(notes).encode(), dtype=np.uint8).astype(float)
    return {"notes": text, "vertices": parts.vertices, "faces": parts.faces.astype(float)} if notes else {"notes": text}


def _remove_sheets(parts: MeshParts, notes: list[str]) -> MeshParts:
    """Return the parts without closed ones that have no volume, if others have one."""
    sheets = np.setdiff1d(parts.closed, parts.solid)
    if not len(sheets) or not len(parts.solid):
        return parts
    is_sheet = np.isin(parts.labels, sheets)
    notes.append(f"triangles of sheets without volume left out: {np.count_nonzero(is_sheet)}")
    return MeshParts(*drop_unused_vertices(parts.vertices, parts.faces[~is_sheet]))


def _orient_outwards(parts: MeshParts, hollows: IntArray, notes: list[str]) -> MeshParts:
    """Return the parts with all closed ones oriented outwards, including cavity walls.

    For a mesh of one part or without closed parts, all triangles are reversed or none.
    """
    if len(parts.volumes) > 1 and len(solid := parts.solid):
        inwards = solid[parts.volumes[solid] < 0.0]
        inverted, shells = np.setdiff1d(inwards, hollows), np.setdiff1d(solid, hollows)
    else:
        inverted = shells = inwards = np.arange(len(parts.volumes) if parts.volumes.sum() < 0.0 else 0)
    if not len(inwards):
        return parts
    if len(inverted) == len(shells):
        notes.append("turned inside out: the triangles faced inwards")
    elif len(inverted):
        notes.append(f"turned {len(inverted)} of {len(shells)} parts inside out: their triangles faced inwards")
    turned = np.isin(parts.labels, inwards)
    return MeshParts(parts.vertices, np.where(turned[:, None], parts.faces[:, ::-1], parts.faces))


def _unite_parts(parts: MeshParts, hollows: IntArray, notes: list[str]) -> MeshParts:
    """Return the union of the parts.

    Touching parts are offset outwards so that they overlap.
    """
    united, remark = outer_union(parts), ""
    fraction = buried_fraction(*united[0]) if united else buried_fraction(parts.vertices, parts.faces)
    if len(parts.volumes) > 1 and fraction > MOST_BURIED:
        offset = GROWN * float(np.linalg.norm(np.ptp(parts.vertices, axis=0)))
        enlarged = outer_union(parts, offset)
        if enlarged is not None and buried_fraction(*enlarged[0]) < fraction:
            united, remark = enlarged, f", grown by {offset:.1g} m so that those that touch overlap"
    if united is None:
        return parts
    if len(parts.solid) - len(hollows) > 1:
        notes.append(
            f"joined {len(parts.solid) - len(hollows)} parts{remark}: the outer surface of their union is left"
        )
    hollow_count = len(hollows) + united[1]
    if hollow_count:
        walls = "a closed hollow" if hollow_count == 1 else f"{hollow_count} closed hollows"
        notes.append(f"{HOLLOW}{walls}: no finger gets there, and the body counts as filled")
    return MeshParts(*united[0])


def _remove_buried(parts: MeshParts, notes: list[str]) -> MeshParts:
    """Return the mesh without triangles buried in the body.

    Of a closed surface the walls of slits count as outside, however thin the slits between its parts are. Raise
    ``InputError`` if the inside is ambiguous without the buried triangles.
    """
    fraction = buried_fraction(parts.vertices, parts.faces, -np.inf if parts.open_edges else OVERLAP)
    if fraction <= MOST_BURIED:
        return parts
    exposed = MeshParts(*exposed_surface(parts.vertices, parts.faces))
    if (
        not len(exposed.faces)
        or unclear_fraction(exposed.vertices, exposed.faces) > OPEN_SHARE
        or buried_fraction(exposed.vertices, exposed.faces) > MOST_LEFT
    ):
        raise InputError(
            "Mesh.mesh",
            f"a surface with {fraction:.2g} of its area inside the body, which cannot be parted from the rest",
            "parts that are closed, or joined to one closed surface",
        )
    notes.append(f"left out triangles inside the body: {fraction:.2g} of the area was buried")
    return exposed


def outer_union(parts: MeshParts, offset: float = 0.0) -> tuple[Triangles, int] | None:
    """Return the outer surface of the union of the solid parts, and the number of closed cavities.

    The parts must be oriented outwards. All other triangles are appended unchanged.

    Parameters
    ----------
    parts : MeshParts
    offset : float
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
    if not len(intersecting_boxes(lower[solid] - offset, upper[solid] + offset)):
        return None
    finest = max(FINEST * float(np.linalg.norm(np.ptp(parts.vertices, axis=0))), offset)
    union = _unite_shells([_offset_shell(*parts.mesh_of(part), offset) for part in solid.tolist()], finest)
    if union is None:
        return None
    shells = MeshParts(*union)
    outer = np.flatnonzero(shells.volumes > 0.0)
    hollows = len(shells.volumes) - len(outer)
    if hollows:  # shells inside cavities are then inside another shell
        union = drop_unused_vertices(shells.vertices, shells.faces[np.isin(shells.labels, outer)])
        union = _unite_shells([shells.mesh_of(part) for part in outer.tolist()], finest) or union
    open_faces = np.flatnonzero(~np.isin(parts.labels, solid))
    if len(open_faces):
        vertices, faces = drop_unused_vertices(parts.vertices, parts.faces[open_faces])
        union = np.concatenate([union[0], vertices]), np.concatenate([union[1], faces + len(union[0])])
    return union, hollows


def _offset_shell(vertices: FloatArray, faces: IntArray, offset: float) -> Triangles:
    """Return a closed surface offset outwards along area-weighted vertex normals."""
    if offset == 0.0:
        return vertices, faces
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    area_normals = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    normal = np.stack([np.bincount(faces.ravel(), area_normals[:, i], len(vertices)) for i in range(3)], axis=1)
    return vertices + offset * normal / np.maximum(np.linalg.norm(normal, axis=1), SMALLEST)[:, None], faces


def _unite_shells(shells: Sequence[Triangles], finest: float) -> Triangles | None:
    """Return the union of closed surfaces that face outwards, simplified within ``finest``, metres.

    None if manifold3d rejects a shell, or if nothing overlaps: the union has the area and volume of all together.
    trimesh's interface to manifold3d uses single precision, which would move every vertex.
    """
    import manifold3d

    solids = [
        manifold3d.Manifold(manifold3d.Mesh64(np.ascontiguousarray(v), np.ascontiguousarray(f, dtype=np.uint64)))
        for v, f in shells
    ]
    if any(shell.status() != manifold3d.Error.NoError for shell in solids):
        return None
    union = manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add)
    totals = np.sum([[shell.surface_area(), shell.volume()] for shell in solids], axis=0)
    if union.is_empty() or np.all(np.abs([union.surface_area(), union.volume()] - totals) <= SAME * totals):
        return None
    mesh = union.simplify(finest).to_mesh64()
    return np.array(mesh.vert_properties, dtype=float)[:, :3], np.array(mesh.tri_verts).astype(np.int64)


def exposed_surface(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Return vertices (v, 3) and triangles (f, 3) of the part of a mesh that is not buried in the body.

    Raises
    ------
    InputError
        When too many triangles intersect.
    """
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    corners = vertices[faces]
    pairs = intersecting_triangles(vertices, faces, TEST_OFFSET * size)
    first, second = corners[pairs[:, 0]], corners[pairs[:, 1]]
    coplanar = _has_similar_normals(first, second) & (
        in_plane(first, second, TEST_OFFSET * size) | in_plane(second, first, TEST_OFFSET * size)
    )
    pairs = pairs[~(coplanar & (pairs[:, 0] < pairs[:, 1]))]
    is_free = np.ones(len(faces), dtype=bool)
    is_free[pairs[:, 0]] = False
    triangles = np.concatenate([corners[is_free], _unintersected_pieces(corners, pairs, size)])
    visible = triangles[~is_buried(vertices, faces, triangles.mean(axis=1), normals_of(triangles))]
    corner_points, vertex_indices = np.unique(visible.reshape(-1, 3), axis=0, return_inverse=True)
    return corner_points, np.asarray(vertex_indices).reshape(-1, 3).astype(np.int64)


def _unintersected_pieces(corners: FloatArray, pairs: IntArray, size: float) -> FloatArray:
    """Return the pieces (n, 3, 3) of intersecting triangles that no other triangle intersects, by bisection.

    Small pieces that are still intersected are removed.

    Pieces that lie on an earlier triangle with the same orientation are also removed.
    """
    owners: IntArray = np.unique(pairs[:, 0])
    piece: IntArray = np.searchsorted(owners, pairs[:, 0])
    pieces, cutter = corners[owners], pairs[:, 1]
    free_pieces = [np.zeros((0, 3, 3))]
    while len(pieces):
        cut = np.zeros(len(pieces), dtype=bool)
        cut[piece] = True
        small = _longest_sides(pieces) <= SMALL * size
        free_pieces.append(pieces[~cut])
        pieces, owners, piece, cutter = _bisect_pieces(pieces, owners, piece, cutter, cut & ~small)
        if len(pieces) + sum(map(len, free_pieces)) > MOST_PIECES:
            raise InputError(
                "Mesh.mesh", "a surface that crosses itself in too many triangles", "parts joined to one closed surface"
            )
        cut_pieces, cutters = pieces[piece], corners[cutter]
        is_on_cutter = is_covered(cut_pieces, cutters, TEST_OFFSET * size)
        is_duplicate = np.zeros(len(pieces), dtype=bool)
        is_duplicate[piece[is_on_cutter & _has_similar_normals(cut_pieces, cutters) & (cutter < owners[piece])]] = True
        crosses = triangles_intersect(cut_pieces, cutters, TEST_OFFSET * size) & ~is_on_cutter & ~is_duplicate[piece]
        new_indices = np.cumsum(~is_duplicate) - 1
        pieces, owners, piece, cutter = (
            pieces[~is_duplicate],
            owners[~is_duplicate],
            new_indices[piece[crosses]],
            cutter[crosses],
        )
    return np.concatenate(free_pieces)


def _bisect_pieces(
    pieces: FloatArray, owners: IntArray, piece: IntArray, cutter: IntArray, selected: BoolArray
) -> tuple[FloatArray, IntArray, IntArray, IntArray]:
    """Return the halves of selected pieces, with the triangle each is from and the pairs that may intersect."""
    parents = pieces[selected]
    sides = np.linalg.norm(np.roll(parents, -1, axis=1) - parents, axis=2)
    order = (np.argmax(sides, axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(parents, order[:, :, None], axis=1), 1, 0)
    middle = (a + b) / 2.0
    halves = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    is_selected = selected[piece]
    positions = (np.cumsum(selected) - 1)[piece[is_selected]]
    return (
        halves,
        np.tile(owners[selected], 2),
        np.concatenate([positions, positions + len(parents)]),
        np.tile(cutter[is_selected], 2),
    )


def _has_similar_normals(first: FloatArray, second: FloatArray) -> BoolArray:
    """Return whether each triangle (p, 3, 3) has a normal within 90 degrees of its partner's (p, 3, 3)."""
    return np.asarray(np.einsum("ij,ij->i", normals_of(first), normals_of(second)) > 0.0)


def _longest_sides(pieces: FloatArray) -> FloatArray:
    """Return the longest sides (n,) of triangles (n, 3, 3)."""
    return np.asarray(np.max(np.linalg.norm(np.roll(pieces, -1, axis=1) - pieces, axis=2), axis=1))
