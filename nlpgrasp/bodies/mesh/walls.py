"""Wall thickness of a mesh, by ray casting."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.common.meshes.frame import in_frame, local_origin
from nlpgrasp.common.stored.cache import kept
from nlpgrasp.common.validation import FloatArray

if TYPE_CHECKING:
    import trimesh

RAYS, THIN = 2000, 0.2  # number of rays; quantile of their lengths
SCALED, BEHIND = 1e3, 1e-3  # diagonal of the scaled mesh, and depth below its surface at which rays begin


def wall_thickness(mesh: trimesh.Trimesh) -> float:
    """Return a mesh's wall thickness, metres: the 20th percentile over the surface.

    Rays go inwards along the normals from points uniform by area; their length to the next intersection with the
    surface is the thickness. A quantile well above zero ignores chamfers and noise.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        Closed, vertices in metres.
    """
    made_from = [np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64)]
    return float(kept("wall", made_from, lambda: {"thickness": np.array(_thickness(mesh))})["thickness"])


def _thickness(mesh: trimesh.Trimesh) -> float:
    import igl
    import trimesh

    # libigl takes triangles with edges of about a thousandth for degenerate, so a scan in metres would let rays through
    scale = SCALED / float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    stated = np.asarray(mesh.vertices, dtype=float)
    origin = local_origin(stated)
    vertices = np.ascontiguousarray(in_frame(stated, origin) * scale)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int64)
    points, triangles = trimesh.sample.sample_surface(mesh, RAYS, seed=np.random.default_rng(0))
    inwards = -np.asarray(mesh.face_normals)[triangles]
    origins = np.ascontiguousarray(in_frame(np.asarray(points), origin) * scale + BEHIND * inwards)
    tree = igl.AABB()
    tree.init(vertices, faces)
    met, ways, _ = tree.intersect_ray_first(vertices, faces, origins, np.ascontiguousarray(inwards))
    through: FloatArray = np.where(np.asarray(met).ravel() >= 0, np.asarray(ways, dtype=float).ravel(), SCALED)
    return float(np.quantile(through + BEHIND, THIN)) / scale
