"""Body from a triangle mesh: smoothed signed distance, sharp edges, normal cones."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, NoReturn

import casadi as ca
import numpy as np

from nlpgrasp.bodies.base import Body, Face
from nlpgrasp.bodies.mesh.defects import defect_warnings, refuse_guessed_surface
from nlpgrasp.bodies.mesh.signed_distance import (
    FINEST,
    DistanceSpline,
    SmoothOffset,
    choose_grid_resolution,
    distance_spline,
    edge_distance_spline,
    smooth_offset,
    wall_thickness,
)
from nlpgrasp.common.least_squares import nonnegative_least_squares
from nlpgrasp.common.meshes.intersections import is_covered, normals_of
from nlpgrasp.common.meshes.mass_properties import volume_integrals
from nlpgrasp.common.meshes.mesh_file import mesh_digest, read_mesh, repaired_mesh, scale_mesh
from nlpgrasp.common.meshes.search_tree import SearchTree
from nlpgrasp.common.meshes.sharp_edges import sharp_edges
from nlpgrasp.common.registry import incomplete_data
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.user_warnings import warn_once
from nlpgrasp.common.validation import FloatArray, IntArray, integer, metres_per, number

if TYPE_CHECKING:
    import trimesh

TOUCHING = 1e-6  # of the size: distance within which a triangle contains a point
EDGE_OVERESTIMATE = 0.1  # grid cells: overestimate of the splined distance from sharp edges, 90th percentile
DRAWS = 4  # most draws of samples, while too few of them are off sharp edges
ROOM_SAMPLES = 4000  # surface points for the largest distance from sharp edges
OFFSET_SAMPLES = 300  # mesh points for the distance to the smooth surface
CLEARANCE_POINTS, CLEARANCE_MARGIN = 120_000, 0.5  # distance grid for hand links: points; margin over the size


class Mesh(Body):
    """A closed triangle mesh; one face, ``surface``: the outer surface of the union of its parts.

    The solver sees a smoothed signed-distance B-spline of the mesh; the contacts of a solution are projected onto
    the mesh itself before their quality is certified.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        Vertices in metres, or in ``unit``.
    smoothing : float, optional
        Standard deviation of the Gaussian over the distance grid, in grid cells; 0 for none. When left out: 1.5, or
        less for thin walls, so that 2.4 of it fit into a wall (see ``choose_grid_resolution``).
    resolution : int, optional
        Grid cells along the longest side, from 8 to 400. When left out: 48, or more for slender bodies, so that the
        shortest side has 16, and for walls that need a smoothing below 0.75; up to 600,000 grid points.
    source : str, optional
        Where the mesh comes from, for the record.
    unit : {"m", "dm", "cm", "mm", "in", "ft"}
        Of the vertices given; the body's own are metres.
    scale : float
        Further factor on the vertices, such as that of an object in a data set of normalised meshes.

    Attributes
    ----------
    mesh : trimesh.Trimesh
        The mesh as used.
    repairs : tuple of str
        Repairs made, and warnings on remaining defects, one sentence each.
    unit : str or None
        Of the file's coordinates, where ``load`` read one: a name, or metres as ``"0.9144 m"``.
    scale : float
        Further factor on the file's coordinates, where ``load`` read one.
    smoothing : float
        As given, or chosen.
    resolution : int
        As given, or chosen.

    Raises
    ------
    InputError
        When the mesh has no volume, is open or crosses itself beyond repair, has holes of more than 5 % of its surface
        or faces with a reversed copy that repair would not restore, has NaN, or is 1000 times too large or small.
    """

    kind: ClassVar[str] = "mesh"

    def __init__(
        self,
        mesh: trimesh.Trimesh,
        smoothing: float | None = None,
        resolution: int | None = None,
        source: str | None = None,
        *,
        unit: str = "m",
        scale: float = 1.0,
    ) -> None:
        if smoothing is not None:
            smoothing = number("Mesh.smoothing", smoothing, at_least=0.0)
        if resolution is not None:
            resolution = integer("Mesh.resolution", resolution, at_least=8, at_most=FINEST)
        self.source = None if source is None else str(source)
        self.unit: str | None = None
        self.scale = 1.0
        scaled = scale_mesh(mesh, number("Mesh.scale", scale, above=0.0) * metres_per("Mesh.unit", unit))
        self.mesh, repairs = repaired_mesh(scaled)
        if repairs:
            refuse_guessed_surface(scaled, self.mesh)
        warnings = defect_warnings(self.mesh)
        for text in warnings:
            warn_once(text)
        self.repairs = (*repairs, *warnings)
        if smoothing is None or resolution is None:
            grid = choose_grid_resolution(np.ptp(self.mesh.bounds, axis=0), self.wall, smoothing, resolution)
            smoothing, resolution = grid.smoothing, grid.resolution
        self.smoothing, self.resolution = smoothing, resolution
        vertices, faces = np.asarray(self.mesh.vertices, dtype=float), np.asarray(self.mesh.faces)
        self._spline = distance_spline(vertices, faces, resolution, smoothing)

    @classmethod
    def load(
        cls,
        path: str | Path,
        unit: str | None = None,
        smoothing: float | None = None,
        resolution: int | None = None,
        *,
        scale: float = 1.0,
    ) -> Mesh:
        """Load a body from a mesh file.

        Parameters
        ----------
        path : str or Path
            STL, OBJ, PLY, OFF or whatever else ``trimesh`` reads.
        unit : {"m", "dm", "cm", "mm", "in", "ft"}, optional
            Of the file's coordinates; by default the unit that the file states, else metres, where a long body gives a
            warning. 3MF and COLLADA state a unit, glTF and STEP are in metres, and a comment of an OBJ, PLY or STL file
            that is nothing but a unit counts. Another unit than the stated one is refused.
        smoothing, resolution, scale
            See the class.
        """
        factor = number("Mesh.scale", scale, above=0.0)
        mesh, used = read_mesh(path, unit, factor)
        body = cls(mesh, smoothing, resolution, source=Path(path).name)
        body.unit, body.scale = used, factor
        return body

    def __repr__(self) -> str:
        sides = " x ".join(f"{1e3 * side:.4g}" for side in np.ptp(self.bounds, axis=0))
        name = "" if self.source is None else f"{self.source!r}, "
        return f"{type(self).__name__}({name}{len(self.mesh.faces)} triangles, {sides} mm)"

    @property
    def bounds(self) -> FloatArray:
        """Bounding box of the mesh, (2, 3): lower corner, upper corner, metres."""
        return np.asarray(self.mesh.bounds, dtype=float)

    @cached_property
    def centroid(self) -> FloatArray:
        """Centre of the mesh's volume, (3,), metres."""
        return volume_integrals(self.mesh).centre

    @cached_property
    def wall(self) -> float:
        """Wall thickness, metres: the 20th percentile over the surface."""
        return wall_thickness(self.mesh)

    @cached_property
    def offset(self) -> SmoothOffset:
        """Typical and largest distance between the mesh and its smoothed surface, metres."""
        points, _ = self.surface_samples(OFFSET_SAMPLES, np.random.default_rng(0))
        return smooth_offset(self, points, self._cell, self.wall)

    @property
    def _cell(self) -> float:
        """Side length of a cell of the smoothed distance grid, metres."""
        return float(np.max(np.ptp(self.bounds, axis=0))) / self.resolution

    @property
    def symbol(self) -> type[ca.MX]:
        """CasADi type of the surface, ``casadi.MX``: a spline has no scalar expression graph."""
        return ca.MX

    @property
    def cramped(self) -> bool:
        """Always true: a mesh may be concave."""
        return True

    def make_faces(self) -> tuple[Face, ...]:
        """Return the one face: the zero set of the smoothed distance spline."""
        return (Face("surface", self._spline.expression, edges=self._edge_distances),)

    def _edge_distances(self, p: Expression) -> list[Expression]:
        """Return the spline of a point's distance from the sharp edges, reduced by the spline's typical error.

        One CasADi expression in a list, metres; an empty list without sharp edges.
        """
        if not len(self._edges):
            return []
        return [self._edge_spline.expression(p) - EDGE_OVERESTIMATE * self._cell]

    @cached_property
    def _edge_spline(self) -> DistanceSpline:
        return edge_distance_spline(np.asarray(self.mesh.vertices, dtype=float), self._edges.ends, self.resolution)

    def sample(self, name: str, count: int, rng: np.random.Generator, margin: float = 0.0) -> FloatArray:
        """Return random points (m, 3) of the smooth surface, off sharp edges by a margin; see ``Body.sample``."""
        if margin == 0.0:
            return super().sample(name, count, rng)
        samples = np.zeros((0, 3))
        for _ in range(DRAWS):
            points = super().sample(name, count, rng)
            samples = np.concatenate([samples, points[self.edge_distance(name, points) >= margin]])
            if len(samples) >= count:
                break
        return samples[:count]

    def _surrounding_points(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Return random points (m, 3) of the mesh itself."""
        return self.surface_samples(count + count // 4, rng)[0]

    def distance(self, p: Expression) -> Expression:
        """Return the spline of the unsmoothed signed distance at a CasADi point; beyond the grid, a lower bound."""
        return self._clearance_spline.extended(p)

    @cached_property
    def _clearance_spline(self) -> DistanceSpline:
        vertices = np.asarray(self.mesh.vertices, dtype=float)
        margin = CLEARANCE_MARGIN * self.size
        sides = np.ptp(self.bounds, axis=0) + 2.0 * margin
        cells = (CLEARANCE_POINTS / np.prod(sides)) ** (1.0 / 3.0) * float(np.max(np.ptp(self.bounds, axis=0)))
        return distance_spline(vertices, np.asarray(self.mesh.faces), max(int(cells), 8), 0.0, margin)

    def distance_on_grid(self, axes: Sequence[FloatArray]) -> FloatArray:
        """Return the distance of ``distance`` at the points of a tensor grid, (nx, ny, nz), metres."""
        return self._clearance_spline.on_grid(axes)

    def smooth_distance_on_grid(self, axes: Sequence[FloatArray]) -> FloatArray:
        """Return the smoothed distance at the points of a tensor grid, (nx, ny, nz), metres."""
        return self._spline.on_grid(axes)

    def edge_distance_on_grid(self, axes: Sequence[FloatArray]) -> FloatArray | None:
        """Return the reduced distance from sharp edges at the points of a tensor grid, (nx, ny, nz), metres."""
        if not len(self._edges):
            return None
        return np.asarray(self._edge_spline.on_grid(axes) - EDGE_OVERESTIMATE * self._cell)

    def signed_distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance of points (m, 3) to the mesh within 1 %, (m,), metres, negative inside."""
        return self._tree.signed_distance(points)

    def clearance(self, points: FloatArray) -> FloatArray:
        """Return the exact signed distance of points (m, 3) to the mesh, (m,), metres, negative inside."""
        return self._tree.exact_signed_distance(points)

    def closest(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the points of the mesh nearest to points (m, 3), with outward normals and distances.

        Parameters
        ----------
        points : (m, 3) array
            Metres, body frame.

        Returns
        -------
        positions : (m, 3) array
            Metres, body frame.
        normals : (m, 3) array
            Unit, of the triangles the positions lie in.
        distances : (m,) array
            Metres, at least zero.
        """
        # trimesh's own closest_point is off by up to 0.3 mm on scans with thin triangles
        squared, triangles, positions = self._tree.nearest(points)
        return positions, np.asarray(self.mesh.face_normals)[triangles], np.sqrt(squared)

    def triangles_at(self, points: FloatArray) -> IntArray:
        """Return the indices (m,) of the triangles nearest to points (m, 3)."""
        return np.asarray(self._tree.nearest(points)[1], dtype=np.intp)

    def angles_off_normals(self, points: FloatArray, normals: FloatArray, on_edges: bool = True) -> FloatArray:
        """Return the angles (m,), radians, between unit normals (m, 3) and the mesh's normals at points (m, 3).

        With ``on_edges``, an edge or a vertex has the convex cone of its triangles' normals.
        """
        return angles_off_normals(np.asarray(self.mesh.triangles, float), points, normals, self.size, on_edges)

    @cached_property
    def _tree(self) -> SearchTree:
        return SearchTree(np.asarray(self.mesh.vertices), np.asarray(self.mesh.faces))

    def edge_distance(self, name: str, points: FloatArray) -> FloatArray:
        """Return the distances (m,), metres, of points (m, 3) from the nearest sharp edge; inf without sharp edges."""
        del name
        return self._edges.distance(points)

    def sharp_edges(self, point: FloatArray, count: int) -> FloatArray:
        """Return the end points (m, 2, 3) of up to ``count`` sharp edges nearest to a point (3,)."""
        return self._edges.nearest(point, count)

    @property
    def sharp_edge_count(self) -> int:
        """Number of sharp edges."""
        return len(self._edges)

    @cached_property
    def has_flat_faces(self) -> bool:
        """Whether most of the surface is in flat faces, of two triangles or more each, as on a machined part."""
        is_flat = np.zeros(len(self.mesh.faces), bool)
        is_flat[self.mesh.face_adjacency[self.mesh.face_adjacency_angles < 1e-3]] = True
        return bool(self.mesh.area_faces[is_flat].sum() > 0.5 * self.mesh.area)

    def room(self, name: str) -> float:
        """Return the largest distance of sampled surface points from sharp edges, metres; inf without sharp edges."""
        del name
        return self._room

    @cached_property
    def _room(self) -> float:
        if not len(self._edges):
            return np.inf
        points, _ = self.surface_samples(ROOM_SAMPLES, np.random.default_rng(0))
        return float(np.max(self._edges.distance(points)))

    @cached_property
    def _edges(self) -> SharpEdges:
        return SharpEdges(self.mesh)

    def surface_samples(self, count: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Return random points of the mesh, uniform by area, and their outward normals, (count, 3) each."""
        import trimesh

        points, triangles = trimesh.sample.sample_surface(self.mesh, count, seed=rng)
        return np.asarray(points), np.asarray(self.mesh.face_normals)[triangles]

    def to_dict(self) -> Json:
        """Return source, unit and scale, SHA-256 and settings as JSON data, without the triangles."""
        return {
            "type": self.kind,
            "source": self.source,
            "unit": self.unit,
            **({} if self.scale == 1.0 else {"scale": self.scale}),
            "sha256": mesh_digest(self.mesh),
            "triangles": len(self.mesh.faces),
            "smoothing": self.smoothing,
            "resolution": self.resolution,
            "repairs": list(self.repairs),
        }

    @classmethod
    def from_dict(cls, data: Json) -> NoReturn:
        """Raise: the data refer to a mesh but do not contain it."""
        raise incomplete_data("body of type mesh", "its triangles, which stay in their file: ng.Mesh.load(path, unit)")


class SharpEdges:
    """Sharp edges of a mesh, convex or concave, as ``sharp_edges`` defines them.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        Vertices in metres.
    """

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self._vertices = np.asarray(mesh.vertices, dtype=float)
        self._edges: IntArray = sharp_edges(self._vertices, np.asarray(mesh.faces))
        self._tree = SearchTree(self._vertices, self._edges)

    @property
    def ends(self) -> IntArray:
        """Vertex indices of each edge, (m, 2)."""
        return self._edges

    def __len__(self) -> int:
        """Return the number of edges."""
        return len(self._edges)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distances (m,), metres, of points (m, 3) from the nearest sharp edge; inf without sharp edges."""
        if not len(self._edges) or not len(points):
            return np.full(len(points), np.inf)
        return np.asarray(np.sqrt(self._tree.nearest(points)[0]))

    def nearest(self, point: FloatArray, count: int) -> FloatArray:
        """Return the end points (m, 2, 3) of up to ``count`` sharp edges nearest to a point (3,)."""
        ends = self._vertices[self._edges]
        directions = ends[:, 1] - ends[:, 0]
        position = np.sum((point - ends[:, 0]) * directions, axis=1) / np.maximum(np.sum(directions**2, axis=1), 1e-300)
        foot = ends[:, 0] + np.clip(position, 0.0, 1.0)[:, None] * directions
        return np.asarray(ends[np.argsort(np.linalg.norm(foot - point, axis=1), kind="stable")[:count]])


def angles_off_normals(
    corners: FloatArray, points: FloatArray, normals: FloatArray, size: float, on_edges: bool
) -> FloatArray:
    """Return the angles (m,), radians, between unit normals (m, 3) and the mesh's normals at points (m, 3).

    Parameters
    ----------
    corners : (f, 3, 3) array
        Of the triangles, metres, counter-clockwise from outside.
    points : (m, 3) array
        On the mesh, metres.
    normals : (m, 3) array
    size : float
        Of the mesh, metres.
    on_edges : bool
        Whether edges and vertices have the convex cone of their triangles' normals, as for a fingertip that touches
        them; else only the normals themselves.
    """
    slack = TOUCHING * size
    lower, upper = corners.min(axis=1) - slack, corners.max(axis=1) + slack
    result = np.full(len(points), np.pi)
    for i, (point, normal) in enumerate(zip(points, normals, strict=True)):
        triangles = corners[np.all((lower <= point) & (point <= upper), axis=1)]
        triangles = triangles[is_covered(np.broadcast_to(point, triangles.shape), triangles, slack)]
        if len(triangles):
            result[i] = _angle_to_cone(normals_of(triangles), normal, on_edges)
    return result


def _angle_to_cone(normals: FloatArray, normal: FloatArray, in_cone: bool) -> float:
    """Return the angle, radians, between a unit vector (3,) and the nearest of (n, 3) unit vectors.

    With ``in_cone``, also the vectors of their convex cone count.
    """
    smallest = float(np.min(2.0 * np.arcsin(np.clip(np.linalg.norm(normals - normal, axis=1) / 2.0, 0.0, 1.0))))
    if not in_cone or len(normals) == 1:
        return smallest
    # the distance of a unit vector from a cone is the sine of the angle, below 90 degrees; without weights it is 1
    weights, residual = nonnegative_least_squares(np.unique(normals, axis=0).T, normal)
    return min(smallest, float(np.arcsin(min(residual, 1.0)))) if np.any(weights) else smallest
