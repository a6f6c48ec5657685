"""Numeric mesh body, read from the recorded source file and compared with its fingerprint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from nlpgrasp.common.meshes.mesh_file import mesh_digest, read_mesh, repaired_mesh
from nlpgrasp.common.meshes.sharp_edges import sharp_edges
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import UNITS, FloatArray, number
from nlpgrasp.errors import InputError
from nlpgrasp.verify.check import NotCheckedError
from nlpgrasp.verify.sources import SourceFolders
from nlpgrasp.verify.stated_placement import Fit
from nlpgrasp.verify.surface_geometry import TriangleSurface, from_segments

TOUCH_SHARE = 1e-6  # share of the body's size: triangles this close to a contact touch it
ROUND_TIPS = ("sphere", "cylinder")  # fingertips whose normal is the direction from their centre to the contact
PARALLEL_SINE = 1e-9  # sine of the angle below which vectors are parallel
RISE_SHARE = 1e-3  # share of the body's size: least length over which a rise is measured
GRID_POINTS, GRID_MARGIN, CELL_SHARE = 120_000, 0.5, 0.5  # the solver's distance grid of an obstacle


@dataclass(frozen=True)
class MeshSurface:
    """Surface of a mesh, with the single face ``surface``.

    Parameters
    ----------
    triangles : TriangleSurface
    """

    triangles: TriangleSurface

    @cached_property
    def bounds(self) -> FloatArray:
        """Bounding box of the triangles, (2, 3)."""
        corners = self.triangles.corners.reshape(-1, 3)
        return np.stack([corners.min(axis=0), corners.max(axis=0)])

    @cached_property
    def size(self) -> float:
        """Half the diagonal of the bounding box, metres."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0])) / 2.0

    @property
    def rough(self) -> float:
        """Tolerance of the solver's distances from a mesh obstacle: half a cell of its distance grid, metres."""
        sides = np.ptp(self.bounds, axis=0) + 2.0 * GRID_MARGIN * self.size
        return CELL_SHARE * float((np.prod(sides) / GRID_POINTS) ** (1.0 / 3.0))

    def fit(self, face: str, point: FloatArray, normal: FloatArray, tip: str | None) -> Fit:
        """Return the distance of a contact from the nearest triangle, and the deviation of its normal.

        A free contact has the normal of a triangle that it lies on. A round fingertip touches at the point nearest to
        its centre, also on edges and corners: no triangle there rises above the plane perpendicular to its normal.
        Other fingertips may keep the normal of the solver's smooth surface; its angle to the mesh's normals is stated.
        """
        if face != "surface":
            raise KeyError(face)
        nearby, distances = self.triangles.nearby_triangles(point, TOUCH_SHARE * self.size)
        touching = nearby[distances <= np.min(distances) + TOUCH_SHARE * self.size]
        if tip is None:
            differences = np.linalg.norm(normal + self.triangles.normals[touching], axis=1)
            least_difference = float(np.min(differences))
            return Fit(
                float(np.min(distances)), least_difference, 2.0 * float(np.arcsin(min(least_difference / 2.0, 1.0)))
            )
        angle = angle_off_cone(-normal, self.triangles.normals[touching])
        if tip not in ROUND_TIPS:
            return Fit(float(np.min(distances)), None, angle)
        offsets = (self.triangles.corners[touching] - point).reshape(-1, 3)
        rise = -(offsets @ normal) / np.maximum(np.linalg.norm(offsets, axis=1), RISE_SHARE * self.size)
        return Fit(float(np.min(distances)), max(0.0, float(np.max(rise))), angle)

    def edge_distance(self, face: str, point: FloatArray) -> float:
        """Return the distance of a face's point (space,) from the face's sharp edges, metres; infinite without any."""
        return from_segments(self._sharp)(point)

    @cached_property
    def _sharp(self) -> FloatArray:
        vertices, faces = self.triangles.vertices, self.triangles.faces
        return np.asarray(vertices[sharp_edges(vertices, faces)])

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distances of points (m, 3) from the mesh, not from a smoothed surface."""
        is_in_bounds = np.all((points >= self.bounds[0]) & (points <= self.bounds[1]), axis=1)
        distances = np.array([self.triangles.distance(p) for p in points])
        is_inside = [is_near and self.triangles.is_inside(p) for p, is_near in zip(points, is_in_bounds, strict=True)]
        return np.where(is_inside, -distances, distances)


def angle_off_cone(direction: FloatArray, generators: FloatArray) -> float:
    """Return the angle between a unit vector (3,) and the convex cone of unit vectors (n, 3), radians.

    The nearest vector of the cone is a generator, lies between two generators, or is the direction itself, which then
    is on the inner side of all planes through two generators that have the others on one side.
    """
    nearest = float(np.max(generators @ direction))
    first, second = np.triu_indices(len(generators), 1)
    plane_normals = np.cross(generators[first], generators[second])
    lengths = np.linalg.norm(plane_normals, axis=1)
    not_parallel = lengths > PARALLEL_SINE
    first, second, plane_normals = (
        first[not_parallel],
        second[not_parallel],
        plane_normals[not_parallel] / lengths[not_parallel, None],
    )
    if not len(plane_normals):
        return float(np.arccos(np.clip(nearest, -1.0, 1.0)))
    heights = plane_normals @ generators.T
    facets = np.concatenate(
        [
            plane_normals[np.all(heights >= -PARALLEL_SINE, axis=1)],
            -plane_normals[np.all(heights <= PARALLEL_SINE, axis=1)],
        ]
    )
    is_flat = np.all(np.abs(heights) <= PARALLEL_SINE)
    if not is_flat and np.all(facets @ direction >= 0.0):
        return 0.0
    projections = direction - (plane_normals @ direction)[:, None] * plane_normals
    is_between = np.einsum("ij,ij->i", np.cross(generators[first], projections), plane_normals) >= 0.0
    is_between &= np.einsum("ij,ij->i", np.cross(projections, generators[second]), plane_normals) >= 0.0
    nearest = max(nearest, float(np.max(np.linalg.norm(projections[is_between], axis=1), initial=-1.0)))
    return float(np.arccos(np.clip(nearest, -1.0, 1.0)))


class OtherMeshError(NotCheckedError):
    """Error raised if the file at the recorded source has another fingerprint than recorded.

    Parameters
    ----------
    why : str
    readings : sequence of MeshSurface
        The file's mesh in each possible unit.
    readers : sequence of str
        The libraries that read its triangles.
    """

    def __init__(self, why: str, readings: Sequence[MeshSurface], readers: Sequence[str]) -> None:
        super().__init__(why)
        self.readings, self.readers = readings, readers


def mesh(data: Json, sources: SourceFolders) -> MeshSurface:
    """Return the numeric mesh body, read from the recorded source file.

    It is read in the recorded unit, then in the others, until the fingerprint agrees: files of earlier versions record
    no unit.

    Raises
    ------
    InputError
        Where the fingerprint is that of another unit than the one recorded, or another number of triangles is.
    NotCheckedError
        Where the source is missing, is not a mesh, or (``OtherMeshError``) has another fingerprint.
    """
    path = sources.find(data.get("source"))
    recorded_unit, scale = data.get("unit"), number("problem.body.scale", data.get("scale", 1.0), above=0.0)
    readings: list[MeshSurface] = []
    readers: set[str] = {"trimesh"}
    for unit in UNITS if recorded_unit is None else (str(recorded_unit), *(u for u in UNITS if u != recorded_unit)):
        reading = _read_source_mesh(path, unit, scale)
        if reading is not None:
            surface, digest, repairs = reading
            if digest == data.get("sha256"):
                if recorded_unit not in (None, unit):
                    raise InputError(
                        "problem.body.unit", recorded_unit, f"{unit}, in which {path.name} has the sha256 stated"
                    )
                count = len(surface.triangles.faces)
                if data.get("triangles", count) != count:
                    raise InputError("problem.body.triangles", data["triangles"], f"{count}, as in {path.name}")
                return surface
            readings.append(surface)
            readers |= {"manifold3d"} if repairs else set()
    if not readings:
        raise NotCheckedError(f"{path.name} is not a mesh that can be read")
    raise OtherMeshError(f"{path.name} has another sha256 than the file records", readings, sorted(readers))


def _read_source_mesh(path: Path, unit: str, scale: float) -> tuple[MeshSurface, str, tuple[str, ...]] | None:
    """Return a mesh file's surface, fingerprint and repairs; None if it is no valid mesh in this unit and scale."""
    try:
        source_mesh, repairs = repaired_mesh(read_mesh(path, unit, scale)[0])
    except InputError:
        return None
    vertices = np.asarray(source_mesh.vertices, dtype=float)
    surface = MeshSurface(TriangleSurface(vertices, np.asarray(source_mesh.faces, dtype=np.int64)))
    return surface, mesh_digest(source_mesh), repairs
