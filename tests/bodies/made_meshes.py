"""Synthetic meshes with the solids that they represent, and an independent inside test."""

from dataclasses import dataclass, field

import igl
import numpy as np
import trimesh

JOINED, HOLLOW = "the outer surface of their union is left", "no finger gets there"
ALL_TURNED, SOME_TURNED = "turned inside out: the triangles faced inwards", "parts inside out: their triangles faced"
BURIED, COPIES, FILLED = "of the area was buried", "there more than once", "filled holes"
ROUND, APART = "turned round to face as those beside", "pieces that do not touch"


@dataclass(frozen=True)
class MeshCase:
    """A mesh, the closed solids that it stands for, and what is said of it.

    Parameters
    ----------
    mesh : trimesh.Trimesh
    solids : tuple of trimesh.Trimesh
        Facing outwards; none where the mesh is refused.
    said : tuple of str
        A part of each repair, in order; or of the refusal.
    """

    mesh: trimesh.Trimesh
    solids: tuple[trimesh.Trimesh, ...]
    said: tuple[str, ...] = field(default=())


def box(extents, position=(0.0, 0.0, 0.0)):
    result = trimesh.creation.box(extents)
    result.apply_translation(position)
    return result


def ball(radius, position=(0.0, 0.0, 0.0), subdivisions=3):
    result = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    result.apply_translation(position)
    return result


def rod(radius, height, position=(0.0, 0.0, 0.0)):
    result = trimesh.creation.cylinder(radius, height, sections=40)
    result.apply_translation(position)
    return result


def join_meshes(*meshes):
    return trimesh.util.concatenate(meshes)


def invert_mesh(mesh):
    result = mesh.copy()
    result.invert()
    return result


def tilt_mesh(mesh):
    result = mesh.copy()
    result.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1.0, 2.0, 3.0]))
    return result


def round_to_single(mesh):
    """Return the mesh with the single precision of STL files."""
    return trimesh.Trimesh(np.asarray(mesh.vertices, dtype=np.float32), mesh.faces, process=False)


def select_faces(mesh, faces):
    """Return some triangles of a mesh."""
    return trimesh.Trimesh(mesh.vertices, np.asarray(mesh.faces)[faces], process=False)


def soup(mesh):
    """Return the mesh as STL files hold it: no two triangles share a vertex."""
    return trimesh.Trimesh(mesh.triangles.reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3), process=False)


def tube(centre, radius, sides=12):
    """Return a closed tube around a closed curve (n, 3), facing outwards; it crosses itself where the curve does."""
    tangents = np.roll(centre, -1, axis=0) - np.roll(centre, 1, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    transverse = np.cross(tangents, [0.0, 0.0, 1.0])
    transverse /= np.linalg.norm(transverse, axis=1)[:, None]
    angles = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)[None, :, None]
    circle = np.cos(angles) * transverse[:, None] + np.sin(angles) * np.cross(transverse, tangents)[:, None]
    i, j = (a.ravel() for a in np.meshgrid(np.arange(len(centre)), np.arange(sides), indexing="ij"))
    a, b = i * sides + j, i * sides + (j + 1) % sides
    c, d = ((i + 1) % len(centre)) * sides + j, ((i + 1) % len(centre)) * sides + (j + 1) % sides
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])
    result = trimesh.Trimesh((centre[:, None] + radius * circle).reshape(-1, 3), faces, process=False)
    return invert_mesh(result) if result.volume < 0.0 else result


def figure_eight(count=80):
    """Return a tube around a figure of eight: one part that crosses itself in the middle."""
    t = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    return tube(np.stack([0.05 * np.sin(2.0 * t), 0.05 * np.sin(t), 0.004 * np.cos(t)], axis=1), 0.012)


def winding(solid, points):
    """Return how often a solid winds around points: exact, and by a ray's crossings; they have to agree."""
    points = np.ascontiguousarray(points)
    exact = np.asarray(igl.winding_number(np.asarray(solid.vertices), np.asarray(solid.faces), points))
    rays = signed_crossings(np.asarray(solid.triangles), points)
    assert np.sum(np.abs(exact - rays) > 0.1) <= 0.01 * len(points)  # a ray may hit an edge
    return np.round(exact)


def signed_crossings(triangles, points):
    """Return how much more often a ray from each point leaves through triangles (n, 3, 3) than it enters."""
    ray = np.array([0.5377, 0.3019, 0.7872])
    a, b, c = (triangles[:, i] for i in range(3))
    p = np.cross(ray, c - a)
    determinant = np.einsum("ij,ij->i", b - a, p)
    flat = np.abs(determinant) < 1e-300
    inverse = np.where(flat, 0.0, 1.0 / np.where(flat, 1.0, determinant))
    result = np.zeros(len(points))
    for k, point in enumerate(points):
        t = point - a
        u = np.einsum("ij,ij->i", t, p) * inverse
        q = np.cross(t, b - a)
        v, distances = q @ ray * inverse, np.einsum("ij,ij->i", c - a, q) * inverse
        hit = ~flat & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (distances > 0.0)
        result[k] = -np.sum(np.sign(determinant[hit]))
    return result


def is_off_outer_surface(solids, points, normals, size):
    """Return which points with outward normals are not on the outer surface of solids, by all of them one by one.

    One is where a step of 1e-4 of the size before it is outside all of them, and one behind it inside one of them. At a
    seam such a step may meet another face; there one of a hundredth of that decides.
    """
    is_off = np.ones(len(points), dtype=bool)
    for step in (1e-4 * size, 1e-6 * size):
        remaining = np.flatnonzero(is_off)
        front, back = (points[remaining] + sign * step * normals[remaining] for sign in (1.0, -1.0))
        is_outside = np.all([winding(solid, front) == 0.0 for solid in solids], axis=0)
        is_inside = np.any([winding(solid, back) != 0.0 for solid in solids], axis=0)
        is_off[remaining] = ~(is_outside & is_inside)
    return is_off
