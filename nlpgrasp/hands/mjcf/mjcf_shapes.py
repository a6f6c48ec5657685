"""Collision shapes of MJCF bodies."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.mjcf.mjcf_joints import transform
from nlpgrasp.hands.mjcf.mjcf_names import body_name, geom_name
from nlpgrasp.hands.spheres.shapes import MeshFile, Shape

if TYPE_CHECKING:
    from mujoco import MjModel

SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = range(2, 8)  # mjtGeom
COLLISION_GROUP = 3  # the group of collision shapes by convention


def read_geoms(
    model: MjModel, bodies: Sequence[int]
) -> tuple[dict[str, tuple[Shape, ...]], tuple[str, ...], tuple[str, ...]]:
    """Return shapes by body, the shapes left out, and visible bodies without a collision shape.

    A geometry counts if it can collide (``contype`` or ``conaffinity``) or is in the collision group. Meshes are taken
    as they are, not as the convex hulls that MuJoCo collides.
    """
    shapes: dict[str, tuple[Shape, ...]] = {}
    missing, bare = [], []
    for body in bodies:
        first, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
        every, name = range(first, first + count), body_name(model, body)
        solid = [g for g in every if model.geom_contype[g] or model.geom_conaffinity[g] or _grouped(model, g)]
        found = [(g, _shape(model, g)) for g in solid]
        missing += [f"{geom_name(model, g)} (link {name}: no solid)" for g, shape in found if shape is None]
        if kept := tuple(shape for _, shape in found if shape is not None):
            shapes[name] = kept
        elif count:
            bare.append(name)
    return shapes, tuple(missing), tuple(bare)


def _grouped(model: MjModel, geom: int) -> bool:
    return int(model.geom_group[geom]) == COLLISION_GROUP


def _shape(model: MjModel, geom: int) -> Shape | None:
    kind, size = int(model.geom_type[geom]), np.array(model.geom_size[geom])
    pose = transform(model.geom_pos[geom], model.geom_quat[geom])
    if kind == SPHERE:
        return Shape.sphere(float(size[0]), pose)
    if kind == CAPSULE:
        return Shape.capsule(float(size[0]), 2.0 * float(size[1]), pose)
    if kind == CYLINDER:
        return Shape.cylinder(float(size[0]), 2.0 * float(size[1]), pose)
    if kind == ELLIPSOID:
        return Shape.ellipsoid(size, pose)
    if kind == BOX:
        return Shape.box(2.0 * size, pose)
    return _mesh(model, int(model.geom_dataid[geom]), pose) if kind == MESH else None


def _mesh(model: MjModel, mesh: int, pose: FloatArray) -> Shape:
    import trimesh

    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    start, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    vertices = np.array(model.mesh_vert[first : first + count], dtype=float)
    solid = trimesh.Trimesh(vertices, np.array(model.mesh_face[start : start + faces]))
    solid.apply_transform(pose)
    return Shape("mesh", solid, file=_mesh_file(model, mesh))


def _mesh_file(model: MjModel, mesh: int) -> MeshFile | None:
    """Return a mesh's file by the mesh's name in the model; None if the MJCF itself states the vertices."""
    start = int(model.mesh_pathadr[mesh])
    path = Path(model.paths[start : model.paths.index(b"\0", start)].decode()) if start >= 0 else None
    return MeshFile.of(model.mesh(mesh).name, path) if path is not None and path.is_file() else None
