"""Mesh bodies: read again from the recorded source if its fingerprint agrees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from nlpgrasp.common.meshes.mesh_file import mesh_digest, read_mesh, repaired_mesh
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import UNITS, FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.verify.check import NotCheckedError
from nlpgrasp.verify.sources import SourceFolders
from nlpgrasp.verify.stated_placement import Fit
from nlpgrasp.verify.surface_geometry import TriangleSurface, from_segments, sharp_segments

TOUCHING = 1e-6  # share of the body's size: triangles this close to a contact touch it
ROUND = ("sphere", "cylinder")  # fingertips whose normal is the direction from their centre to the contact
PARALLEL = 1e-9  # sine of the angle below which vectors are parallel
BESIDE = 1e-3  # share of the body's size: least length over which a rise is measured
GRID_POINTS, GRID_MARGIN, CELL_SHARE = 120_000, 0.5, 0.5  # the solver's distance grid of an obstacle


@dataclass(frozen=True)
class MeshSurface:
    """Surface of a mesh, with the one face ``surface``.

    Parameters
    ----------
    triangles : TriangleSurface
    """

    triangles: TriangleSurface
    tight: bool = True

    @cached_property
    def bounds(self) -> FloatArray:
        """Bounding box of the triangles, (2, 3)."""
        corners = self.triangles.corners.reshape(-1, 3)
        return np.stack([corners.min(axis=0), corners.max(axis=0)])

    @cached_property
    def size(self) -> float:
        """Half the bounding box's diagonal, metres."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0])) / 2.0

    @property
    def rough(self) -> float:
        """Half a cell of the solver's distance grid of an obstacle, metres."""
        sides = np.ptp(self.bounds, axis=0) + 2.0 * GRID_MARGIN * self.size
        return CELL_SHARE * float((np.prod(sides) / GRID_POINTS) ** (1.0 / 3.0))

    def fit(self, face: str, point: FloatArray, normal: FloatArray, tip: str | None) -> Fit:
        """Return a contact's distance from the nearest triangle, and its normal's deviation from the expected one.

        A free contact has the normal of a triangle that it lies on. A round fingertip touches at the point nearest to
        its centre, also on edges and corners: no triangle there rises above the plane perpendicular to its normal.
        Other fingertips may keep the normal of the solver's smooth surface; its angle to the mesh's normals is stated.
        """
        if face != "surface":
            raise KeyError(face)
        which, off = self.triangles.near(point, TOUCHING * self.size)
        touching = which[off <= np.min(off) + TOUCHING * self.size]
        if tip is None:
            differences = np.linalg.norm(normal + self.triangles.normals[touching], axis=1)
            least = float(np.min(differences))
            return Fit(float(np.min(off)), least, 2.0 * float(np.arcsin(min(least / 2.0, 1.0))))
        angle = angle_off_cone(-normal, self.triangles.normals[touching])
        if tip not in ROUND:
            return Fit(float(np.min(off)), None, angle)
        there = (self.triangles.corners[touching] - point).reshape(-1, 3)
        rise = -(there @ normal) / np.maximum(np.linalg.norm(there, axis=1), BESIDE * self.size)
        return Fit(float(np.min(off)), max(0.0, float(np.max(rise))), angle)

    def edge_distance(self, face: str, point: FloatArray) -> float:
        """Return the distance of a point (space,) of a face from its sharp edges, metres; infinite without any."""
        return from_segments(self._sharp)(point)

    @cached_property
    def _sharp(self) -> FloatArray:
        return sharp_segments(self.triangles)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance of points (m, 3) from the mesh itself."""
        boxed = np.all((points >= self.bounds[0]) & (points <= self.bounds[1]), axis=1)
        found = np.array([self.triangles.distance(p) for p in points])
        inside = [near and self.triangles.is_inside(p) for p, near in zip(points, boxed, strict=True)]
        return np.where(inside, -found, found)


def angle_off_cone(direction: FloatArray, generators: FloatArray) -> float:
    """Return the angle of a unit vector (3,) to the convex cone of unit vectors (n, 3), radians.

    The nearest vector of the cone is a generator, lies between two generators, or is the direction itself, which then
    is on the inner side of all planes through two generators that have the others on one side.
    """
    nearest = float(np.max(generators @ direction))
    one, other = np.triu_indices(len(generators), 1)
    across = np.cross(generators[one], generators[other])
    length = np.linalg.norm(across, axis=1)
    proper = length > PARALLEL
    one, other, across = one[proper], other[proper], across[proper] / length[proper, None]
    if not len(across):
        return float(np.arccos(np.clip(nearest, -1.0, 1.0)))
    heights = across @ generators.T
    facets = np.concatenate(
        [across[np.all(heights >= -PARALLEL, axis=1)], -across[np.all(heights <= PARALLEL, axis=1)]]
    )
    flat = np.all(np.abs(heights) <= PARALLEL)
    if not flat and np.all(facets @ direction >= 0.0):
        return 0.0
    within = direction - (across @ direction)[:, None] * across
    inside = np.einsum("ij,ij->i", np.cross(generators[one], within), across) >= 0.0
    inside &= np.einsum("ij,ij->i", np.cross(within, generators[other]), across) >= 0.0
    nearest = max(nearest, float(np.max(np.linalg.norm(within[inside], axis=1), initial=-1.0)))
    return float(np.arccos(np.clip(nearest, -1.0, 1.0)))


class OtherMeshError(NotCheckedError):
    """Error on a file at the recorded source with another fingerprint than recorded.

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
    """Return the mesh of the recorded source.

    It is read in the recorded unit, then in the others, until the fingerprint agrees: files of earlier versions record
    no unit.

    Raises
    ------
    InputError
        Where the fingerprint is that of another unit than the one recorded.
    NotMadeError
        Where the source is missing, is not a mesh, or (``OtherMeshError``) has another fingerprint.
    """
    place = sources.find(data.get("source"))
    known = data.get("unit")
    readings: list[MeshSurface] = []
    readers: set[str] = {"trimesh"}
    for unit in UNITS if known is None else (str(known), *(u for u in UNITS if u != known)):
        reading = _read_source_mesh(place, unit)
        if reading is not None:
            surface, digest, repairs = reading
            if digest == data.get("sha256"):
                if known not in (None, unit):
                    raise InputError("problem.body.unit", known, f"{unit}, in which {place.name} has the sha256 stated")
                return surface
            readings.append(surface)
            readers |= {"manifold3d"} if repairs else set()
    if not readings:
        raise NotCheckedError(f"{place.name} is not a mesh that can be read")
    raise OtherMeshError(f"{place.name} has another sha256 than the file records", readings, sorted(readers))


def _read_source_mesh(place: Path, unit: str) -> tuple[MeshSurface, str, tuple[str, ...]] | None:
    """Return the mesh with its fingerprint and repairs; None where it cannot be used in this unit."""
    try:
        found, repairs = repaired_mesh(read_mesh(place, unit))
    except InputError:
        return None
    vertices = np.asarray(found.vertices, dtype=float)
    surface = MeshSurface(TriangleSurface(vertices, np.asarray(found.faces, dtype=np.int64)))
    return surface, mesh_digest(found), repairs
