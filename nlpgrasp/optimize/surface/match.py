"""Distances and angles between contacts on the solver's smooth surface and those on the mesh."""

from __future__ import annotations

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.solution.placed import OWN_NORMAL, SurfaceMatch


def match_on_mesh(body: Mesh, start: FloatArray, grasp: Grasp, smooth: FloatArray, free: bool) -> SurfaceMatch:
    """Return the differences between contacts on the smooth surface and the grasp on the mesh.

    Parameters
    ----------
    body : Mesh
    start : (k, 3) array
        Contacts on the smooth surface, metres.
    grasp : Grasp
        On the mesh, with the inward normals that are stated.
    smooth : (k, 3) array
        Inward unit normals of the smooth surface at the grasp's contacts.
    free : bool
        Whether no posed fingertips touch: contacts then have the normal of one triangle, also on edges.
    """
    stated = body.angles_off_normals(grasp.points, -grasp.normals, on_edges=not free)
    own = np.where((stated <= OWN_NORMAL)[:, None], grasp.normals, -body.closest(grasp.points)[1])
    angles = np.arccos(np.clip(np.sum(smooth * own, axis=1), -1.0, 1.0))
    moved = np.linalg.norm(grasp.points - start, axis=1)
    return SurfaceMatch(body.closest(start)[2], angles, moved, stated)
