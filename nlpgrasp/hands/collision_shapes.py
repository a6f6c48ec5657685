"""Collision shapes of links as triangle meshes with signed distances."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from nlpgrasp.common.meshes.search_tree import SearchTree
from nlpgrasp.common.validation import FloatArray

if TYPE_CHECKING:
    import trimesh


class MeshFile(NamedTuple):
    """A mesh file: name in the robot file, and SHA-256 of the content, hexadecimal."""

    name: str
    sha256: str

    @classmethod
    def of(cls, name: str, path: Path) -> MeshFile:
        """Return the record of the file at a path."""
        return cls(name, hashlib.sha256(path.read_bytes()).hexdigest())


@dataclass(frozen=True)
class CollisionShape:
    """A collision shape of a link, in the link's frame.

    Parameters
    ----------
    kind : {"sphere", "cylinder", "capsule", "ellipsoid", "box", "mesh"}
    mesh : trimesh.Trimesh
        The surface, metres, link frame; for spheres and cylinders a polyhedron around the exact surface.
    centre, radius : (3,) array and float, optional
        Of a sphere; the radius of a capsule too.
    size : tuple of float
        Dimensions of other shapes than spheres and meshes, metres: radius and length, or the lengths of a box.
    pose : (4, 4) array, optional
        Pose of such a shape in the link's frame; its axis is z.
    file : MeshFile, optional
        Source of the mesh.
    """

    kind: str
    mesh: trimesh.Trimesh
    centre: FloatArray | None = None
    radius: float = 0.0
    size: tuple[float, ...] = ()
    pose: FloatArray | None = None
    file: MeshFile | None = None

    @classmethod
    def sphere(cls, radius: float, pose: FloatArray) -> CollisionShape:
        """Return a sphere with the pose (4, 4)."""
        import trimesh

        mesh = trimesh.creation.icosphere(subdivisions=3)
        mesh.apply_scale(radius)
        mesh.apply_transform(pose)
        return cls("sphere", mesh, pose[:3, 3].copy(), radius)

    @classmethod
    def cylinder(cls, radius: float, length: float, pose: FloatArray) -> CollisionShape:
        """Return a cylinder along z with the pose (4, 4), as an enclosing prism of 32 sides."""
        import trimesh

        sides = 32
        mesh = trimesh.creation.cylinder(1.0, 1.0, sections=sides)  # of unit size: trimesh merges close vertices
        circumradius = radius / np.cos(np.pi / sides)
        mesh.apply_scale([circumradius, circumradius, length])
        mesh.apply_transform(pose)
        return cls("cylinder", mesh, size=(radius, length), pose=pose)

    @classmethod
    def capsule(cls, radius: float, length: float, pose: FloatArray) -> CollisionShape:
        """Return a capsule along z with the pose (4, 4); ``length`` excludes the round ends."""
        import trimesh

        mesh = trimesh.creation.capsule(height=length / radius, radius=1.0)
        mesh.apply_scale(radius)
        mesh.apply_transform(pose)
        return cls("capsule", mesh, radius=radius, size=(radius, length), pose=pose)

    @classmethod
    def ellipsoid(cls, semi_axes: FloatArray, pose: FloatArray) -> CollisionShape:
        """Return an ellipsoid with the pose (4, 4), as an enclosing polyhedron."""
        import trimesh

        mesh = trimesh.creation.icosphere(subdivisions=3)
        inradius = np.min(np.einsum("ij,ij->i", mesh.face_normals, mesh.triangles[:, 0]))  # radius of its inner ball
        mesh.apply_scale(semi_axes / inradius)
        mesh.apply_transform(pose)
        return cls("ellipsoid", mesh)

    @classmethod
    def box(cls, size: FloatArray, pose: FloatArray) -> CollisionShape:
        """Return a box with the pose (4, 4)."""
        import trimesh

        cube = _unit_cube()
        vertices = (cube.vertices * size) @ pose[:3, :3].T + pose[:3, 3]
        mesh = trimesh.Trimesh(vertices, cube.faces, process=False)
        return cls("box", mesh, size=tuple(map(float, size)), pose=pose)

    @property
    def ends(self) -> FloatArray | None:
        """Ends of a capsule's axis, (2, 3), metres, link frame; None for other shapes."""
        if self.kind != "capsule" or self.pose is None:
            return None
        return np.asarray(self.pose[:3, 3] + np.outer([-0.5, 0.5], self.size[1] * self.pose[:3, 2]))

    @property
    def content(self) -> bytes:
        """Bytes that determine the shape, for cache keys."""
        centre = np.zeros(0) if self.centre is None else self.centre
        arrays = [self.mesh.vertices, self.mesh.faces, centre, [self.radius]]
        return self.kind.encode() + b"".join(np.asarray(values, dtype=float).tobytes() for values in arrays)

    @property
    def fingerprint(self) -> bytes:
        """Digest that is equal for equal shapes."""
        return np.asarray(self.mesh.vertices, dtype=float).round(9).tobytes()

    def depth(self, points: FloatArray) -> FloatArray:
        """Return the signed depth of points (m, 3) below the surface, (m,), metres, negative outside."""
        if self.centre is not None:
            return np.asarray(self.radius - np.linalg.norm(points - self.centre, axis=1))
        if (ends := self.ends) is not None:
            axis, offsets = ends[1] - ends[0], points - ends[0]
            share = np.clip(offsets @ axis / max(float(axis @ axis), 1e-30), 0.0, 1.0)
            return np.asarray(self.radius - np.linalg.norm(offsets - share[:, None] * axis, axis=1))
        if self.kind not in ("box", "cylinder"):
            return -self._tree.signed_distance(points)
        normals, offsets = self._planes
        depths = np.min(offsets - points @ normals.T, axis=1)
        outside = depths < 0.0
        depths[outside] = -np.sqrt(self._tree.nearest(points[outside])[0])
        return np.asarray(depths)

    @cached_property
    def _planes(self) -> tuple[FloatArray, FloatArray]:
        """Outward unit normals (f, 3) and offsets (f,), metres, of the faces of a convex shape."""
        _, first = np.unique(np.asarray(self.mesh.face_normals).round(6), axis=0, return_index=True)
        normals = np.asarray(self.mesh.face_normals)[first]
        return normals, np.einsum("fx,fx->f", normals, np.asarray(self.mesh.triangles)[first, 0])

    @cached_property
    def _tree(self) -> SearchTree:
        return SearchTree(np.asarray(self.mesh.vertices), np.asarray(self.mesh.faces))


@cache
def _unit_cube() -> trimesh.Trimesh:
    """Return the cube of unit sides about the origin."""
    import trimesh

    return trimesh.creation.box()
