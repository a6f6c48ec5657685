"""Collision shapes of a hand's links as triangles, from the hand's file."""

from __future__ import annotations

import hashlib
import xml.etree.ElementTree as ET
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import QhullError
from scipy.spatial.transform import Rotation

from nlpgrasp.common.optional_packages import import_mujoco
from nlpgrasp.common.robot_files import expand_xacro, find_mesh
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError, MissingExtraError
from nlpgrasp.verify.check import NotCheckedError
from nlpgrasp.verify.convex_solids import mesh_corners
from nlpgrasp.verify.sources import SourceFolders

if TYPE_CHECKING:
    from mujoco import MjModel
    from trimesh import Trimesh

SIDES, HALVINGS = 96, 4  # cylinder sides, icosahedron halvings: 0.1 % of the radius inside the exact shape
SHEET = 0.05  # share of its hull's volume: a surface that encloses less is replaced by its hull
SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = range(2, 8)  # mjtGeom
COLLISION_GROUP = 3  # the group of collision shapes by convention


@dataclass(frozen=True)
class LinkShape:
    """A closed triangle surface fixed to a link.

    Parameters
    ----------
    vertices : (n, 3) array
        Metres, link frame.
    faces : (m, 3) int array
    corners : (k, 3) array or None
        Corners of a convex shape.
    """

    vertices: FloatArray
    faces: NDArray[np.int64]
    corners: FloatArray | None = None


@dataclass(frozen=True)
class _MeshFiles:
    """Mesh files of a hand, each compared with its recorded SHA-256.

    Parameters
    ----------
    digests : mapping of str to str, or None
        Digest by the mesh's name in the hand's file; None in files of earlier versions.
    sources : SourceFolders
    """

    digests: Mapping[str, str] | None
    sources: SourceFolders

    def find(self, place: Path, name: str, link: str) -> Path:
        """Return the path of a URDF's mesh: as the URDF names it, or relative to another folder."""
        for folder in (place.parent, *self.sources.folders):
            found = find_mesh(folder / place.name, name)
            if found is not None:
                self.compare(name, found)
                return found
        self.sources.missing.append(name)
        raise NotCheckedError(f"{name}, the shape of link {link}, is not beside {place.name}")

    def compare(self, name: str, path: Path) -> None:
        """Raise ``NotCheckedError`` on a mesh file with another SHA-256 than recorded, or if none is recorded."""
        if self.digests is None:
            return
        if name not in self.digests:
            raise NotCheckedError(f"the file records no sha256 of mesh {name}")
        if hashlib.sha256(path.read_bytes()).hexdigest() != self.digests[name]:
            raise NotCheckedError(f"mesh {name} has another sha256 than the file records")


def link_shapes(
    place: Path, links: Container[str], digests: Mapping[str, str] | None, sources: SourceFolders
) -> dict[str, list[LinkShape]]:
    """Return the collision shapes of given links, by link.

    Parameters
    ----------
    place : Path
        The hand's file: URDF, xacro or MJCF, with the recorded sha256.
    links : container of str
    digests : mapping of str to str, or None
        The recorded sha256 of each mesh file; None if none are recorded.
    sources : SourceFolders
        Where the mesh files are searched.

    Raises
    ------
    NotMadeError
        Where a mesh file is missing or another one, or its reader is missing.
    """
    files = _MeshFiles(digests, sources)
    root = ET.fromstring(place.read_bytes())  # noqa: S314  (expat refuses entity bombs)
    if root.tag == "mujoco":
        return _mjcf_shapes_of(place, links, files)
    if any("xacro" in element.tag for element in root.iter()):
        try:
            root = ET.fromstring(expand_xacro(place))  # noqa: S314
        except InputError as error:
            raise NotCheckedError(str(error)) from None
    below = [link for link in root.findall("link") if link.get("name", "") in links]
    found = {link.get("name", ""): list(_urdf_link_shapes(place, link, files)) for link in below}
    return {link: shapes for link, shapes in found.items() if shapes}


def _urdf_link_shapes(place: Path, link: ET.Element, files: _MeshFiles) -> Iterator[LinkShape]:
    """Yield the collision shapes of a URDF's link."""
    for element in link.findall("collision"):
        origin, kind = element.find("origin"), element.find("geometry/*")
        if kind is None:
            continue
        pose = np.eye(4)
        if origin is not None:
            pose[:3, 3] = _parse_numbers(origin.get("xyz", "0 0 0"))
            pose[:3, :3] = Rotation.from_euler("xyz", _parse_numbers(origin.get("rpy", "0 0 0"))).as_matrix()
        yield _place_shape(_geometry_surface(place, link.get("name", ""), kind, files), pose)


def _geometry_surface(place: Path, link: str, kind: ET.Element, files: _MeshFiles) -> Trimesh:
    """Return the surface of a URDF's geometry element, metres, in its own frame."""
    import trimesh

    if kind.tag == "mesh":
        path = files.find(place, kind.get("filename", ""), link)
        try:
            mesh = trimesh.load(path, force="mesh")
        except Exception as error:  # trimesh's readers raise what their formats raise
            raise NotCheckedError(f"{path.name}, the shape of link {link}, cannot be read: {error}") from None
        if path.suffix.lower() == ".dae":  # the only format here that states its unit
            mesh.apply_scale(trimesh.units.unit_conversion(mesh.units or "meters", "meters"))
        mesh.apply_scale(_parse_numbers(kind.get("scale", "1 1 1")))
        return mesh
    if kind.tag == "box":
        return trimesh.creation.box(_parse_numbers(kind.get("size", "")))
    radius, length = float(kind.get("radius", "nan")), float(kind.get("length", "nan"))
    if kind.tag == "sphere":
        return _ellipsoid_mesh([radius] * 3)
    return _capsule_mesh(radius, length) if kind.tag == "capsule" else _cylinder_mesh(radius, length)


def _mjcf_shapes_of(place: Path, links: Container[str], files: _MeshFiles) -> dict[str, list[LinkShape]]:
    """Return the colliding shapes of an MJCF's bodies, from MuJoCo's compiled model."""
    try:
        mujoco = import_mujoco(f"{place.name}: reading MJCF")
    except MissingExtraError as error:
        raise NotCheckedError(str(error)) from None
    try:
        spec = mujoco.MjSpec.from_file(str(place))
        spec.compiler.fusestatic = False
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise NotCheckedError(f"MuJoCo cannot read {place.name}: {' '.join(str(error).split())}") from None
    found: dict[str, list[LinkShape]] = {}
    for g in range(model.ngeom):
        collides = model.geom_contype[g] or model.geom_conaffinity[g] or model.geom_group[g] == COLLISION_GROUP
        body = int(model.geom_bodyid[g])
        name = model.body(body).name or f"body_{body}"
        surface = _geom_surface(model, g, files) if collides and name in links else None
        if surface is not None:
            pose = np.eye(4)
            pose[:3, 3] = model.geom_pos[g]
            pose[:3, :3] = Rotation.from_quat(model.geom_quat[g], scalar_first=True).as_matrix()
            found.setdefault(name, []).append(_place_shape(surface, pose))
    return found


def _geom_surface(model: MjModel, geom: int, files: _MeshFiles) -> Trimesh | None:
    """Return the surface of an MJCF's geom in its own frame; None for planes and height fields."""
    import trimesh

    kind, size = int(model.geom_type[geom]), np.array(model.geom_size[geom], dtype=float)
    if kind == MESH:
        i = int(model.geom_dataid[geom])
        at = int(model.mesh_pathadr[i])
        if at >= 0:  # otherwise the MJCF itself states the vertices
            files.compare(model.mesh(i).name, Path(model.paths[at : model.paths.index(b"\0", at)].decode()))
        first, start = int(model.mesh_vertadr[i]), int(model.mesh_faceadr[i])
        vertices = np.array(model.mesh_vert[first : first + int(model.mesh_vertnum[i])], dtype=float)
        return trimesh.Trimesh(vertices, np.array(model.mesh_face[start : start + int(model.mesh_facenum[i])]))
    if kind == BOX:
        return trimesh.creation.box(2.0 * size)
    if kind in (SPHERE, ELLIPSOID):
        return _ellipsoid_mesh([size[0]] * 3 if kind == SPHERE else size.tolist())
    if kind in (CAPSULE, CYLINDER):
        return (_capsule_mesh if kind == CAPSULE else _cylinder_mesh)(float(size[0]), 2.0 * float(size[1]))
    return None


def _ellipsoid_mesh(semi_axes: list[float]) -> Trimesh:
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=HALVINGS)
    mesh.apply_scale(semi_axes)
    return mesh


def _cylinder_mesh(radius: float, length: float) -> Trimesh:
    import trimesh

    mesh = trimesh.creation.cylinder(1.0, 1.0, sections=SIDES)  # of unit size: trimesh merges close vertices
    mesh.apply_scale([radius, radius, length])
    return mesh


def _capsule_mesh(radius: float, length: float) -> Trimesh:
    import trimesh

    mesh = trimesh.creation.capsule(height=length / radius, radius=1.0, count=[SIDES // 2, SIDES // 2])
    mesh.apply_scale(radius)
    return mesh


def _place_shape(surface: Trimesh, pose: FloatArray) -> LinkShape:
    """Return a shape in its link's frame."""
    solid = _solid(surface)
    vertices = np.asarray(solid.vertices, dtype=float) @ pose[:3, :3].T + pose[:3, 3]
    faces = np.asarray(solid.faces, dtype=np.int64)
    return LinkShape(vertices, faces, mesh_corners(vertices, vertices[faces]))


def _solid(surface: Trimesh) -> Trimesh:
    """Return a surface, or its convex hull if it encloses almost no volume."""
    try:
        hull = surface.convex_hull
    except QhullError:  # coplanar points
        return surface
    return hull if abs(surface.volume) < SHEET * hull.volume else surface


def _parse_numbers(text: str) -> FloatArray:
    return np.array([float(value) for value in text.split()])
