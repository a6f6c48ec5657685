"""Check that a rigid motion or reflection is a symmetry of body, task, constraints and torque origin."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.tasks import Task, TaskEllipsoid, TaskPolytope, TaskSum
from nlpgrasp.verify.bound.places import Places

SAME = 1e-8  # relative tolerance of an image


def wrong_with(motion: Json, problem: Json, task: Task, origin: FloatArray, own: Sequence[Places], size: float) -> str:
    """Return the part of the problem that a motion does not map onto itself; empty for a symmetry.

    Parameters
    ----------
    motion : mapping
        ``rotation`` R, orthogonal, and ``translation`` t, metres: ``p -> R p + t``.
    problem : mapping
    task : Task
    origin : (space,) array
        Torque origin, metres.
    own : sequence of Places
        Allowed region of each contact.
    size : float
        Of the body, metres.
    """
    space = len(origin)
    R, t = array("rotation", motion["rotation"], (space, space)), array("translation", motion["translation"], (space,))
    if np.max(np.abs(R @ R.T - np.eye(space))) > SAME:
        return "it is no rotation or reflection"
    if np.max(np.abs(R - np.eye(space))) <= SAME and np.max(np.abs(t)) <= SAME * size:
        return ""
    if not keeps_body(problem["body"], R, t, SAME * size):
        return "the body has no such symmetry"
    if np.max(np.abs(R @ origin + t - origin)) > SAME * size:
        return "it moves the torque origin"
    if not keeps_task(task, on_wrenches(R)):
        return "the task has no such symmetry"
    if not all(_keeps_places(places, R, t, SAME * size) for places in own):
        return "constraints have no such symmetry"
    return ""


def on_wrenches(R: FloatArray) -> FloatArray:
    """Return the action of R on wrenches about a fixed point: ``(R p) x (R f) = det(R) R (p x f)``."""
    space, handed = len(R), 1.0 if np.linalg.det(R) > 0.0 else -1.0
    turned = np.array([[handed]]) if space == 2 else handed * R
    zero = np.zeros((space, len(turned)))
    return np.block([[R, zero], [zero.T, turned]])


def keeps_task(task: Task, matrix: FloatArray) -> bool:
    """Return whether a linear map leaves a set of wrenches invariant, as far as its kind shows it."""
    if isinstance(task, TaskSum):
        return all(keeps_task(part, matrix) for part in task.tasks)
    if isinstance(task, TaskPolytope):
        points, scale = task.wrenches, _scale(np.max(np.abs(task.wrenches), axis=0))
        return _same_points(points @ matrix.T / scale, points / scale, SAME)
    if isinstance(task, TaskEllipsoid):
        scale = _scale(np.linalg.norm(task.axes, axis=0) + np.abs(task.center))
        axes, image = task.axes / scale, task.axes @ matrix.T / scale  # the set is centre + axes^T (unit ball)
        middle = np.max(np.abs((matrix @ task.center - task.center) / scale))
        return bool(np.max(np.abs(axes.T @ axes - image.T @ image)) <= SAME and middle <= SAME)
    return False


def _scale(sizes: FloatArray) -> FloatArray:
    """Return the largest force for each force component, the largest moment for each moment component; 1 for zeros."""
    forces = 2 if len(sizes) == 3 else 3
    most = np.repeat([sizes[:forces].max(), sizes[forces:].max()], [forces, len(sizes) - forces])
    return np.where(most > 0.0, most, 1.0)


def keeps_body(body: Json, R: FloatArray, t: FloatArray, tolerance: float) -> bool:
    """Return whether a motion maps a body onto itself."""
    check = BODIES.get(body["type"])
    return check is not None and check(body, R, t, tolerance)


def _box(body: Json, R: FloatArray, t: FloatArray, tolerance: float) -> bool:
    """Return whether corners map to corners: the box is their convex hull."""
    signs = np.array(np.meshgrid(*[[1.0, -1.0]] * 3)).reshape(3, -1).T
    corners = signs * array("extents", body["extents"], (3,)) / 2.0
    return _same_points(corners @ R.T + t, corners, tolerance)


def _polygon(body: Json, R: FloatArray, t: FloatArray, tolerance: float) -> bool:
    """Return whether corners map to corners, and edge midpoints to edge midpoints."""
    corners = array("vertices", body["vertices"], (None, 2))
    return _same_outline(corners, R, t, tolerance)


def _prism(body: Json, R: FloatArray, t: FloatArray, tolerance: float) -> bool:
    corners = array("polygon", body["polygon"], (None, 2))
    upright = max(np.max(np.abs(R[2, :2])), np.max(np.abs(R[:2, 2])), abs(abs(R[2, 2]) - 1.0)) <= SAME
    return bool(upright and abs(t[2]) <= tolerance and _same_outline(corners, R[:2, :2], t[:2], tolerance))


def _ellipsoid(body: Json, R: FloatArray, t: FloatArray, tolerance: float) -> bool:
    """Return whether the quadratic form of the surface is invariant."""
    axes = np.full(3, body["radius"]) if body["type"] == "sphere" else array("semi_axes", body["semi_axes"], (3,))
    form = np.diag((axes / axes.max()) ** 2)
    return bool(np.max(np.abs(t)) <= tolerance and np.max(np.abs(R @ form @ R.T - form)) <= SAME)


def _turned(body: Json, R: FloatArray, t: FloatArray, tolerance: float) -> bool:
    """Return whether the z axis maps to itself, or to its reverse."""
    return bool(np.max(np.abs(t)) <= tolerance and np.max(np.abs(R[2, :2])) <= SAME)


BODIES: dict[str, Callable[[Json, FloatArray, FloatArray, float], bool]] = {
    "box": _box,
    "polygon": _polygon,
    "prism": _prism,
    "sphere": _ellipsoid,
    "ellipsoid": _ellipsoid,
    "cylinder": _turned,
    "torus": _turned,
}


def _same_outline(corners: FloatArray, R: FloatArray, t: FloatArray, tolerance: float) -> bool:
    """Return whether a plane motion maps a polygon's corners onto those in order, or reversed."""
    image = corners @ R.T + t
    for one in (image, image[::-1]):
        for shift in range(len(corners)):
            if np.max(np.abs(np.roll(one, shift, axis=0) - corners)) <= tolerance:
                return True
    return False


def _keeps_places(places: Places, R: FloatArray, t: FloatArray, tolerance: float) -> bool:
    """Return whether the regions that a contact has to be inside of are invariant; False for other limits."""
    if places.outside or places.away:
        return False
    if not places.inside:
        return True
    rows, space = places.rows(), len(t)
    image = rows.copy()
    image[:, :space] = rows[:, :space] @ R.T
    image[:, space] += image[:, :space] @ t
    return _same_points(image, rows, tolerance)


def _same_points(image: FloatArray, points: FloatArray, tolerance: float) -> bool:
    """Return whether two sets of points are equal within a tolerance."""
    apart = np.max(np.abs(image[:, None] - points[None]), axis=2)
    return bool(np.max(apart.min(axis=0)) <= tolerance and np.max(apart.min(axis=1)) <= tolerance)
