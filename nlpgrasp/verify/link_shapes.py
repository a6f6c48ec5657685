"""Collision shapes of a hand's links as triangles, from the hand's file."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import QhullError
from scipy.spatial.transform import Rotation

from nlpgrasp.common.meshes.mesh_file import metres_of_format
from nlpgrasp.common.meshes.mesh_loader import load_scene
from nlpgrasp.common.robot_files import SI, UrdfUnits, find_mesh
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.verify.chain_kinematics import compile_mjcf, pose_matrix, read_root_element
from nlpgrasp.verify.check import NotCheckedError
from nlpgrasp.verify.convex_solids import mesh_corners
from nlpgrasp.verify.sources import SourceFolders, sha256_of

if TYPE_CHECKING:
    from mujoco import MjModel
    from trimesh import Trimesh

CYLINDER_SIDES = 96  # sides of a cylinder: 0.1 % of the radius inside the exact shape
ICOSPHERE_HALVINGS = 4  # halvings of an icosahedron: 0.1 % of the radius inside the exact shape
SHEET_SHARE = 0.05  # share of its hull's volume: a surface that encloses less is replaced by its hull
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
    faces: IntArray
    corners: FloatArray | None = None


@dataclass(frozen=True)
class _MeshFiles:
    """Mesh files of a hand, each compared with its recorded SHA-256.

    Parameters
    ----------
    digests : mapping of str to str, or None
        Digest by the mesh's name in the hand's file; None in files of earlier versions, of which meshes in the folders
        alone are read.
    sources : SourceFolders
    """

    digests: Mapping[str, str] | None
    sources: SourceFolders

    def find(self, hand_file: Path, name: str, link: str) -> Path:
        """Return the path of a URDF's mesh, as the URDF names it or relative to another folder."""
        for folder in (hand_file.parent, *self.sources.folders):
            path = find_mesh(folder / hand_file.name, name)
            if path is not None:
                self.compare(name, path)
                return path
        self.sources.missing.append(name)
        raise NotCheckedError(f"{name}, the shape of link {link}, is not beside {hand_file.name}")

    def compare(self, name: str, path: Path) -> None:
        """Raise ``NotCheckedError`` unless the SHA-256 of a mesh file is recorded and agrees."""
        if self.digests is None:
            if not self.sources.contain(path):
                raise NotCheckedError(f"{path} is {self.sources.outside}")
            return
        if name not in self.digests:
            raise NotCheckedError(f"the file records no sha256 of mesh {name}")
        if sha256_of(path) != self.digests[name]:
            raise NotCheckedError(f"mesh {name} has another sha256 than the file records")


def link_shapes(
    path: Path,
    links: Container[str],
    digests: Mapping[str, str] | None,
    sources: SourceFolders,
    units: UrdfUnits = SI,
) -> dict[str, list[LinkShape]]:
    """Return the collision shapes of the given links, by link name.

    Parameters
    ----------
    path : Path
        The hand's file: URDF or MJCF, with the recorded sha256.
    links : container of str
    digests : mapping of str to str, or None
        The recorded sha256 of each mesh file; None if none are recorded.
    sources : SourceFolders
        Where the mesh files are searched.
    units : UrdfUnits
        Of a URDF's numbers.

    Raises
    ------
    NotCheckedError
        Where a mesh file is missing or another one, or its reader is missing.
    """
    files = _MeshFiles(digests, sources)
    root = read_root_element(path, units)
    if root.tag == "mujoco":
        return _mjcf_shapes(path, links, files)
    elements = [link for link in root.findall("link") if link.get("name", "") in links]
    shapes_of_links = {link.get("name", ""): list(_urdf_link_shapes(path, link, files)) for link in elements}
    return {link: shapes for link, shapes in shapes_of_links.items() if shapes}


def _urdf_link_shapes(path: Path, link: ET.Element, files: _MeshFiles) -> Iterator[LinkShape]:
    """Yield the collision shapes of a URDF's link."""
    for element in link.findall("collision"):
        origin, kind = element.find("origin"), element.find("geometry/*")
        if kind is None:
            continue
        pose = np.eye(4)
        if origin is not None:
            rotation = Rotation.from_euler("xyz", _parse_numbers(origin.get("rpy", "0 0 0")))
            pose = pose_matrix(_parse_numbers(origin.get("xyz", "0 0 0")), rotation)
        yield _place_shape(_geometry_surface(path, link.get("name", ""), kind, files), pose)


def _geometry_surface(path: Path, link: str, kind: ET.Element, files: _MeshFiles) -> Trimesh:
    """Return the surface of a URDF's geometry element, metres, in its own frame."""
    import trimesh

    if kind.tag == "mesh":
        mesh_path = files.find(path, kind.get("filename", ""), link)
        try:
            mesh = load_scene(mesh_path, process=True).to_mesh()
        except Exception as error:  # trimesh's readers raise what their formats raise
            raise NotCheckedError(f"{mesh_path.name}, the shape of link {link}, cannot be read: {error}") from None
        mesh.apply_scale(metres_of_format(mesh_path, mesh) or 1.0)
        mesh.apply_scale(_parse_numbers(kind.get("scale", "1 1 1")))
        return mesh
    if kind.tag == "box":
        return trimesh.creation.box(_parse_numbers(kind.get("size", "")))
    radius, length = float(kind.get("radius", "nan")), float(kind.get("length", "nan"))
    if kind.tag == "sphere":
        return _ellipsoid_mesh([radius] * 3)
    return _capsule_mesh(radius, length) if kind.tag == "capsule" else _cylinder_mesh(radius, length)


def _mjcf_shapes(path: Path, links: Container[str], files: _MeshFiles) -> dict[str, list[LinkShape]]:
    """Return the colliding shapes of an MJCF's bodies, from MuJoCo's compiled model."""
    model = compile_mjcf(path)
    shapes: dict[str, list[LinkShape]] = {}
    for geom in range(model.ngeom):
        collides = model.geom_contype[geom] or model.geom_conaffinity[geom] or model.geom_group[geom] == COLLISION_GROUP
        body = int(model.geom_bodyid[geom])
        name = model.body(body).name or f"body_{body}"
        surface = _geom_surface(model, geom, files) if collides and name in links else None
        if surface is not None:
            rotation = Rotation.from_quat(model.geom_quat[geom], scalar_first=True)
            pose = pose_matrix(model.geom_pos[geom], rotation)
            shapes.setdefault(name, []).append(_place_shape(surface, pose))
    return shapes


def _geom_surface(model: MjModel, geom: int, files: _MeshFiles) -> Trimesh | None:
    """Return the surface of an MJCF's geom in its own frame; None for planes and height fields."""
    import trimesh

    kind, size = int(model.geom_type[geom]), np.array(model.geom_size[geom], dtype=float)
    if kind == MESH:
        mesh = int(model.geom_dataid[geom])
        path_start = int(model.mesh_pathadr[mesh])
        if path_start >= 0:  # otherwise the MJCF itself states the vertices
            files.compare(
                model.mesh(mesh).name, Path(model.paths[path_start : model.paths.index(b"\0", path_start)].decode())
            )
        first_vertex, first_face = int(model.mesh_vertadr[mesh]), int(model.mesh_faceadr[mesh])
        vertices = np.array(model.mesh_vert[first_vertex : first_vertex + int(model.mesh_vertnum[mesh])], dtype=float)
        return trimesh.Trimesh(
            vertices, np.array(model.mesh_face[first_face : first_face + int(model.mesh_facenum[mesh])])
        )
    if kind == BOX:
        return trimesh.creation.box(2.0 * size)
    if kind in (SPHERE, ELLIPSOID):
        return _ellipsoid_mesh([size[0]] * 3 if kind == SPHERE else size.tolist())
    if kind in (CAPSULE, CYLINDER):
        return (_capsule_mesh if kind == CAPSULE else _cylinder_mesh)(float(size[0]), 2.0 * float(size[1]))
    return None


def _ellipsoid_mesh(semi_axes: list[float]) -> Trimesh:
    """Return the triangles of an ellipsoid about the origin."""
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=ICOSPHERE_HALVINGS)
    mesh.apply_scale(semi_axes)
    return mesh


def _cylinder_mesh(radius: float, length: float) -> Trimesh:
    """Return the triangles of a cylinder along the z axis."""
    import trimesh

    mesh = trimesh.creation.cylinder(1.0, 1.0, sections=CYLINDER_SIDES)  # of unit size: trimesh merges close vertices
    mesh.apply_scale([radius, radius, length])
    return mesh


def _capsule_mesh(radius: float, length: float) -> Trimesh:
    """Return the triangles of a capsule along the z axis: a cylinder with two caps."""
    import trimesh

    mesh = trimesh.creation.capsule(
        height=length / radius, radius=1.0, count=[CYLINDER_SIDES // 2, CYLINDER_SIDES // 2]
    )
    mesh.apply_scale(radius)
    return mesh


def _place_shape(surface: Trimesh, pose: FloatArray) -> LinkShape:
    """Return a shape transformed into its link's frame."""
    solid = _solid_or_hull(surface)
    vertices = np.asarray(solid.vertices, dtype=float) @ pose[:3, :3].T + pose[:3, 3]
    faces = np.asarray(solid.faces, dtype=np.int64)
    return LinkShape(vertices, faces, mesh_corners(vertices, vertices[faces]))


def _solid_or_hull(surface: Trimesh) -> Trimesh:
    """Return a surface, or its convex hull if the surface encloses almost no volume."""
    try:
        hull = surface.convex_hull
    except QhullError:  # coplanar points
        return surface
    return hull if abs(surface.volume) < SHEET_SHARE * hull.volume else surface


def _parse_numbers(text: str) -> FloatArray:
    """Return the numbers in a text as an array (n,)."""
    return np.array([float(value) for value in text.split()])
