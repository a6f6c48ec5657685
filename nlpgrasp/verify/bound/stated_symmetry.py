"""Checks of the symmetries that a certificate uses: of body, task, constraints and torque origin.

Motions map a node of the search onto its symmetric copy (``error_of_motion``). Reductions turn a contact about an axis
to a line or a point of the surface, which requires invariance under all turns (``error_of_reduction``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.tasks import Task, TaskEllipsoid, TaskPolytope, TaskSum
from nlpgrasp.verify.bound.face_cover import Faces, FlatFaceOutline, is_among
from nlpgrasp.verify.bound.stated_cells import StatedEllipsoidCell
from nlpgrasp.verify.bound.stated_regions import StatedRegion

IMAGE_TOLERANCE = 1e-8  # relative tolerance of an image
RADIAN = 1.0  # radians, an irrational share of a turn: invariance under it implies invariance under all turns
POLE_TOLERANCE = 1e-9  # tolerance of axes, poles and meridians, relative to the body's size


def error_of_motion(
    motion: Json, problem: Json, task: Task, origin: FloatArray, regions: Sequence[StatedRegion], size: float
) -> str:
    """Return a message if a motion is no symmetry of the problem, or an empty text if it is one.

    Parameters
    ----------
    motion : mapping
        ``rotation`` R, orthogonal, and ``translation`` t, metres: ``p -> R p + t``.
    problem : mapping
    task : Task
    origin : (space,) array
        Torque origin, metres.
    regions : sequence of StatedRegion
        Allowed region of each contact.
    size : float
        Of the body, metres.
    """
    space = len(origin)
    R, t = array("rotation", motion["rotation"], (space, space)), array("translation", motion["translation"], (space,))
    if np.max(np.abs(R @ R.T - np.eye(space))) > IMAGE_TOLERANCE:
        return "it is no rotation or reflection"
    if np.max(np.abs(R - np.eye(space))) <= IMAGE_TOLERANCE and np.max(np.abs(t)) <= IMAGE_TOLERANCE * size:
        return ""
    if not leaves_body_invariant(problem["body"], R, t, IMAGE_TOLERANCE * size):
        return "the body has no such symmetry"
    if np.max(np.abs(R @ origin + t - origin)) > IMAGE_TOLERANCE * size:
        return "it moves the torque origin"
    if not leaves_task_invariant(task, wrench_action(R)):
        return "the task has no such symmetry"
    if not all(_leaves_regions_invariant(region, R, t, IMAGE_TOLERANCE * size) for region in regions):
        return "constraints have no such symmetry"
    return ""


def wrench_action(R: FloatArray) -> FloatArray:
    """Return the matrix by which an orthogonal map R acts on wrenches about a fixed point.

    The moment follows ``(R p) x (R f) = det(R) R (p x f)``.
    """
    space, determinant = len(R), 1.0 if np.linalg.det(R) > 0.0 else -1.0
    moment_action = np.array([[determinant]]) if space == 2 else determinant * R
    zero = np.zeros((space, len(moment_action)))
    return np.block([[R, zero], [zero.T, moment_action]])


def leaves_task_invariant(task: Task, matrix: FloatArray) -> bool:
    """Return whether a linear map provably leaves a task's set of wrenches invariant."""
    if isinstance(task, TaskSum):
        return all(leaves_task_invariant(part, matrix) for part in task.tasks)
    if isinstance(task, TaskPolytope):
        points, scale = task.wrenches, _wrench_scale(np.max(np.abs(task.wrenches), axis=0))
        return _are_same_points(points @ matrix.T / scale, points / scale, IMAGE_TOLERANCE)
    if isinstance(task, TaskEllipsoid):
        scale = _wrench_scale(np.linalg.norm(task.axes, axis=0) + np.abs(task.center))
        axes, image = task.axes / scale, task.axes @ matrix.T / scale  # the set is centre + axes^T (unit ball)
        centre_difference = np.max(np.abs((matrix @ task.center - task.center) / scale))
        return bool(
            np.max(np.abs(axes.T @ axes - image.T @ image)) <= IMAGE_TOLERANCE and centre_difference <= IMAGE_TOLERANCE
        )
    return False


def _wrench_scale(sizes: FloatArray) -> FloatArray:
    """Return the largest force for each force component and the largest moment for each moment component.

    A scale of zero is replaced by 1.
    """
    forces = 2 if len(sizes) == 3 else 3
    scale = np.repeat([sizes[:forces].max(), sizes[forces:].max()], [forces, len(sizes) - forces])
    return np.where(scale > 0.0, scale, 1.0)


def leaves_body_invariant(body: Json, R: FloatArray, t: FloatArray, tolerance: float) -> bool:
    """Return whether a motion provably maps a body onto itself."""
    check = MOTION_TESTS.get(body["type"])
    return check is not None and check(body, R, t, tolerance)


def _maps_box(body: Json, R: FloatArray, t: FloatArray, tolerance: float) -> bool:
    """Return whether a motion maps a box onto itself, by its corners."""
    signs = np.array(np.meshgrid(*[[1.0, -1.0]] * 3)).reshape(3, -1).T
    corners = signs * array("extents", body["extents"], (3,)) / 2.0
    return _are_same_points(corners @ R.T + t, corners, tolerance)


def _maps_polygon(body: Json, R: FloatArray, t: FloatArray, tolerance: float) -> bool:
    """Return whether a motion maps a polygon onto itself."""
    corners = array("vertices", body["vertices"], (None, 2))
    return _maps_outline(corners, R, t, tolerance)


def _maps_prism(body: Json, R: FloatArray, t: FloatArray, tolerance: float) -> bool:
    """Return whether a motion maps a prism onto itself, by its outline and its z axis."""
    corners = array("polygon", body["polygon"], (None, 2))
    upright = max(np.max(np.abs(R[2, :2])), np.max(np.abs(R[:2, 2])), abs(abs(R[2, 2]) - 1.0)) <= IMAGE_TOLERANCE
    return bool(upright and abs(t[2]) <= tolerance and _maps_outline(corners, R[:2, :2], t[:2], tolerance))


def _maps_ellipsoid(body: Json, R: FloatArray, t: FloatArray, tolerance: float) -> bool:
    """Return whether a motion maps a sphere or ellipsoid onto itself, by its quadratic form."""
    axes = np.full(3, body["radius"]) if body["type"] == "sphere" else array("semi_axes", body["semi_axes"], (3,))
    form = np.diag((axes / axes.max()) ** 2)
    return bool(np.max(np.abs(t)) <= tolerance and np.max(np.abs(R @ form @ R.T - form)) <= IMAGE_TOLERANCE)


def _maps_z_axis(body: Json, R: FloatArray, t: FloatArray, tolerance: float) -> bool:
    """Return whether a motion maps a cylinder or torus onto itself: its z axis onto itself or the reverse."""
    return bool(np.max(np.abs(t)) <= tolerance and np.max(np.abs(R[2, :2])) <= IMAGE_TOLERANCE)


MOTION_TESTS: dict[str, Callable[[Json, FloatArray, FloatArray, float], bool]] = {
    "box": _maps_box,
    "polygon": _maps_polygon,
    "prism": _maps_prism,
    "sphere": _maps_ellipsoid,
    "ellipsoid": _maps_ellipsoid,
    "cylinder": _maps_z_axis,
    "torus": _maps_z_axis,
}


def _maps_outline(corners: FloatArray, R: FloatArray, t: FloatArray, tolerance: float) -> bool:
    """Return whether a motion of the plane maps a polygon's corners onto themselves, in order or in reverse."""
    image = corners @ R.T + t
    for corners_in_order in (image, image[::-1]):
        for shift in range(len(corners)):
            if np.max(np.abs(np.roll(corners_in_order, shift, axis=0) - corners)) <= tolerance:
                return True
    return False


def _leaves_regions_invariant(region: StatedRegion, R: FloatArray, t: FloatArray, tolerance: float) -> bool:
    """Return whether a motion leaves the allowed region of a contact invariant.

    False if the region has limits other than half-spaces.
    """
    if region.outside or region.away:
        return False
    if not region.inside:
        return True
    half_spaces, space = region.half_spaces(), len(t)
    image = half_spaces.copy()
    image[:, :space] = half_spaces[:, :space] @ R.T
    image[:, space] += image[:, :space] @ t
    return _are_same_points(image, half_spaces, tolerance)


def _are_same_points(image: FloatArray, points: FloatArray, tolerance: float) -> bool:
    """Return whether two sets of points are equal up to a tolerance."""
    distances = np.max(np.abs(image[:, None] - points[None]), axis=2)
    return bool(np.max(distances.min(axis=0)) <= tolerance and np.max(distances.min(axis=1)) <= tolerance)


class RotationTest:
    """Test of body, task and torque origin for rotational symmetry.

    Constraints are not part of the test.

    Parameters
    ----------
    body : mapping
    task : Task
    origin : (3,) array
        Torque origin, metres.
    size : float
        Of the body, metres.
    """

    def __init__(self, body: Json, task: Task, origin: FloatArray, size: float) -> None:
        self.body, self.task, self.origin, self.size = body, task, origin, size

    def is_symmetric_about(self, axis: FloatArray) -> bool:
        """Return whether all rotations about an axis leave body, task and torque origin invariant.

        The axis is a unit vector (3,), through the origin of the body's frame.
        """
        # one radian is an irrational share of a turn: its multiples are dense in all rotations about the axis
        R = Rotation.from_rotvec(RADIAN * axis).as_matrix()
        keeps_origin = float(np.max(np.abs(R @ self.origin - self.origin))) <= POLE_TOLERANCE * self.size
        keeps_task = leaves_task_invariant(self.task, wrench_action(R))
        return (
            keeps_origin and keeps_task and leaves_body_invariant(self.body, R, np.zeros(3), POLE_TOLERANCE * self.size)
        )


def error_of_reduction(
    groups: Sequence[Json], rotation_test: RotationTest, faces: Faces, regions: Sequence[StatedRegion]
) -> str:
    """Return an error text if symmetry does not justify the contacts' stored restrictions; an empty text if it does.

    Two restrictions are allowed. On a body of revolution, one contact on the half-plane at angle 0, for an ellipsoid on
    any half-plane through the axis. On a sphere, one contact at a pole and one on a meridian through it.
    """
    reduced = [group for group in groups if group["turned"] is not None]
    if not reduced:
        return ""
    if len(rotation_test.origin) != 3 or any(region.is_limited for region in regions):
        return "constraints, or a body in the plane, do not turn"
    if any(len(group["contacts"]) != 1 for group in reduced):
        return "several contacts are turned as one"
    kinds = sorted(str(group["turned"]) for group in reduced)
    roots = {str(group["turned"]): [cell for _, cell in group["roots"]] for group in reduced}
    if kinds == ["half-plane"]:
        region = regions[reduced[0]["contacts"][0]]
        return _half_plane_error(
            roots["half-plane"], rotation_test, {n: f for n, f in faces.items() if n in region.faces}
        )
    if kinds in (["pole"], ["meridian", "pole"]):
        return _pole_error(roots["pole"], roots.get("meridian"), rotation_test)
    return f"nothing can be turned to {', '.join(kinds)}"


def _half_plane_error(roots: Sequence[Json], rotation_test: RotationTest, faces: Faces) -> str:
    """Return a message if a contact may not be reduced to a half-plane, or an empty text if it may."""
    axis = np.array([0.0, 0.0, 1.0])
    if rotation_test.body["type"] in ("sphere", "ellipsoid"):
        arcs_axis = _axis_of_arcs(roots)
        if arcs_axis is None or not all(_is_on(StatedEllipsoidCell(cell), rotation_test) for cell in roots):
            return "the cells are no half-plane of the body"
        axis = arcs_axis
    if not rotation_test.is_symmetric_about(axis):
        return "body and task are not the same after every turn"
    for name, face in faces.items():
        if rotation_test.body["type"] in ("sphere", "ellipsoid"):
            continue
        if isinstance(face, FlatFaceOutline):
            return "a flat face does not turn"
        if face is None:
            return "a mesh does not turn"
        cells = [{**cell, "angles": [0.0, 0.0]} for cell in face]
        if not all(is_among(cell, roots, rotation_test.size) for cell in cells):
            return f"the cells do not cover the half-plane of {name}"
    return ""


def _pole_error(pole: Sequence[Json], meridian: Sequence[Json] | None, rotation_test: RotationTest) -> str:
    """Return a message if contacts may not be reduced to a pole and a meridian, or an empty text if they may."""
    if not _is_sphere(rotation_test.body) or len(pole) != 1:
        return "only a sphere has every point for a pole"
    point = StatedEllipsoidCell(pole[0])
    if not _is_on(point, rotation_test) or len(point.corners) != 1:
        return "the pole is no point of the sphere"
    if not all(rotation_test.is_symmetric_about(direction) for direction in np.eye(3)):
        return "body and task are not the same after every turn"
    axis = None if meridian is None else _axis_of_arcs(meridian)
    if meridian is not None:
        is_on_sphere = all(_is_on(StatedEllipsoidCell(cell), rotation_test) for cell in meridian)
        if not is_on_sphere or axis is None or np.max(np.abs(np.abs(axis @ point.corners[0]) - 1.0)) > POLE_TOLERANCE:
            return "the cells are no meridian through the pole"
    return ""


def _is_sphere(body: Json) -> bool:
    """Return whether a body is a sphere, possibly given as an ellipsoid with equal semi-axes."""
    return body["type"] == "sphere" or (body["type"] == "ellipsoid" and len(set(body["semi_axes"])) == 1)


def _is_on(cell: StatedEllipsoidCell, rotation_test: RotationTest) -> bool:
    """Return whether an ellipsoid cell has the body's semi-axes."""
    axes = (
        rotation_test.body["radius"]
        if rotation_test.body["type"] == "sphere"
        else np.asarray(rotation_test.body["semi_axes"])
    )
    return bool(np.all(np.abs(cell.axes - axes) <= POLE_TOLERANCE * rotation_test.size))


def _axis_of_arcs(roots: Sequence[Json]) -> FloatArray | None:
    """Return the axis through the ends of the half circle that two quarter arcs form; None for other cells."""
    cells = [StatedEllipsoidCell(cell) for cell in roots if cell["kind"] == "ellipsoid"]
    if len(cells) != 2 or any(len(cell.corners) != 2 for cell in cells):
        return None
    (first, side), (last, other_side) = (cell.corners for cell in cells)
    deviation = max(np.max(np.abs(side - other_side)), np.max(np.abs(first + last)), abs(float(first @ side)))
    return np.asarray(first) if deviation <= POLE_TOLERANCE else None
