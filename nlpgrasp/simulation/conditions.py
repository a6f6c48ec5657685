"""Perturbed simulation conditions: friction and contacts that the hand does not know."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.product import ranges
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.solution.solution import GraspSolution

LESS_FRICTION, OFF = 0.1, 2e-3  # loss of friction as a share, displacement in metres
FARTHEST = 4.0  # largest extrapolation of the file's worst displacement, in its offsets


def slippery(grasp: Grasp, share: float) -> Grasp:
    """Return the grasp with friction reduced by a share."""
    models = [model.with_friction(1.0 - share) for model in grasp.contacts]
    return Grasp(grasp.points, grasp.normals, models, grasp.torque_origin, grasp.tangents)


def displaced(solution: GraspSolution, offset: float) -> Grasp | None:
    """Return the contacts displaced by an offset, metres, towards the file's worst displacement.

    The file states the worst displacement found at another offset; positions and normals are extrapolated linearly.
    None where the file has none, or one too small to extrapolate.
    """
    grasp, robust = solution.grasp, solution.robust
    if grasp is None or robust is None or robust.offset < offset / FARTHEST:
        return None
    factor = offset / robust.offset
    points = grasp.points + factor * (robust.points - grasp.points)
    normals = grasp.normals + factor * (robust.normals - grasp.normals)
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    flat = grasp.tangents - np.einsum("kts,ks->kt", grasp.tangents, normals)[..., None] * normals[:, None]
    first = flat[:, 0] / np.linalg.norm(flat[:, 0], axis=1, keepdims=True)
    tangents = first[:, None] if grasp.space == 2 else np.stack([first, np.cross(normals, first)], axis=1)
    return Grasp(points, normals, grasp.contacts, grasp.torque_origin, tangents)


def as_felt(known: Grasp, there: Grasp, forces: FloatArray) -> FloatArray:
    """Return finger forces (m, n) in the frames of the actual contacts: the hand exerts the same spatial forces."""
    result = forces.copy()
    for i, (model, part) in enumerate(zip(known.contacts, ranges(known.contacts, known.space), strict=True)):
        axes = np.array(model.axes(known.space))
        which = part.start + np.flatnonzero(axes < known.space)
        turned = there.frames[i].T @ known.frames[i]
        local = axes[axes < known.space]
        result[:, which] = forces[:, which] @ turned[np.ix_(local, local)].T
    return result
