"""Mesh defects: large holes, self-intersections, disconnected pieces."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from nlpgrasp.common.cache import cached_arrays
from nlpgrasp.common.formatting import format_number, format_percent, vector
from nlpgrasp.common.meshes.intersections import intersecting_boxes, normals_of
from nlpgrasp.common.meshes.search_tree import SearchTree, local_origin, relative_to
from nlpgrasp.common.meshes.topology import MeshParts, drop_duplicates, drop_unused_vertices, merge_mesh_vertices
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.errors import InputError

if TYPE_CHECKING:
    import trimesh

LARGEST_FILL = 0.05  # of the surface area: holes larger in total, and a larger share off the body, are refused
OFF_BODY = 3000  # points of a mesh's own surface of which the share off the body is taken
SAME_AREA = 1e-9  # of the surface area: difference within which two areas are equal
TOUCHING = 1e-6  # of the diagonal: distance within which pieces touch, and depth at which crossings are rounding
SLIT = 3e-3  # of the diagonal: distance within which pieces of an open mesh touch (removed triangles leave slits)
SCALED = 100.0  # mean edge length for ray casting: libigl takes small triangles for degenerate
ENDS = 1e-3  # of an edge's length, ignored at each end
RAY_SHIFT = 1e-7 * np.array([0.5377, 0.3019, 0.7872])  # of the diagonal: shift of rays, so that they do not hit edges
SAMPLES = 300  # surface points for the ray test
MOST_INVERTED = 0.01  # of the samples may fail the ray test
FEW = 1000  # triangles: below, the cache saves no time


def refuse_guessed_surface(mesh: trimesh.Trimesh, repaired: trimesh.Trimesh) -> None:
    """Raise if repairing a mesh invented surface, or left much of it out: large holes, reversed copies, sheets.

    Raises
    ------
    InputError
        When filled holes exceed ``LARGEST_FILL`` of the surface; when pairs of opposite triangles are a part of the
        surface, and filling the hole that their removal leaves gives a different area; or when more than that share of
        the mesh's surface is neither on nor in the repaired one.
    """
    _check_sheets(mesh, repaired)
    coordinates = np.asarray(mesh.vertices, dtype=float)
    origin = local_origin(coordinates)
    filled = merge_mesh_vertices(relative_to(coordinates, origin), np.asarray(mesh.faces))
    vertices, faces = np.asarray(filled.vertices, dtype=float), np.asarray(filled.faces)
    is_kept = drop_duplicates(vertices, faces)[0]
    filled.update_faces(is_kept)
    filled.fill_holes()
    fill, area = np.asarray(filled.faces)[np.count_nonzero(is_kept) :], float(filled.area)

    edges, counts = np.unique(_edge_ids(faces[is_kept]), return_counts=True)
    group = np.asarray(np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True)[1]).ravel()
    pairs = faces[~np.isin(group, group[is_kept])]
    removed = pairs[np.any(np.isin(_edge_ids(pairs), edges[counts == 1]), axis=1)]
    restored = np.any(np.isin(_edge_ids(fill), _edge_ids(removed)), axis=1)
    lost = _areas(vertices, removed).sum() / 2.0  # each is there both ways round
    if abs(lost - _areas(vertices, fill[restored]).sum()) > SAME_AREA * area:
        raise InputError(
            "Mesh.mesh",
            f"{len(removed) // 2} faces with a reversed copy, around {_format_mean(vertices[removed], origin)}",
            "each triangle of the surface once, facing outwards",
        )
    _check_holes(vertices, fill[~restored], area, origin)


def _check_sheets(mesh: trimesh.Trimesh, repaired: trimesh.Trimesh) -> None:
    """Raise if much of a mesh's surface is off the repaired one, because it encloses nothing."""
    points, _ = _surface_samples(np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces), OFF_BODY)
    tree = SearchTree(np.asarray(repaired.vertices), np.asarray(repaired.faces))
    size = float(np.linalg.norm(np.ptp(np.asarray(mesh.vertices), axis=0)))
    is_off = tree.exact_signed_distance(points) > SLIT * size
    if np.mean(is_off) > LARGEST_FILL:
        raise InputError(
            "Mesh.mesh",
            f"{format_percent(float(np.mean(is_off)))} of the surface, around "
            f"{_format_mean(points[is_off], np.zeros(3))}, that encloses nothing: sheets without thickness",
            "walls with a thickness, whose triangles face outwards",
        )


def _check_holes(vertices: FloatArray, fill: IntArray, area: float, origin: FloatArray) -> None:
    """Raise if the triangles (f, 3) that fill holes are more than ``LARGEST_FILL`` of the surface area."""
    areas = _areas(vertices, fill)
    if areas.sum() > LARGEST_FILL * area:
        holes = MeshParts(vertices, fill).labels
        largest = fill[holes == np.argmax(np.bincount(holes, areas))]
        raise InputError(
            "Mesh.mesh",
            f"holes of {format_number(1e6 * areas.sum(), 3)} mm^2, {format_percent(areas.sum() / area)} of the "
            f"surface, the largest around {_format_mean(vertices[largest], origin)}",
            f"a closed mesh, or one with holes of at most {format_percent(LARGEST_FILL)} of its surface",
        )


def defect_warnings(mesh: trimesh.Trimesh) -> tuple[str, ...]:
    """Return warnings, one sentence each, on self-intersections and disconnected pieces of a mesh."""
    inputs = np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64)
    if len(mesh.faces) <= FEW:
        return _defects(*inputs)

    def computed() -> dict[str, FloatArray]:
        return {"warnings": np.frombuffer("\n".join(_defects(*inputs)).encode(), dtype=np.uint8).astype(float)}

    warnings = cached_arrays("defects", inputs, computed)["warnings"]
    return tuple(bytes(warnings.astype(np.uint8)).decode().splitlines())


def _defects(vertices: FloatArray, faces: IntArray) -> tuple[str, ...]:
    """Return the warnings of ``defect_warnings``, given vertices (v, 3), metres, and triangles (f, 3)."""
    origin = local_origin(vertices)
    local = relative_to(vertices, origin)
    warnings = []
    if len(crossings := self_intersections(local, faces)):
        warnings.append(
            f"the mesh crosses itself, for example at {_format_mean(crossings[0], origin)}: what is inside is unclear "
            "there, so mend it in the program that it comes from"
        )
    if len(pieces := separate_pieces(local, faces)) > 1:
        sizes = sorted(1e3 * float(np.max(np.ptp(piece, axis=0))) for piece in pieces)
        warnings.append(
            f"the mesh is {len(pieces)} pieces that do not touch, {format_number(sizes[0], 3)} to "
            f"{format_number(sizes[-1], 3)} mm long: they count as one rigid body"
        )
    return tuple(warnings)


def self_intersections(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return points (p, 3), metres, where a mesh intersects itself; empty if no intersection is detected.

    Rays along the edges detect where they pass through triangles by more than rounding. Large overlaps whose edges
    meet exactly are detected by sampled rays to both sides of the surface: the inward ray must leave the body where
    it first meets the surface again, the outward ray must enter the body or meet nothing.

    Parameters
    ----------
    vertices : (v, 3) array
        Metres, in local coordinates, without duplicates.
    faces : (f, 3) int array
    """
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    rays = _RayCaster(vertices, faces)
    points = _edge_intersections(vertices, faces, rays, size)
    return points if len(points) else _inverted_samples(vertices, faces, rays, size)


class _RayCaster:
    """Ray casting against a mesh, scaled so that libigl takes no triangle for degenerate.

    Parameters
    ----------
    vertices : (v, 3) array
    faces : (f, 3) int array
    """

    def __init__(self, vertices: FloatArray, faces: IntArray) -> None:
        import igl

        successors = np.roll(faces, -1, axis=1)
        is_first = faces < successors  # each edge once where the mesh is closed
        self.edges = np.stack([faces[is_first], successors[is_first]], axis=1)
        lengths = np.linalg.norm(vertices[self.edges[:, 1]] - vertices[self.edges[:, 0]], axis=1)
        self._scale = SCALED / float(np.mean(lengths))
        self._mesh = np.ascontiguousarray(self._scale * vertices), np.ascontiguousarray(faces, dtype=np.int64)
        self._tree = igl.AABB()
        self._tree.init(*self._mesh)

    def first_hits(self, origins: FloatArray, directions: FloatArray, farthest: float) -> tuple[IntArray, FloatArray]:
        """Return the triangle that each ray hits first, (m,), -1 for none, and the ray parameter of the hit, (m,)."""
        rays = (np.ascontiguousarray(self._scale * values) for values in (origins, directions))
        triangles, parameters, _ = self._tree.intersect_ray_first(*self._mesh, *rays, farthest)
        return np.asarray(triangles).ravel(), np.asarray(parameters, dtype=float).ravel()


def _edge_intersections(vertices: FloatArray, faces: IntArray, rays: _RayCaster, size: float) -> FloatArray:
    """Return the points (p, 3) where edges pass through triangles by more than rounding."""
    ends = rays.edges
    edges = vertices[ends[:, 1]] - vertices[ends[:, 0]]
    origins, directions = vertices[ends[:, 0]] + ENDS * edges + RAY_SHIFT * size, (1.0 - 2.0 * ENDS) * edges
    triangles, parameters = rays.first_hits(origins, directions, 1.0)
    hit = np.flatnonzero(triangles >= 0)
    corners = faces[triangles[hit]]
    heights = np.einsum("ijk,ik->ij", vertices[ends[hit]] - vertices[corners[:, :1]], normals_of(vertices[corners]))
    is_deep = np.min(np.abs(heights), axis=1) > TOUCHING * size
    hit = hit[is_deep & ~np.any(corners[:, :, None] == ends[hit][:, None], axis=(1, 2))]
    return np.asarray(origins[hit] + parameters[hit, None] * directions[hit])


def _inverted_samples(vertices: FloatArray, faces: IntArray, rays: _RayCaster, size: float) -> FloatArray:
    """Return sampled surface points (p, 3) at which the triangles' normals do not point out of the body.

    They do not if the outer side is inside the body, or the inner side outside. A fraction of at most ``MOST_INVERTED``
    of the samples counts as none.
    """
    points, normals = _surface_samples(vertices, faces, SAMPLES)
    inverted = np.zeros(len(points), dtype=bool)
    for side in (1.0, -1.0):
        triangles, _ = rays.first_hits(points + side * TOUCHING * size * normals, side * size * normals, np.inf)
        leaves = np.einsum("ij,ij->i", side * normals, normals_of(vertices[faces[triangles]])) > 0.0
        inverted |= (triangles >= 0) & leaves if side > 0.0 else (triangles < 0) | ~leaves
    return points[inverted] if np.mean(inverted) > MOST_INVERTED else points[:0]


def _surface_samples(vertices: FloatArray, faces: IntArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Return random surface points (count, 3), uniform by area, and their triangles' unit normals."""
    total = np.cumsum(_areas(vertices, faces))
    sampled = faces[np.searchsorted(total, (np.arange(count) + 0.5) / count * total[-1])]
    weights = np.random.default_rng(0).dirichlet(np.ones(3), count)
    return np.einsum("ij,ijk->ik", weights, vertices[sampled]), normals_of(vertices[sampled])


def separate_pieces(vertices: FloatArray, faces: IntArray) -> list[FloatArray]:
    """Return the vertices (v, 3) of each disconnected piece of a mesh; touching pieces count as one.

    Parameters
    ----------
    vertices : (v, 3) array
        Metres, in local coordinates, without duplicates.
    faces : (f, 3) int array
    """
    labels = _components(len(vertices), faces[:, :2], faces[:, 1:])[faces[:, 0]]
    if np.all(labels == labels[0]):
        return [vertices]
    shells = [drop_unused_vertices(vertices, faces[labels == label]) for label in np.unique(labels)]
    slack = (SLIT if MeshParts(vertices, faces).open_edges else TOUCHING) * float(
        np.linalg.norm(np.ptp(vertices, axis=0))
    )
    lower, upper = (np.array([corner(shell[0], axis=0) for shell in shells]) for corner in (np.min, np.max))
    trees = [SearchTree(*shell) for shell in shells]

    def reaches(first: int, j: int) -> bool:
        points = shells[first][0]
        nearby = points[np.all((points >= lower[j] - slack) & (points <= upper[j] + slack), axis=1)]
        return len(nearby) > 0 and bool(np.any(trees[j].nearest(nearby)[0] <= slack**2))

    pairs = intersecting_boxes(lower - slack, upper + slack)
    contacts = pairs[[reaches(first, j) or reaches(j, first) for first, j in pairs.tolist()]]
    piece_of = _components(len(shells), contacts[:, 0], contacts[:, 1])
    return [
        np.concatenate([shells[i][0] for i in np.flatnonzero(piece_of == piece)]) for piece in range(piece_of.max() + 1)
    ]


def _components(count: int, first: IntArray, second: IntArray) -> IntArray:
    """Return the connected component (count,) of each node of a graph with edges from ``first`` to ``second``."""
    graph = coo_matrix((np.ones(first.size, dtype=bool), (first.ravel(), second.ravel())), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _edge_ids(faces: IntArray) -> IntArray:
    """Return an integer identifier for each undirected edge of each triangle, (f, 3)."""
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2)
    return np.asarray(ends.min(axis=2) << 32 | ends.max(axis=2), dtype=np.int64)


def _areas(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return the areas (f,) of triangles, m^2."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0)


def _format_mean(points: FloatArray, origin: FloatArray) -> str:
    """Return the mean of points (..., 3), given relative to an origin (3,), metres, as text."""
    return f"[{vector(points.reshape(-1, 3).mean(axis=0) + origin, 3)}] m"
