"""Smoothed signed distance of a mesh: grid, Gaussian filter, cubic B-spline, resolution from the wall thickness."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from nlpgrasp.bodies.base import Body
from nlpgrasp.common.cache import cached_arrays
from nlpgrasp.common.meshes.search_tree import SearchTree, local_origin, relative_to
from nlpgrasp.common.meshes.topology import is_plain
from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    import trimesh


LONGEST_SIDE, SHORTEST_SIDE = 48, 16  # least number of grid cells along these sides
MOST_POINTS = 600_000  # of the grid
PADDING = 5  # grid cells beyond the mesh (a CasADi B-spline is zero outside its grid, so normals are NaN)
FINEST = 400  # largest number of cells along the longest side
SMOOTHING, LEAST_SMOOTHING = 1.5, 0.75  # cells, Gaussian's deviation: default, and least before the grid is refined
DEVIATIONS = 2.4  # standard deviations of the Gaussian per wall thickness, at least
EXACT_CELLS, EXACT_UNSMOOTHED = 3, 5  # grid cells from the surface within which distances are exact
RAYS, THIN = 2000, 0.2  # number of rays; quantile of their lengths
SCALED, BEHIND = 1e3, 1e-3  # diagonal of the scaled mesh, and depth below its surface at which rays begin
STEPS = 12  # Newton steps from mesh points to the smoothed surface
OFFSET_QUANTILE = 0.8  # quantile of the offset over the surface

ROUNDING = 1e-9  # relative error of distances, at most
GridDistance = Callable[[FloatArray, BoolArray, float], FloatArray]  # points of a grid, chosen ones, spacing, metres


@dataclass(frozen=True)
class GridResolution:
    """Resolution of a distance grid and standard deviation of its Gaussian filter.

    Parameters
    ----------
    smoothing : float
        Standard deviation, in cells.
    resolution : int
        Cells along the longest side.
    """

    smoothing: float
    resolution: int


def choose_grid_resolution(
    extents: FloatArray, wall: float, smoothing: float | None = None, resolution: int | None = None
) -> GridResolution:
    """Return the resolution and smoothing of a distance grid that suit the thickness of a body's walls.

    Given values are kept. Unless the smoothing is given, walls are at least 2.4 standard deviations of the Gaussian
    thick. The Gaussian lifts the distance inside a wall from both sides, so a wide one moves the smooth
    surface inwards: by a sixteenth of an even wall's thickness at 2.4 deviations, and at less than 1.6 the wall
    vanishes. Thick walls get a Gaussian of 1.5 cells on the default grid. For thinner walls the smoothing is reduced
    first, which costs nothing; below 0.75 cells the grid is refined, up to 600,000 points, and where these do not
    suffice the smoothing is reduced further.

    Parameters
    ----------
    extents : (3,) array
        Sides of the bounding box, metres.
    wall : float
        Thickness, metres.
    smoothing : float, optional
        In cells.
    resolution : int, optional
        Cells along the longest side.
    """
    per_cell = DEVIATIONS * float(np.max(extents)) / wall  # the resolution that fits the wall, per cell of smoothing
    if resolution is None:
        least_smoothing = max(LEAST_SMOOTHING, 0.0 if smoothing is None else smoothing)
        default = automatic_resolution(extents)
        resolution = max(default, _limit_grid(int(np.ceil(min(per_cell * least_smoothing, FINEST))), extents, default))
    if smoothing is None:
        smoothing = min(SMOOTHING, np.floor(100.0 * resolution / per_cell) / 100.0)  # two decimals, rounded down
    return GridResolution(float(smoothing), resolution)


def automatic_resolution(extents: FloatArray) -> int:
    """Return the default number of grid cells along the longest side of a bounding box.

    The shortest side has at least 16 cells, unless the grid then has more than 600,000 points. On a grid too coarse for
    a slender part, smoothing dissolves it: at 48 cells a hammer's handle moved by 13 mm.

    Parameters
    ----------
    extents : (3,) array
        Sides of the bounding box, metres.
    """
    longest, shortest = float(np.max(extents)), float(max(np.min(extents), 1e-6))
    resolution = max(LONGEST_SIDE, int(np.ceil(SHORTEST_SIDE * longest / shortest)))
    return _limit_grid(resolution, extents, LONGEST_SIDE)


def _limit_grid(resolution: int, extents: FloatArray, least: int) -> int:
    """Return the resolution, reduced to at most 600,000 grid points but not below ``least``."""
    while resolution > least:
        if np.prod(extents / np.max(extents) * resolution + 1 + 2 * PADDING) <= MOST_POINTS:
            break
        resolution -= max(1, resolution // 20)
    return max(resolution, least)


@dataclass(frozen=True)
class DistanceSpline:
    """A tensor-product cubic B-spline of a distance on a regular grid.

    Parameters
    ----------
    knots : tuple of 3 lists of float
        Knot vectors along x, y, z, metres, from the origin.
    coefficients : (nx, ny, nz) array
        Metres.
    box : (2, 3) array
        Domain of the spline, metres, from the origin.
    origin : (3,) array
        Of the knots and the box, metres, body frame: 0 unless the mesh is far from the frame's origin.
    """

    knots: tuple[list[float], ...]
    coefficients: FloatArray
    box: FloatArray
    origin: FloatArray

    def expression(self, p: ca.MX) -> ca.MX:
        """Return the spline at a CasADi ``MX`` point, body frame."""
        return self.function(self._local(p))

    def _local(self, p: ca.MX) -> ca.MX:
        """Return a point relative to the spline's origin."""
        return p - ca.DM(self.origin) if np.any(self.origin) else p

    @cached_property
    def function(self) -> ca.Function:
        """Function of a point relative to the origin (3,), whose first two derivatives are splines as well."""
        return _function_with_derivatives(SplineTerms(self.coefficients, self.knots, (3, 3, 3)))

    def on_grid(self, axes: Sequence[FloatArray]) -> FloatArray:
        """Return the extended spline at the points of a tensor grid with given coordinates, (nx, ny, nz)."""
        values, squared = self.coefficients, np.zeros(())
        for axis, coordinates in enumerate(axes):
            local = coordinates - self.origin[axis]
            inside = np.clip(local, *self.box[:, axis])
            basis = BSpline.design_matrix(inside, np.asarray(self.knots[axis]), 3).toarray()
            values = np.moveaxis(np.tensordot(basis, values, axes=(1, axis)), 0, axis)
            squared = np.add.outer(squared, (local - inside) ** 2)
        return np.asarray(values + squared / np.maximum(np.sqrt(squared + values**2) + np.abs(values), 1e-300))

    def __getstate__(self) -> dict[str, object]:
        """Return the state without the compiled function, which is rebuilt after unpickling."""
        return {name: value for name, value in self.__dict__.items() if name != "function"}

    def extended(self, p: ca.MX) -> ca.MX:
        """Return the spline at a CasADi ``MX`` point, extended beyond its box by a lower bound of the distance.

        With q the nearest point of the box and the body inside the box, the angle at q between p and any point
        of the body is not acute: ``d(p)^2 >= |p - q|^2 + d(q)^2``.
        """
        local = self._local(p)
        q = ca.fmin(ca.fmax(local, ca.DM(self.box[0])), ca.DM(self.box[1]))
        boundary_value, squared = self.function(q), ca.sumsqr(local - q)
        return boundary_value + squared / (ca.sqrt(squared + boundary_value**2) + ca.fabs(boundary_value))


@dataclass(frozen=True)
class SplineTerms:
    """Coefficients, knots and degrees of a tensor-product B-spline.

    Parameters
    ----------
    coefficients : (nx, ny, nz) array
    knots : sequence of 3 sequences of float
    degrees : tuple of 3 int
    """

    coefficients: FloatArray
    knots: Sequence[Sequence[float]]
    degrees: tuple[int, ...]

    def derivative(self, axis: int) -> SplineTerms:
        """Return the partial derivative along an axis (de Boor 1978, A Practical Guide to Splines, chapter X (15))."""
        knots, degree = np.asarray(self.knots[axis]), self.degrees[axis]
        factors = degree / (knots[degree + 1 : -1] - knots[1 : -degree - 1])
        other_axes = [a for a in range(3) if a != axis]
        differences = np.diff(self.coefficients, axis=axis) * np.expand_dims(factors, other_axes)
        return SplineTerms(
            differences,
            [knots[1:-1].tolist() if a == axis else k for a, k in enumerate(self.knots)],
            tuple(d - (a == axis) for a, d in enumerate(self.degrees)),
        )

    def at(self, p: ca.MX) -> ca.MX:
        """Return the spline at a CasADi ``MX`` point."""
        coefficients = ca.DM(self.coefficients.ravel(order="F").tolist())  # twice as quick as from an array
        return ca.bspline(p, coefficients, [list(k) for k in self.knots], list(self.degrees), 1, {})


def _function_with_derivatives(spline: SplineTerms) -> ca.Function:
    """Return a spline's CasADi function, with gradient and Hessian as splines formed once.

    CasADi would form their coefficients again for each expression, and four times more slowly. The inputs of a custom
    Jacobian are those of the function and its outputs.
    """
    p, never_inline = ca.MX.sym("p", 3), {"never_inline": True, "jac_penalty": 0}
    first = [spline.derivative(axis) for axis in range(3)]
    second = {(a, b): first[a].derivative(b).at(p) for a in range(3) for b in range(a, 3)}
    hessian = ca.blockcat([[second[min(a, b), max(a, b)] for b in range(3)] for a in range(3)])
    value, gradient = ca.MX(1, 1), ca.MX(1, 3)
    second_function = ca.Function(
        "jac_jac_distance",
        [p, value, gradient],
        [hessian, ca.MX(3, 1)],
        ["p", "out_d", "out_jac_d_p"],
        ["jac_jac_d_p_p", "jac_jac_d_p_out_d"],
    )
    first_function = ca.Function(
        "jac_distance",
        [p, value],
        [ca.horzcat(*[part.at(p) for part in first])],
        ["p", "out_d"],
        ["jac_d_p"],
        {**never_inline, "custom_jacobian": second_function},
    )
    return ca.Function(
        "distance", [p], [spline.at(p)], ["p"], ["d"], {**never_inline, "custom_jacobian": first_function}
    )


def distance_spline(
    vertices: FloatArray, faces: IntArray, resolution: int, smoothing: float, margin: float = 0.0
) -> DistanceSpline:
    """Return a spline of a mesh's signed distance, negative inside, smoothed if ``smoothing`` is above 0.

    The sign comes from fast winding numbers (Barill et al. 2018, doi:10.1145/3197517.3201337), so that scans
    with small defects have an inside.

    Parameters
    ----------
    vertices : (v, 3) array
        Metres.
    faces : (f, 3) int array
    resolution : int
        Grid cells along the longest side.
    smoothing : float
        Standard deviation of the Gaussian, in cells; 0 for none. It removes noise from the normals, on which the
        solver fails: with 1.5 every start on six scanned objects converged (docs/decisions/mesh_smoothing.md).
    margin : float
        How far the grid reaches beyond the mesh, metres; at least five cells.
    """
    origin = local_origin(vertices)
    local = relative_to(vertices, origin)
    inputs = [local, faces, np.array([resolution, smoothing, margin])]
    distance, cells = _SignedDistance(local, faces), EXACT_CELLS if smoothing > 0.0 else EXACT_UNSMOOTHED
    arrays = cached_arrays(
        "distance", inputs, lambda: _fit_spline(distance.on_grid, local, resolution, cells, smoothing, margin)
    )
    return _spline_of(arrays, origin)


def edge_distance_spline(vertices: FloatArray, edges: IntArray, resolution: int) -> DistanceSpline:
    """Return a spline of the distance from mesh edges (m, 2).

    Beyond a cell from the edges it is accurate to a tenth of a cell.

    Parameters
    ----------
    vertices : (v, 3) array
        Of the whole mesh, metres.
    edges : (m, 2) int array
    resolution : int
        Grid cells along the longest side of the mesh.
    """
    origin = local_origin(vertices)
    local = relative_to(vertices, origin)
    tree = SearchTree(local, edges)

    def distance(points: FloatArray, chosen: BoolArray, spacing: float) -> FloatArray:
        del spacing
        return np.asarray(np.sqrt(tree.nearest(points[chosen])[0]))

    inputs = [local, edges, np.array([resolution])]
    return _spline_of(
        cached_arrays("edges", inputs, lambda: _fit_spline(distance, local, resolution, EXACT_CELLS)), origin
    )


def _spline_of(arrays: Mapping[str, NDArray[Any]], origin: FloatArray) -> DistanceSpline:
    """Return the spline with cached knots, coefficients and box."""
    knots = tuple(arrays[f"knots {axis}"].tolist() for axis in range(3))
    return DistanceSpline(knots, arrays["coefficients"], arrays["box"], origin)


def _tensor_grid(axes: Sequence[FloatArray]) -> FloatArray:
    """Return the points of a tensor grid, (nx, ny, nz, 3)."""
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


class _SignedDistance:
    """Signed distance of a mesh on grids, negative inside.

    On a closed mesh a grid point that is farther from the surface than from its neighbour is in a ball without surface
    that contains the neighbour, so that both have the same sign. Winding numbers are computed for one point of each
    connected part of such points, and for the few points, in narrow places, without such a neighbour.

    Parameters
    ----------
    vertices : (v, 3) array
        Metres.
    faces : (f, 3) int array
    """

    def __init__(self, vertices: FloatArray, faces: IntArray) -> None:
        self._vertices, self._faces, self._tree = vertices, faces, SearchTree(vertices, faces)

    @cached_property
    def _is_closed(self) -> bool:
        import trimesh

        return is_plain(trimesh.Trimesh(self._vertices, self._faces, process=False))

    def on_grid(self, points: FloatArray, chosen: BoolArray, spacing: float) -> FloatArray:
        """Return the distances (m,), metres, at the chosen points of a grid.

        Parameters
        ----------
        points : (nx, ny, nz, 3) array
            Metres.
        chosen : (nx, ny, nz) bool array
        spacing : float
            Distance of neighbours, metres.
        """
        if not self._is_closed:
            return self._tree.signed_distance(points[chosen])
        distances = np.zeros(chosen.shape)
        distances[chosen] = np.sqrt(self._tree.nearest(points[chosen])[0])
        signs = self._signs_of_parts(points, distances, spacing)
        signs += (signs == 0.0) * _neighbouring_sign(signs)
        rest = chosen & (signs == 0.0)
        signs[rest] = self._signs(points[rest])
        return np.asarray((signs * distances)[chosen])

    def _signs_of_parts(self, points: FloatArray, distances: FloatArray, spacing: float) -> FloatArray:
        """Return the signs, (nx, ny, nz), of points farther from the surface than from their neighbours; 0 of others.

        All of a connected part have the sign of its point farthest from the surface.
        """
        from scipy import ndimage

        parts, count = ndimage.label(distances > (1.0 + ROUNDING) * spacing)
        if not count:
            return np.zeros(distances.shape)
        farthest = np.array(ndimage.maximum_position(distances, parts, np.arange(1, count + 1)))
        return np.asarray(np.append(0.0, self._signs(points[tuple(farthest.T)]))[parts])

    def _signs(self, points: FloatArray) -> FloatArray:
        """Return the signs (m,) of the distances of points (m, 3) by their winding numbers."""
        return np.where(np.abs(self._tree.winding_numbers(points)) > 0.5, -1.0, 1.0)


def _neighbouring_sign(signs: FloatArray) -> FloatArray:
    """Return the sign of one of the six neighbours of each grid point that has one; 0 where none has."""
    padded, result = np.pad(signs, 1), np.zeros(signs.shape)
    for axis in range(3):
        for shift in (-1, 1):
            neighbour = np.roll(padded, shift, axis)[1:-1, 1:-1, 1:-1]
            result = np.where(result == 0.0, neighbour, result)
    return result


def _narrow_band_distance(distance: GridDistance, axes: Sequence[FloatArray], cell: float, cells: int) -> FloatArray:
    """Return a distance on a grid: exact within some cells of its zero set, interpolated elsewhere.

    Far points take most of the time, since a search tree prunes little for them. The interpolation error there, up to a
    cell at ridges of the distance, moves the smoothed surface by less than 0.03 cells.
    """
    from scipy.interpolate import make_interp_spline

    coarse = [axis[0] + 2.0 * cell * np.arange(len(axis) // 2 + 1) for axis in axes]
    points = _tensor_grid(coarse)
    field = distance(points, np.ones(points.shape[:-1], dtype=bool), 2.0 * cell).reshape(points.shape[:-1])
    for i, (coarse_ticks, ticks) in enumerate(zip(coarse, axes, strict=True)):
        field = np.asarray(make_interp_spline(coarse_ticks, field, k=3, axis=i)(ticks))
    in_band = np.abs(field) < cells * cell
    field[in_band] = distance(_tensor_grid(axes), in_band, cell)
    return field


def _fit_spline(
    distance: GridDistance,
    vertices: FloatArray,
    resolution: int,
    cells: int,
    smoothing: float = 0.0,
    margin: float = 0.0,
) -> dict[str, FloatArray]:
    """Return knots, coefficients and box of a spline that interpolates a distance around vertices (v, 3)."""
    from scipy.interpolate import make_interp_spline
    from scipy.ndimage import gaussian_filter

    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    cell = float(np.max(upper - lower)) / resolution
    padding = max(PADDING, int(np.ceil(margin / cell)))
    axes = []
    for low, high in zip(lower, upper, strict=True):
        count = int(np.ceil((high - low) / cell)) + 1 + 2 * padding
        axes.append((low + high) / 2.0 + cell * (np.arange(count) - (count - 1) / 2.0))
    field = _narrow_band_distance(distance, axes, cell, cells)
    if smoothing > 0.0:
        field = gaussian_filter(field, smoothing)
    knots: dict[str, FloatArray] = {}
    for axis, ticks in enumerate(axes):
        spline = make_interp_spline(ticks, field, k=3, axis=axis)
        field = np.moveaxis(np.asarray(spline.c, dtype=float), 0, axis)
        knots[f"knots {axis}"] = np.asarray(spline.t, dtype=float)
    box = np.array([[a[0] + cell for a in axes], [a[-1] - cell for a in axes]])
    return {**knots, "coefficients": np.ascontiguousarray(field), "box": box}


def wall_thickness(mesh: trimesh.Trimesh) -> float:
    """Return a mesh's wall thickness, metres: the 20th percentile over the surface.

    Rays go inwards along the normals from points uniform by area; their length to the next intersection with the
    surface is the thickness. A quantile well above zero ignores chamfers and noise.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        Closed, vertices in metres.
    """
    inputs = [np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64)]
    return float(cached_arrays("wall", inputs, lambda: {"thickness": np.array(_measure_walls(mesh))})["thickness"])


def _measure_walls(mesh: trimesh.Trimesh) -> float:
    """Return the wall thickness, metres, by rays; see ``wall_thickness``."""
    points, inward = inward_rays(mesh, RAYS)
    return float(np.quantile(first_hits(mesh, points, inward)[0], THIN))


def inward_rays(mesh: trimesh.Trimesh, count: int) -> tuple[FloatArray, FloatArray]:
    """Return points of a mesh, uniform by area, and the unit directions inwards along their normals, (count, 3)."""
    import trimesh

    points, triangles = trimesh.sample.sample_surface(mesh, count, seed=np.random.default_rng(0))
    return np.asarray(points, dtype=float), -np.asarray(mesh.face_normals)[triangles]


def first_hits(mesh: trimesh.Trimesh, points: FloatArray, directions: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return each ray's length up to the first triangle it hits, (n,), metres, and that triangle's index, (n,).

    A ray that hits nothing is as long as the mesh, and its triangle is -1.
    """
    import igl

    # libigl takes triangles with edges of about a thousandth for degenerate, so a scan in metres would let rays through
    scale = SCALED / float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    coordinates = np.asarray(mesh.vertices, dtype=float)
    origin = local_origin(coordinates)
    vertices = np.ascontiguousarray(relative_to(coordinates, origin) * scale)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int64)
    origins = np.ascontiguousarray(relative_to(points, origin) * scale + BEHIND * directions)
    tree = igl.AABB()
    tree.init(vertices, faces)
    hits, ray_lengths, _ = tree.intersect_ray_first(vertices, faces, origins, np.ascontiguousarray(directions))
    struck = np.asarray(hits, dtype=np.intp).ravel()
    lengths: FloatArray = np.where(struck >= 0, np.asarray(ray_lengths, dtype=float).ravel(), SCALED)
    return (lengths + BEHIND) / scale, struck


@dataclass(frozen=True)
class SmoothOffset:
    """Distances between a mesh and its smoothed surface.

    Parameters
    ----------
    most : float
        The 80th percentile, metres.
    largest : float
        The largest over the sampled points, metres.
    """

    most: float
    largest: float


def smooth_offset(body: Body, start: FloatArray, cell: float, wall: float) -> SmoothOffset:
    """Return the 80th percentile and the maximum of the distances of mesh points from the smoothed surface.

    Newton steps of at most a grid cell lead from each point to the smoothed surface. Where they do not end on it, none
    is nearby, and the distance counts as at least half the wall thickness.

    Parameters
    ----------
    body : Body
        With the smooth surface as its face ``surface``.
    start : (m, 3) array
        Points of the mesh, uniform by area, metres.
    cell : float
        Side of the grid's cells, metres.
    wall : float
        Thickness of the mesh's walls, metres.
    """
    points = start
    for _ in range(STEPS):
        h, slope, normals, _ = body.evaluate("surface", points)
        points = points - np.clip(h / np.maximum(slope, 1e-12), -cell, cell)[:, None] * normals
    offsets = np.linalg.norm(points - start, axis=1)
    offsets = np.where(body.is_on("surface", points), offsets, np.maximum(offsets, wall / 2.0))
    return SmoothOffset(float(np.quantile(offsets, OFFSET_QUANTILE)), float(np.max(offsets)))
