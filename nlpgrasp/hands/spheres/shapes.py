"""Collision shapes of links, as surface samples and signed distances."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.common.meshes.search_tree import SearchTree
from nlpgrasp.common.validation import FloatArray

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True)
class Shape:
    """A collision shape in its link's frame.

    Parameters
    ----------
    kind : {"sphere", "cylinder", "capsule", "ellipsoid", "box", "mesh"}
    mesh : trimesh.Trimesh
        The surface, metres, link frame; for spheres and cylinders a polyhedron around the exact surface.
    centre, radius : (3,) array and float, optional
        Of a sphere; the radius of a capsule too.
    ends : (2, 3) array, optional
        Ends of a capsule's axis, metres, link frame.
    """

    kind: str
    mesh: trimesh.Trimesh
    centre: FloatArray | None = None
    radius: float = 0.0
    ends: FloatArray | None = None

    @classmethod
    def sphere(cls, radius: float, pose: FloatArray) -> Shape:
        """Return a sphere at a pose (4, 4)."""
        import trimesh

        mesh = trimesh.creation.icosphere(subdivisions=3)
        mesh.apply_scale(radius)
        mesh.apply_transform(pose)
        return cls("sphere", mesh, pose[:3, 3].copy(), radius)

    @classmethod
    def cylinder(cls, radius: float, length: float, pose: FloatArray) -> Shape:
        """Return a cylinder along z at a pose (4, 4), of 32 sides that enclose the exact one."""
        import trimesh

        sides = 32
        mesh = trimesh.creation.cylinder(1.0, 1.0, sections=sides)  # of unit size: trimesh merges close vertices
        around = radius / np.cos(np.pi / sides)
        mesh.apply_scale([around, around, length])
        mesh.apply_transform(pose)
        return cls("cylinder", mesh)

    @classmethod
    def capsule(cls, radius: float, length: float, pose: FloatArray) -> Shape:
        """Return a capsule along z at a pose (4, 4); ``length`` is without the round ends."""
        import trimesh

        mesh = trimesh.creation.capsule(height=length / radius, radius=1.0)
        mesh.apply_scale(radius)
        mesh.apply_transform(pose)
        ends = pose[:3, 3] + np.outer([-0.5, 0.5], length * pose[:3, 2])
        return cls("capsule", mesh, radius=radius, ends=ends)

    @classmethod
    def ellipsoid(cls, semi_axes: FloatArray, pose: FloatArray) -> Shape:
        """Return an ellipsoid at a pose (4, 4), as a polyhedron that encloses it."""
        import trimesh

        mesh = trimesh.creation.icosphere(subdivisions=3)
        inner = np.min(np.einsum("ij,ij->i", mesh.face_normals, mesh.triangles[:, 0]))  # its faces' least distance
        mesh.apply_scale(semi_axes / inner)
        mesh.apply_transform(pose)
        return cls("ellipsoid", mesh)

    @classmethod
    def box(cls, size: FloatArray, pose: FloatArray) -> Shape:
        """Return a box at a pose (4, 4)."""
        import trimesh

        return cls("box", trimesh.creation.box(size, transform=pose))

    @property
    def content(self) -> bytes:
        """All that the shape is."""
        own = [self.mesh.vertices, self.mesh.faces, np.zeros(0) if self.centre is None else self.centre, [self.radius]]
        return self.kind.encode() + b"".join(np.asarray(part, dtype=float).tobytes() for part in own)

    @property
    def fingerprint(self) -> bytes:
        """The same for shapes that are alike."""
        return np.asarray(self.mesh.vertices, dtype=float).round(9).tobytes()

    def depth(self, points: FloatArray) -> FloatArray:
        """Return how deep points (m, 3) are inside, metres, negative outside."""
        if self.centre is not None:
            return np.asarray(self.radius - np.linalg.norm(points - self.centre, axis=1))
        return -self._tree.signed_distance(points)

    @cached_property
    def _tree(self) -> SearchTree:
        return SearchTree(np.asarray(self.mesh.vertices), np.asarray(self.mesh.faces))
