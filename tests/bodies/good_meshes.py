"""Meshes without defects, and variants as exporters write them: textured, split at seams, moved, mirrored, inverted."""

import numpy as np
import trimesh

STEP = 2.0**-20  # metres: multiples of it are exact in single precision up to 16 m from the origin
OUTLINE = [[0.0, 0.0], [0.06, 0.0], [0.06, 0.02], [0.02, 0.02], [0.02, 0.08], [0.0, 0.08]]
FAN = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]


def good_meshes():
    """Return closed meshes by name, their vertices multiples of about a micrometre."""
    make = trimesh.creation
    block, rod, ball = make.box([0.06, 0.05, 0.04]), make.cylinder(0.012, 0.1, sections=32), make.icosphere(2, 0.028)
    aside = ball.copy().apply_translation([0.03, 0.005, 0.0])
    meshes = {
        "box": make.box([0.06, 0.04, 0.1]),
        "cylinder": make.cylinder(0.02, 0.08, sections=32),
        "capsule": make.capsule(0.05, 0.02, count=[16, 16]),
        "ball": make.icosphere(2, 0.05),
        "ring": make.annulus(0.02, 0.03, 0.04),
        "torus": make.torus(0.04, 0.01, major_sections=24, minor_sections=12),
        "angle": make.extrude_triangulation(OUTLINE, FAN, 0.03),
        "bored block": trimesh.boolean.difference([block, rod], engine="manifold"),
        "block and ball": trimesh.boolean.union([block, aside], engine="manifold"),
        "rounded block": trimesh.boolean.intersection([block, ball], engine="manifold"),
    }
    return {
        name: trimesh.Trimesh(STEP * np.round(np.asarray(mesh.vertices) / STEP), mesh.faces)
        for name, mesh in meshes.items()
    }


def split_vertices(mesh, seed=0):
    """Return a mesh with a vertex for each corner of each triangle, with texture coordinates and flat normals."""
    rng = np.random.default_rng(seed)
    corners = np.asarray(mesh.triangles).reshape(-1, 3)
    normals = np.repeat(np.asarray(mesh.face_normals), 3, axis=0)
    result = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False, vertex_normals=normals)
    result.visual = trimesh.visual.TextureVisuals(uv=rng.random((len(corners), 2)))
    return result


def move_mesh(mesh, pose):
    """Return a mesh in another place; the triangles keep their order of corners, also where the pose mirrors."""
    return trimesh.Trimesh(trimesh.transform_points(mesh.vertices, pose), mesh.faces, process=False)


def reverse_triangles(mesh):
    """Return a mesh whose triangles are the other way round."""
    return trimesh.Trimesh(mesh.vertices, np.asarray(mesh.faces)[:, ::-1], process=False)


def pose_of(position, angle=0.0, mirrored=False):
    """Return a pose (4, 4) by a rotation about a fixed axis, then a translation; with a reflection before both."""
    pose = trimesh.transformations.rotation_matrix(angle, [1.0, 2.0, 3.0])
    if mirrored:
        pose = pose @ np.diag([-1.0, 1.0, 1.0, 1.0])
    pose[:3, 3] = position
    return pose


def triangle_set(mesh, digits=9):
    """Return the triangles as a set: corners rounded, each triangle beginning with its least corner."""
    result = set()
    for corners in np.round(np.asarray(mesh.triangles), digits) + 0.0:
        rows = [tuple(row) for row in corners]
        first = rows.index(min(rows))
        result.add(tuple(rows[first:] + rows[:first]))
    return result
