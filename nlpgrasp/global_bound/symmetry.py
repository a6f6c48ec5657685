"""Symmetries shared by body, task and constraints: finite groups, and rotations about an axis.

Symmetric copies of placements are bounded once. A finite group (``symmetries``) maps cells of contacts onto each other.
A rotation by any angle (``restrict_by_rotation``) takes the first contact, or the first two, to a line or a point.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations, product

import numpy as np

from nlpgrasp.bodies import Body, Mesh, Polygon, Prism
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.allowed_regions import AllowedRegion
from nlpgrasp.global_bound.cells.cell import CellFace, SurfaceCell
from nlpgrasp.global_bound.cells.ellipsoid_cells import EllipsoidCell, EllipsoidFace
from nlpgrasp.global_bound.cells.revolved_cells import DiscFace, RevolvedFace
from nlpgrasp.global_bound.contact_cells import NONE, ContactCells
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.tasks import Task, TaskEllipsoid, TaskPolytope, TaskSum

SAME = 1e-9  # relative tolerance of equal points and tasks
ANGLE = 1.0  # radians, an irrational share of a turn: invariance under it implies invariance under all turns

FacesToCells = dict[CellFace, Sequence[SurfaceCell]]  # root cells of a contact, by face
RotatedRoots = tuple[str, FacesToCells]  # part of the surface, as ``RootCells.rotated_to``, and its cells


class Symmetry:
    """Rigid motion or reflection ``p -> R p + t`` that maps the problem onto itself.

    Parameters
    ----------
    rotation : (space, space) array
        R, orthogonal.
    translation : (space,) array
        t, metres.
    tolerance : float
        Metres, within which images of cells coincide with cells.
    """

    def __init__(self, rotation: FloatArray, translation: FloatArray, tolerance: float) -> None:
        self.rotation, self.translation, self.tolerance = rotation, translation, tolerance
        self._images: dict[tuple[int, int], int] = {}

    def maps_roots(self, group_number: int, group: ContactCells) -> bool:
        """Return whether each root cell of a group is mapped to a root cell; the images are remembered."""
        return all(self._find(group_number, group, root, group.roots) != NONE for root in group.roots)

    def image(self, group_number: int, group: ContactCells, cell: int) -> int:
        """Return the index of a cell's image in the same group, ``NONE`` if the image is no cell."""
        if (group_number, cell) not in self._images:
            parent = self.image(group_number, group, group.parents[cell])
            self._find(group_number, group, cell, group.children(parent) if parent != NONE else ())
        return self._images[group_number, cell]

    def _find(self, group_number: int, group: ContactCells, cell: int, candidates: Sequence[int]) -> int:
        image = group.cells[cell].anchors() @ self.rotation.T + self.translation
        self._images[group_number, cell] = group.find_equal(image, candidates, self.tolerance)
        return self._images[group_number, cell]


def symmetries(body: Body, task: Task, origin: FloatArray, groups: Sequence[ContactCells]) -> list[Symmetry]:
    """Return the symmetries of a problem other than the identity."""
    result = []
    for rotation, translation in motions_of(body):
        if np.array_equal(rotation, np.eye(body.space)):
            continue
        if np.max(np.abs(rotation @ origin + translation - origin)) > SAME * body.size:
            continue
        if not is_invariant_task(task, wrench_map(rotation)):
            continue
        if not all(group.allowed.is_invariant(rotation, translation, SAME * body.size) for group in groups):
            continue
        symmetry = Symmetry(rotation, translation, SAME * body.size)
        if all(symmetry.maps_roots(i, group) for i, group in enumerate(groups)):
            result.append(symmetry)
    return result


def motions_of(body: Body) -> list[tuple[FloatArray, FloatArray]]:
    """Return candidate rigid motions and reflections of a body onto itself."""
    if isinstance(body, Mesh) or body.charts():  # nothing is known of what maps them onto themselves
        return []
    if isinstance(body, Polygon | Prism):
        planar = _polygon_symmetries(body.corners)
        if isinstance(body, Polygon):
            return planar
        result = []
        for rotation, translation in planar:
            for sign in (1.0, -1.0):
                lifted = np.zeros((3, 3))
                lifted[:2, :2], lifted[2, 2] = rotation, sign
                result.append((lifted, np.append(translation, 0.0)))
        return result
    space = body.space
    sign_choices = list(product((1.0, -1.0), repeat=space))
    axes = [np.eye(space)[list(order)] for order in permutations(range(space))]
    return [(permutation * np.array(signs)[:, None], np.zeros(space)) for permutation in axes for signs in sign_choices]


def _polygon_symmetries(corners: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Return the plane rotations and reflections that map the corners of a polygon onto each other in order."""
    centre = corners.mean(axis=0)
    arms = corners - centre
    size = float(np.max(np.abs(arms)))
    result = []
    for corners_in_order in (arms, arms[::-1]):
        for shift in range(len(arms)):
            image = np.roll(corners_in_order, shift, axis=0)
            U, _, Vt = np.linalg.svd(image.T @ arms)
            rotation = np.asarray(U @ Vt)
            if np.max(np.abs(arms @ rotation.T - image)) <= SAME * size:
                result.append((rotation, centre - rotation @ centre))
    return result


def restrict_by_rotation(
    problem: GraspProblem, faces: Sequence[CellFace], regions: Sequence[AllowedRegion]
) -> list[RotatedRoots]:
    """Return the root cells to which a rotational symmetry restricts the first contacts.

    An empty list without such a symmetry. On a sphere with a task invariant under all rotations, the first contact is
    rotated to the pole and the second to a meridian. On a body of revolution with a task invariant about its axis, the
    first contact is rotated to the half-plane at angle 0.
    """
    if any(region.allowed.is_restricted for region in regions):
        return []
    axis = _symmetry_axis(problem, faces)
    if axis is None:
        return []
    side = np.eye(3)[int(np.argmin(axis))]
    sphere = faces[0] if isinstance(faces[0], EllipsoidFace) and np.ptp(faces[0].a) == 0.0 else None
    centred = float(np.max(np.abs(problem.origin))) <= SAME * problem.body.size
    if (
        isinstance(sphere, EllipsoidFace)
        and centred
        and is_invariant_task(problem.task, wrench_map(rotation_by_one_radian(side)))
    ):
        pole: FacesToCells = {sphere: [EllipsoidCell(axis[None], sphere.surface)]}
        meridian: FacesToCells = {sphere: sphere.half_plane(axis, side)}
        return [("pole", pole), ("meridian", meridian)][: len(regions)]
    half_plane: FacesToCells = {}
    for face in faces:
        if face.name not in regions[0].faces:
            continue
        if isinstance(face, EllipsoidFace):
            half_plane[face] = face.half_plane(axis, side)
        elif isinstance(face, DiscFace | RevolvedFace):
            half_plane[face] = face.meridian_cells()
    return [("half-plane", half_plane)]


def _symmetry_axis(problem: GraspProblem, faces: Sequence[CellFace]) -> FloatArray | None:
    """Return the unit axis of rotations that leave body and task invariant, or None."""
    if problem.body.space == 2:
        return None
    for axis in _axes_of(faces):
        offset = problem.origin - (problem.origin @ axis) * axis
        if np.max(np.abs(offset)) <= SAME * problem.body.size and is_invariant_task(
            problem.task, wrench_map(rotation_by_one_radian(axis))
        ):
            return axis
    return None


def _axes_of(faces: Sequence[CellFace]) -> list[FloatArray]:
    """Return the axes of revolution shared by all faces."""
    if all(isinstance(face, DiscFace | RevolvedFace) for face in faces):
        return [np.eye(3)[2]]
    face = faces[0]
    if len(faces) > 1 or not isinstance(face, EllipsoidFace):
        return []
    return [np.eye(3)[i] for i in range(3) if face.a[i - 1] == face.a[i - 2]]


def rotation_by_one_radian(axis: FloatArray) -> FloatArray:
    """Return the rotation by one radian about a coordinate axis."""
    i = int(np.argmax(np.abs(axis)))
    c, s = np.cos(ANGLE), np.sin(ANGLE)
    result = np.eye(3)
    j, k = (i + 1) % 3, (i + 2) % 3
    result[j, j], result[j, k], result[k, j], result[k, k] = c, -s, s, c
    return result


def wrench_map(rotation: FloatArray) -> FloatArray:
    """Return the matrix of R acting on wrenches about a fixed point: forces by R, moments by det(R) R."""
    space = len(rotation)
    determinant = float(np.round(np.linalg.det(rotation)))
    result = np.zeros((3, 3) if space == 2 else (6, 6))
    result[:space, :space] = rotation
    result[space:, space:] = determinant if space == 2 else determinant * rotation
    return result


def is_invariant_task(task: Task, matrix: FloatArray) -> bool:
    """Return whether a linear map of wrenches provably maps a task onto itself."""
    if isinstance(task, TaskSum):
        return all(is_invariant_task(part, matrix) for part in task.tasks)
    if isinstance(task, TaskEllipsoid):
        shape = task.axes.T @ task.axes
        sizes = np.sqrt(np.maximum(np.diag(shape), 0.0)) + np.abs(task.center)
        mapped, blocks = matrix @ shape @ matrix.T, _component_scales(sizes)
        is_close = np.all(np.abs(mapped - shape) <= SAME * np.outer(blocks, blocks))
        return bool(is_close and np.all(np.abs(matrix @ task.center - task.center) <= SAME * np.max(blocks)))
    if isinstance(task, TaskPolytope):
        sizes = _component_scales(np.max(np.abs(task.wrenches), axis=0))
        images, wrenches = (w / sizes for w in (task.wrenches @ matrix.T, task.wrenches))
        distances = np.max(np.abs(images[:, None] - wrenches[None]), axis=2)
        return bool(np.max(distances.min(axis=1)) <= SAME and np.max(distances.min(axis=0)) <= SAME)
    return False


def _component_scales(scale: FloatArray) -> FloatArray:
    """Return for each wrench component the largest force or the largest moment, 1 if that is zero."""
    space = 2 if len(scale) == 3 else 3
    force, moment = float(np.max(scale[:space])), float(np.max(scale[space:]))
    sizes = np.array([force] * space + [moment] * (len(scale) - space))
    return np.where(sizes > 0.0, sizes, 1.0)
