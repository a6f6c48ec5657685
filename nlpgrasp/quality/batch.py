"""Many grasps with the same contact models at once: grasp maps and a quick upper bound."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.contacts import ContactModel
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.spatial import cross_matrix, tangents, wrench_dimension
from nlpgrasp.tasks import Task
from nlpgrasp.validation import FloatArray


def grasp_maps(
    points: FloatArray, normals: FloatArray, contacts: Sequence[ContactModel], torque_origin: FloatArray
) -> FloatArray:
    """Return the grasp map of each placement.

    Parameters
    ----------
    points, normals : (b, k, space) array
        Contact positions (metres) and unit inward normals of b placements.
    contacts : sequence of k ContactModel
    torque_origin : (space,) array

    Returns
    -------
    (b, d, n) array
    """
    b, k, space = points.shape
    arm = points - torque_origin
    t = tangents(normals.reshape(b * k, space)).reshape(b, k, space - 1, space)
    frame = np.concatenate([normals[:, :, None, :], t], axis=2).transpose(0, 1, 3, 2)  # columns: n, t1, t2
    d = wrench_dimension(space)
    full = np.zeros((b, k, d, d))
    full[:, :, :space, :space] = frame
    if space == 2:
        full[:, :, 2, :2] = arm[:, :, 0, None] * frame[:, :, 1] - arm[:, :, 1, None] * frame[:, :, 0]
        full[:, :, 2, 2] = 1.0
    else:
        full[:, :, 3:, :3] = cross_matrix(arm) @ frame
        full[:, :, 3:, 3:] = frame
    return np.concatenate([full[:, i] @ model.basis(space) for i, model in enumerate(contacts)], axis=2)


def sampled_ratios(
    maps: FloatArray, contacts: Sequence[ContactModel], space: int, task: Task, directions: FloatArray
) -> FloatArray:
    """Return ``phi_G(y_j) / phi_A(y_j)`` for each grasp and direction; every value is an upper bound on mu.

    Parameters
    ----------
    maps : (b, d, n) array
    contacts, space
        Of the grasps.
    task : Task
    directions : (m, d) array
        Those with ``phi_A <= 0`` are left out.

    Returns
    -------
    (b, m') array
    """
    reach = task.support(directions)[0]
    y = directions[reach > 0.0]
    z = np.einsum("md,bdn->bmn", y, maps, optimize=True)
    x = WrenchSet(maps[0], contacts, space).project(z.reshape(-1, z.shape[2]))
    return np.asarray(np.linalg.norm(x, axis=1).reshape(len(maps), len(y)) / reach[reach > 0.0])


def screening_score(ratios: FloatArray) -> FloatArray:
    """Return a score to rank grasps by: the least ratio, and a little of the lowest tenth to break ties at 0."""
    count = max(1, ratios.shape[1] // 10)
    lowest = np.partition(ratios, count - 1, axis=1)[:, :count]
    return np.asarray(lowest.min(axis=1) + 0.05 * lowest.mean(axis=1))
