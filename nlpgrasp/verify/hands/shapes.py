"""Collision shapes of a hand's links as triangles, read from the hand's own file."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from nlpgrasp.common.extras.mujoco import import_mujoco
from nlpgrasp.common.extras.xacro import expanded
from nlpgrasp.common.meshes.robot_meshes import find_mesh
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError, MissingExtraError
from nlpgrasp.verify.check import NotMadeError

if TYPE_CHECKING:
    from mujoco import MjModel
    from trimesh import Trimesh

SIDES, HALVINGS = (
    96,
    4,
)  # of a cylinder; of an icosahedron's edges: both are inside the exact shape by 0.1 % of its radius
SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = range(2, 8)  # mjtGeom
COLLISION_GROUP = 3  # where models by convention keep the shapes that collide


@dataclass(frozen=True)
class LinkShape:
    """A closed surface fixed to a link.

    Parameters
    ----------
    vertices : (n, 3) array
        Metres, link frame.
    faces : (m, 3) int array
    """

    vertices: FloatArray
    faces: NDArray[np.int64]


def link_shapes(place: Path, text: bytes) -> dict[str, list[LinkShape]]:
    """Return the collision shapes of each link.

    Parameters
    ----------
    place : Path
        The hand's file: URDF, xacro or MJCF.
    text : bytes
        What is in it.

    Raises
    ------
    NotMadeError
        Where a mesh is missing, or what reads it.
    """
    root = ET.fromstring(text)  # noqa: S314  (expat refuses entity bombs, and the text has the recorded sha256)
    if root.tag == "mujoco":
        return _in_mjcf(place)
    if any("xacro" in element.tag for element in root.iter()):
        try:
            root = ET.fromstring(expanded(place))  # noqa: S314
        except InputError as error:
            raise NotMadeError(str(error)) from None
    found = {link.get("name", ""): list(_of_link(place, link)) for link in root.findall("link")}
    return {link: shapes for link, shapes in found.items() if shapes}


def _of_link(place: Path, link: ET.Element) -> Iterator[LinkShape]:
    """Yield the shapes of a URDF's link."""
    for element in link.findall("collision"):
        origin, kind = element.find("origin"), element.find("geometry/*")
        if kind is None:
            continue
        pose = np.eye(4)
        if origin is not None:
            pose[:3, 3] = _numbers(origin.get("xyz", "0 0 0"))
            pose[:3, :3] = Rotation.from_euler("xyz", _numbers(origin.get("rpy", "0 0 0"))).as_matrix()
        yield _placed(_surface(place, link.get("name", ""), kind), pose)


def _surface(place: Path, link: str, kind: ET.Element) -> Trimesh:
    """Return the surface that a URDF's geometry element states, metres, in its own frame."""
    import trimesh

    if kind.tag == "mesh":
        name = kind.get("filename", "")
        path = find_mesh(place, name)
        if path is None:
            raise NotMadeError(f"{name}, the shape of link {link}, is not beside {place.name}")
        try:
            mesh = trimesh.load(path, force="mesh")
        except Exception as error:  # trimesh's readers raise what their formats raise
            raise NotMadeError(f"{path.name}, the shape of link {link}, cannot be read: {error}") from None
        if path.suffix.lower() == ".dae":  # the one format of these that states its unit
            mesh.apply_scale(trimesh.units.unit_conversion(mesh.units or "meters", "meters"))
        mesh.apply_scale(_numbers(kind.get("scale", "1 1 1")))
        return mesh
    if kind.tag == "box":
        return trimesh.creation.box(_numbers(kind.get("size", "")))
    radius, length = float(kind.get("radius", "nan")), float(kind.get("length", "nan"))
    if kind.tag == "sphere":
        return _ellipsoid([radius] * 3)
    return _capsule(radius, length) if kind.tag == "capsule" else _cylinder(radius, length)


def _in_mjcf(place: Path) -> dict[str, list[LinkShape]]:
    """Return the shapes of an MJCF's bodies that can collide, from MuJoCo's compiled model."""
    try:
        mujoco = import_mujoco(f"{place.name}: reading MJCF")
    except MissingExtraError as error:
        raise NotMadeError(str(error)) from None
    try:
        spec = mujoco.MjSpec.from_file(str(place))
        spec.compiler.fusestatic = False
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise NotMadeError(f"MuJoCo cannot read {place.name}: {' '.join(str(error).split())}") from None
    found: dict[str, list[LinkShape]] = {}
    for g in range(model.ngeom):
        collides = model.geom_contype[g] or model.geom_conaffinity[g] or model.geom_group[g] == COLLISION_GROUP
        surface = _of_geom(model, g) if collides else None
        if surface is not None:
            body = int(model.geom_bodyid[g])
            pose = np.eye(4)
            pose[:3, 3] = model.geom_pos[g]
            pose[:3, :3] = Rotation.from_quat(model.geom_quat[g], scalar_first=True).as_matrix()
            found.setdefault(model.body(body).name or f"body_{body}", []).append(_placed(surface, pose))
    return found


def _of_geom(model: MjModel, geom: int) -> Trimesh | None:
    """Return the surface of an MJCF's geom in its own frame; None of planes and height fields."""
    import trimesh

    kind, size = int(model.geom_type[geom]), np.array(model.geom_size[geom], dtype=float)
    if kind == MESH:
        i = int(model.geom_dataid[geom])
        first, start = int(model.mesh_vertadr[i]), int(model.mesh_faceadr[i])
        vertices = np.array(model.mesh_vert[first : first + int(model.mesh_vertnum[i])], dtype=float)
        return trimesh.Trimesh(vertices, np.array(model.mesh_face[start : start + int(model.mesh_facenum[i])]))
    if kind == BOX:
        return trimesh.creation.box(2.0 * size)
    if kind in (SPHERE, ELLIPSOID):
        return _ellipsoid([size[0]] * 3 if kind == SPHERE else size.tolist())
    if kind in (CAPSULE, CYLINDER):
        return (_capsule if kind == CAPSULE else _cylinder)(float(size[0]), 2.0 * float(size[1]))
    return None


def _ellipsoid(semi_axes: list[float]) -> Trimesh:
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=HALVINGS)
    mesh.apply_scale(semi_axes)
    return mesh


def _cylinder(radius: float, length: float) -> Trimesh:
    import trimesh

    mesh = trimesh.creation.cylinder(1.0, 1.0, sections=SIDES)  # of unit size: trimesh merges close vertices
    mesh.apply_scale([radius, radius, length])
    return mesh


def _capsule(radius: float, length: float) -> Trimesh:
    import trimesh

    mesh = trimesh.creation.capsule(height=length / radius, radius=1.0, count=[SIDES // 2, SIDES // 2])
    mesh.apply_scale(radius)
    return mesh


def _placed(surface: Trimesh, pose: FloatArray) -> LinkShape:
    vertices = np.asarray(surface.vertices, dtype=float) @ pose[:3, :3].T + pose[:3, 3]
    return LinkShape(vertices, np.asarray(surface.faces, dtype=np.int64))


def _numbers(text: str) -> FloatArray:
    return np.array([float(value) for value in text.split()])
