"""Smoothed signed distance of a triangle mesh: grid, Gaussian filter, tensor-product cubic B-spline."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from nlpgrasp.bodies.mesh.fineness import AROUND
from nlpgrasp.common.meshes.frame import in_frame, local_origin
from nlpgrasp.common.meshes.search_tree import IntArray, SearchTree
from nlpgrasp.common.stored.cache import kept
from nlpgrasp.common.validation import FloatArray

Distance = Callable[[FloatArray], FloatArray]  # of points (m, 3), metres
EXACT_CELLS, EXACT_UNSMOOTHED = 3, 5  # grid cells from the surface within which distances are exact


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
        return self._spline(self._local(p))

    def _local(self, p: ca.MX) -> ca.MX:
        """Return a point relative to the origin."""
        return p - ca.DM(self.origin) if np.any(self.origin) else p

    def _spline(self, p: ca.MX) -> ca.MX:
        flat = ca.DM(self.coefficients.ravel(order="F"))
        return ca.bspline(p, flat, [list(k) for k in self.knots], [3, 3, 3], 1, {})

    def everywhere(self, p: ca.MX) -> ca.MX:
        """Return the spline at a CasADi ``MX`` point, extended beyond its box by a lower bound of the distance.

        With q the nearest point of the box and the body inside the box, the angle at q between p and any point
        of the body is not acute: ``d(p)^2 >= |p - q|^2 + d(q)^2``.
        """
        local = self._local(p)
        q = ca.fmin(ca.fmax(local, ca.DM(self.box[0])), ca.DM(self.box[1]))
        near, beyond = self._spline(q), ca.sumsqr(local - q)
        return near + beyond / (ca.sqrt(beyond + near**2) + ca.fabs(near))


def distance_spline(
    vertices: FloatArray, faces: IntArray, resolution: int, smoothing: float, margin: float = 0.0
) -> DistanceSpline:
    """Return the spline of the smoothed signed distance, negative inside.

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
        solver fails: with 1.5 every start on six scanned objects converged (docs/architecture.md).
    margin : float
        How far the grid reaches beyond the mesh, metres; at least five cells.
    """
    origin = local_origin(vertices)
    local = in_frame(vertices, origin)
    made_from = [local, faces, np.array([resolution, smoothing, margin])]
    tree, cells = SearchTree(local, faces), EXACT_CELLS if smoothing > 0.0 else EXACT_UNSMOOTHED
    found = kept(
        "distance", made_from, lambda: _fitted(tree.signed_distance, local, resolution, cells, smoothing, margin)
    )
    return _spline_of(found, origin)


def edge_distance_spline(vertices: FloatArray, edges: IntArray, resolution: int) -> DistanceSpline:
    """Return the spline of the distance from mesh edges (m, 2); beyond a cell, accurate to a tenth of a cell.

    Parameters
    ----------
    vertices : (v, 3) array
        Of the whole mesh, metres.
    edges : (m, 2) int array
    resolution : int
        Grid cells along the longest side of the mesh.
    """
    origin = local_origin(vertices)
    local = in_frame(vertices, origin)
    tree = SearchTree(local, edges)

    def distance(points: FloatArray) -> FloatArray:
        return np.asarray(np.sqrt(tree.nearest(points)[0]))

    made_from = [local, edges, np.array([resolution])]
    return _spline_of(kept("edges", made_from, lambda: _fitted(distance, local, resolution, EXACT_CELLS)), origin)


def _spline_of(found: Mapping[str, NDArray[Any]], origin: FloatArray) -> DistanceSpline:
    knots = tuple(found[f"knots {axis}"].tolist() for axis in range(3))
    return DistanceSpline(knots, found["coefficients"], found["box"], origin)


def _grid(axes: Sequence[FloatArray]) -> FloatArray:
    """Return the points of a tensor grid, (nx, ny, nz, 3)."""
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def _exact(distance: Distance, points: FloatArray) -> FloatArray:
    """Return the distance of points (..., 3)."""
    return distance(points.reshape(-1, 3)).reshape(points.shape[:-1])


def _near_exact(distance: Distance, axes: Sequence[FloatArray], cell: float, cells: int) -> FloatArray:
    """Return a distance on a grid: exact within some cells of its zero set, interpolated elsewhere.

    Far points take most of the time, since a search tree prunes little for them. The interpolation error there, up to a
    cell at ridges of the distance, moves the smoothed surface by less than 0.03 cells.
    """
    from scipy.interpolate import make_interp_spline

    coarse = [axis[0] + 2.0 * cell * np.arange(len(axis) // 2 + 1) for axis in axes]
    field = _exact(distance, _grid(coarse))
    for i, (some, every) in enumerate(zip(coarse, axes, strict=True)):
        field = np.asarray(make_interp_spline(some, field, k=3, axis=i)(every))
    near = np.abs(field) < cells * cell
    field[near] = _exact(distance, _grid(axes)[near])
    return field


def _fitted(
    distance: Distance, vertices: FloatArray, resolution: int, cells: int, smoothing: float = 0.0, margin: float = 0.0
) -> dict[str, FloatArray]:
    """Return knots, coefficients and box of a spline that interpolates a distance around vertices (v, 3)."""
    from scipy.interpolate import make_interp_spline
    from scipy.ndimage import gaussian_filter

    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    cell = float(np.max(upper - lower)) / resolution
    around = max(AROUND, int(np.ceil(margin / cell)))
    axes = []
    for low, high in zip(lower, upper, strict=True):
        count = int(np.ceil((high - low) / cell)) + 1 + 2 * around
        axes.append((low + high) / 2.0 + cell * (np.arange(count) - (count - 1) / 2.0))
    field = _near_exact(distance, axes, cell, cells)
    if smoothing > 0.0:
        field = gaussian_filter(field, smoothing)
    knots: dict[str, FloatArray] = {}
    for axis, ticks in enumerate(axes):
        spline = make_interp_spline(ticks, field, k=3, axis=axis)
        field = np.moveaxis(np.asarray(spline.c, dtype=float), 0, axis)
        knots[f"knots {axis}"] = np.asarray(spline.t, dtype=float)
    box = np.array([[a[0] + cell for a in axes], [a[-1] - cell for a in axes]])
    return {**knots, "coefficients": np.ascontiguousarray(field), "box": box}
