"""Search trees of triangle meshes: nearest points, winding numbers, signed distances."""

from __future__ import annotations

import atexit
import weakref
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.meshes.frame import in_frame, local_origin
from nlpgrasp.common.validation import FloatArray

if TYPE_CHECKING:
    import igl

IntArray = NDArray[np.integer]

AWAY = 2.0  # longest sides: distance from the origin beyond which trees use local coordinates

_every: weakref.WeakSet[SearchTree] = weakref.WeakSet()


@atexit.register
def _let_go() -> None:
    """Release all trees at interpreter exit, since libigl reports remaining ones."""
    for tree in list(_every):
        tree.let_go()


class SearchTree:
    """Search trees of a mesh, built on first use.

    Parameters
    ----------
    vertices : (v, 3) array
        Metres. The trees are built in local coordinates: libigl's winding numbers have single precision.
    faces : (f, 3) int array
        Triangles, or edges (f, 2), for which only nearest points are available.
    """

    def __init__(self, vertices: FloatArray, faces: IntArray) -> None:
        stated = np.asarray(vertices, dtype=float)
        self._origin = local_origin(stated, AWAY)
        self._vertices = np.ascontiguousarray(in_frame(stated, self._origin))
        self._faces = np.ascontiguousarray(faces, dtype=np.int64)
        _every.add(self)

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
        """Return points (m, 3) in the trees' coordinates."""
        return np.ascontiguousarray(in_frame(np.asarray(points, dtype=float), self._origin))

    def let_go(self) -> None:
        """Release the trees; they are rebuilt on demand."""
        self.__dict__.pop("_boxes", None)
        self.__dict__.pop("_winding", None)

    def nearest(self, points: FloatArray) -> tuple[FloatArray, NDArray[np.int64], FloatArray]:
        """Return squared distances (m,), face indices (m,) and nearest points (m, 3) of points (m, 3), metres."""
        squared, faces, positions = self._boxes.squared_distance(self._vertices, self._faces, self._local(points))
        places = np.asarray(positions)
        return np.asarray(squared), np.asarray(faces), places + self._origin if np.any(self._origin) else places

    def winding_numbers(self, points: FloatArray) -> FloatArray:
        """Return the fast winding numbers (m,) of the mesh about points (m, 3).

        They are 0 outside and 1 inside within some thousandths, and in between near defects (Barill et al. 2018,
        doi:10.1145/3197517.3201337); negative for inward-facing triangles.
        """
        return np.asarray(self._winding.winding_number(self._local(points)))

    def signed_distance(self, points: FloatArray) -> FloatArray:
        """Return the smooth signed distances (m,), metres, of points (m, 3), negative inside.

        It is the distance times ``1 - 2 |w|`` with the winding number w, and continuous near defects.
        """
        return np.asarray(np.sqrt(self.nearest(points)[0]) * (1.0 - 2.0 * np.abs(self.winding_numbers(points))))

    def clearance(self, points: FloatArray) -> FloatArray:
        """Return the signed distances (m,), metres, of points (m, 3) from the nearest point, negative inside."""
        inside = np.abs(self.winding_numbers(points)) > 0.5
        return np.asarray(np.where(inside, -1.0, 1.0) * np.sqrt(self.nearest(points)[0]))
