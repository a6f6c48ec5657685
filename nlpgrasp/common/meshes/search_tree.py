"""Search trees of a triangle mesh: nearest points, winding numbers and signed distances."""

from __future__ import annotations

import atexit
import weakref
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    import igl


FAR = 16.0  # longest sides: distance from the origin beyond which local coordinates are used
TREE_FAR = 2.0  # longest sides: distance from the origin beyond which trees use local coordinates
TEST_OFFSET = 1e-6  # of the size: offset of test points from a triangle (STL files round to about a tenth of it)
SAMPLES = 4000  # sample points in the bounding box
SPREAD = 2000  # sample points on the surface
UNCLEAR = 0.2  # distance of a winding number from an integer above which the inside is ambiguous
OPEN_SHARE = 0.01  # of the bounding box: largest accepted share with an ambiguous inside


class SearchTree:
    """Search trees of a mesh, built when they are first used.

    Parameters
    ----------
    vertices : (v, 3) array
        Metres. The trees are built in local coordinates: libigl's winding numbers have single precision.
    faces : (f, 3) int array
        Triangles, or edges (f, 2), for which only nearest points are available.
    """

    def __init__(self, vertices: FloatArray, faces: IntArray) -> None:
        points = np.asarray(vertices, dtype=float)
        self._origin = local_origin(points, TREE_FAR)
        self._vertices = np.ascontiguousarray(relative_to(points, self._origin))
        self._faces = np.ascontiguousarray(faces, dtype=np.int64)
        _trees.add(self)

    @cached_property
    def _boxes(self) -> igl.AABB:
        import igl

        tree = igl.AABB()
        tree.init(self._vertices, self._faces)
        return tree

    @cached_property
    def _winding(self) -> igl.FastWindingNumberBVH:
        import igl

        tree = igl.FastWindingNumberBVH()
        tree.init(self._vertices, self._faces)
        return tree

    def __getstate__(self) -> dict[str, object]:
        """Return the state without trees, which are rebuilt in another process."""
        return {"_vertices": self._vertices, "_faces": self._faces, "_origin": self._origin}

    def _local(self, points: FloatArray) -> FloatArray:
        """Return points (m, 3) in the local coordinates of the trees."""
        return np.ascontiguousarray(relative_to(np.asarray(points, dtype=float), self._origin))

    def release(self) -> None:
        """Release the memory of the trees, which are rebuilt when used again."""
        self.__dict__.pop("_boxes", None)
        self.__dict__.pop("_winding", None)

    def nearest(self, points: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
        """Return squared distances (m,), face indices (m,) and nearest points (m, 3) of points (m, 3), metres."""
        squared, faces, positions = self._boxes.squared_distance(self._vertices, self._faces, self._local(points))
        nearest = np.asarray(positions)
        return np.asarray(squared), np.asarray(faces), nearest + self._origin if np.any(self._origin) else nearest

    def winding_numbers(self, points: FloatArray) -> FloatArray:
        """Return the fast winding numbers (m,) of the mesh about points (m, 3).

        They are 0 outside and 1 inside within some thousandths, and in between near defects (Barill et al. 2018,
        doi:10.1145/3197517.3201337); negative for inward-facing triangles.
        """
        return np.asarray(self._winding.winding_number(self._local(points)))

    def signed_distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distances (m,), metres, of points (m, 3), negative inside, continuous near defects.

        It is the distance times ``1 - 2 |w|`` with the winding number w.
        """
        return np.asarray(np.sqrt(self.nearest(points)[0]) * (1.0 - 2.0 * np.abs(self.winding_numbers(points))))

    def exact_signed_distance(self, points: FloatArray) -> FloatArray:
        """Return exact signed distances (m,), metres, of points (m, 3).

        Negative where the winding number is above 1/2.
        """
        return self.exact_signed_distance_with_gradient(points)[0]

    def exact_signed_distance_with_gradient(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ``exact_signed_distance`` and its gradients (m, 3): on the surface the nearest triangles' normals."""
        squared, faces, nearest = self.nearest(points)
        away, distance = points - nearest, np.sqrt(squared)
        value = np.where(np.abs(self.winding_numbers(points)) > 0.5, -distance, distance)
        gradient = away / np.where(value == 0.0, 1.0, value)[:, None]
        touching = np.flatnonzero(distance < 1e-9)
        if len(touching):
            corners = self._vertices[self._faces]
            outward = np.sign(np.sum(np.linalg.det(corners)))
            normals = np.cross(*np.diff(corners[faces[touching]], axis=1).transpose(1, 0, 2)) * outward
            gradient[touching] = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        return value, gradient


_trees: weakref.WeakSet[SearchTree] = weakref.WeakSet()


@atexit.register
def _release_trees() -> None:
    """Release all trees at exit of the interpreter, as libigl reports remaining ones."""
    for tree in list(_trees):
        tree.release()


def unclear_fraction(vertices: FloatArray, faces: IntArray) -> float:
    """Return the fraction of the bounding box where the winding number is far from an integer."""
    rng = np.random.default_rng(0)
    points = rng.uniform(vertices.min(axis=0), vertices.max(axis=0), (SAMPLES, 3))
    winding = SearchTree(vertices, faces).winding_numbers(points)
    return float(np.mean(np.abs(winding - np.round(winding)) > UNCLEAR))


def is_buried(
    vertices: FloatArray, faces: IntArray, points: FloatArray, normals: FloatArray, least_step: float = -np.inf
) -> BoolArray:
    """Return whether the body is on both sides of surface points (m, 3) with unit normals (m, 3), (m,).

    With ``least_step`` the winding number also has to rise by more than that from the outer to the inner side: it does
    in a solid that overlaps the body, and not across a slit that is thinner than the step.
    """
    step = TEST_OFFSET * float(np.linalg.norm(np.ptp(vertices, axis=0))) * normals
    tree = SearchTree(vertices, faces)
    outer = tree.winding_numbers(points + step)
    result = outer > 0.5
    indices = np.flatnonzero(result)
    inner = tree.winding_numbers(points[indices] - step[indices])
    result[indices] = (inner > 0.5) & (inner - outer[indices] > least_step)
    return result


def buried_fraction(vertices: FloatArray, faces: IntArray, least_step: float = -np.inf) -> float:
    """Return the fraction of a mesh's area that ``is_buried`` in the body, from evenly sampled points."""
    corners = vertices[faces]
    products = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(products, axis=1)
    total = np.cumsum(area)
    triangles = np.searchsorted(total, (np.arange(SPREAD) + 0.5) / SPREAD * total[-1])
    weights = np.random.default_rng(0).dirichlet(np.ones(3), SPREAD)
    points = np.einsum("ij,ijk->ik", weights, corners[triangles])
    return float(np.mean(is_buried(vertices, faces, points, products[triangles] / area[triangles, None], least_step)))


def local_origin(points: FloatArray, limit: float = FAR) -> FloatArray:
    """Return the origin (3,) of local coordinates for points (n, 3), metres.

    It is the centre of the bounding box on each axis on which the centre is far from 0.

    It is 0 on the other axes. With ``limit`` of at least 1 the difference of a point and this origin, and the inverse
    sum, are exact in floating point (Sterbenz), so points are restored exactly.

    Parameters
    ----------
    points : (n, 3) array
        Metres.
    limit : float
        Distance from the origin that counts as far, in longest sides of the bounding box.
    """
    if not len(points):
        return np.zeros(3)
    lower, upper = points.min(axis=0), points.max(axis=0)
    centre = lower + (upper - lower) / 2.0
    return np.where(np.abs(centre) > limit * float(np.max(upper - lower)), centre, 0.0)


def relative_to(points: FloatArray, origin: FloatArray) -> FloatArray:
    """Return points (..., 3) relative to an origin (3,)."""
    return points - origin if np.any(origin) else points
