"""Symmetries shared by body, task and constraints: finite groups, and rotations about an axis.

Placements that are images of others need no second look. A finite group (``symmetries``) maps cells of contacts onto
each other, so that nodes are bounded once for all their images. A rotation by any angle (``pinned``) turns the first
contact, or the first two, to a line or a point of the surface.
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
TURN = 1.0  # radians, of a rotation that only continuous symmetries contain

FirstCells = dict[CellFace, Sequence[SurfaceCell]]  # root cells of a contact, by face
Turned = tuple[str, FirstCells]  # where a contact is turned to, as in ``Roots.turned``, and its root cells


class Symmetry:
    """Rigid motion or reflection ``p -> R p + t`` that maps the problem onto itself.

    Parameters
    ----------
    rotation : (space, space) array
        R, orthogonal.
    translation : (space,) array
        t, metres.
    tolerance : float
        Metres, to which images of cells are cells.
    """

    def __init__(self, rotation: FloatArray, translation: FloatArray, tolerance: float) -> None:
        self.rotation, self.translation, self.tolerance = rotation, translation, tolerance
        self._images: dict[tuple[int, int], int] = {}

    def of(self, points: FloatArray) -> FloatArray:
        """Return images of points (m, space)."""
        return np.asarray(points @ self.rotation.T + self.translation)

    def maps_roots(self, number: int, pieces: ContactCells) -> bool:
        """Return whether every root of some pieces has an image among them; remembers the images."""
        return all(self._find(number, pieces, root, pieces.roots) != NONE for root in pieces.roots)

    def image(self, number: int, pieces: ContactCells, cell: int) -> int:
        """Return the number of a cell's image among the same pieces, ``NONE`` where it was not cut the same way."""
        known = self._images.get((number, cell))
        if known is not None:
            return known
        parent = self.image(number, pieces, pieces.parents[cell])
        candidates = pieces.children(parent) if parent != NONE else ()
        return self._find(number, pieces, cell, candidates)

    def _find(self, number: int, pieces: ContactCells, cell: int, candidates: Sequence[int]) -> int:
        points = self.of(pieces.cells[cell].anchors())
        self._images[number, cell] = found = pieces.equal_candidate(cell, points, candidates, self.tolerance)
        return found


def symmetries(body: Body, task: Task, origin: FloatArray, pieces: Sequence[ContactCells]) -> list[Symmetry]:
    """Return the symmetries, but for the identity, under which a problem stays the same."""
    result = []
    if any(p.supports.contact.turned(np.eye(body.space)) is not p.supports.contact for p in pieces):
        return []
    for rotation, translation in motions_of(body):
        if np.array_equal(rotation, np.eye(body.space)):
            continue
        if np.max(np.abs(rotation @ origin + translation - origin)) > SAME * body.size:
            continue
        if not leaves_invariant(task, wrench_map(rotation)):
            continue
        if not all(p.allowed.same_after(rotation, translation, SAME * body.size) for p in pieces):
            continue
        found = Symmetry(rotation, translation, SAME * body.size)
        if all(found.maps_roots(i, p) for i, p in enumerate(pieces)):
            result.append(found)
    return result


def motions_of(body: Body) -> list[tuple[FloatArray, FloatArray]]:
    """Return rigid motions and reflections that may map a body onto itself."""
    if isinstance(body, Mesh):
        return []
    if isinstance(body, Polygon | Prism):
        flat = _polygon_symmetries(body.corners)
        if isinstance(body, Polygon):
            return flat
        result = []
        for rotation, translation in flat:
            for sign in (1.0, -1.0):
                lifted = np.zeros((3, 3))
                lifted[:2, :2], lifted[2, 2] = rotation, sign
                result.append((lifted, np.append(translation, 0.0)))
        return result
    space = body.space
    signs = list(product((1.0, -1.0), repeat=space))
    axes = [np.eye(space)[list(order)] for order in permutations(range(space))]
    return [(axis * np.array(sign)[:, None], np.zeros(space)) for axis in axes for sign in signs]


def _polygon_symmetries(corners: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Return the rotations and reflections of the plane that map a polygon's corners onto each other in order."""
    middle = corners.mean(axis=0)
    arms = corners - middle
    size = float(np.max(np.abs(arms)))
    result = []
    for turned in (arms, arms[::-1]):
        for shift in range(len(arms)):
            image = np.roll(turned, shift, axis=0)
            U, _, Vt = np.linalg.svd(image.T @ arms)
            rotation = np.asarray(U @ Vt)
            if np.max(np.abs(arms @ rotation.T - image)) <= SAME * size:
                result.append((rotation, middle - rotation @ middle))
    return result


def restrict_by_rotation(
    problem: GraspProblem, faces: Sequence[CellFace], own: Sequence[AllowedRegion]
) -> list[Turned]:
    """Return where it is enough for the first contact to be, or the first two, and cells; none where nothing turns.

    On a sphere, for a task that any turn leaves as it is, the first contact can be turned to the pole and the second to
    a meridian. On a body of revolution, for a task that turns about its axis leave as it is, the first contact can be
    turned to the half-plane at angle 0.
    """
    if any(places.allowed.is_limited for places in own):
        return []
    axis = _axis(problem, faces)
    if axis is None:
        return []
    side = np.eye(3)[int(np.argmin(axis))]
    used = [[face for face in faces if face.name in places.faces] for places in own]
    sphere = faces[0] if isinstance(faces[0], EllipsoidFace) and np.ptp(faces[0].a) == 0.0 else None
    centred = float(np.max(np.abs(problem.origin))) <= SAME * problem.body.size
    if (
        isinstance(sphere, EllipsoidFace)
        and centred
        and leaves_invariant(problem.task, wrench_map(unit_rotation(side)))
    ):
        pole: FirstCells = {sphere: [EllipsoidCell(axis[None], sphere.patches)]}
        meridian: FirstCells = {sphere: sphere.half_plane(axis, side)}
        return [("pole", pole), ("meridian", meridian)][: len(own)]
    first: FirstCells = {}
    for face in used[0]:
        if isinstance(face, EllipsoidFace):
            first[face] = face.half_plane(axis, side)
        elif isinstance(face, DiscFace | RevolvedFace):
            first[face] = face.meridian_cells()
    return [("half-plane", first)]


def _axis(problem: GraspProblem, faces: Sequence[CellFace]) -> FloatArray | None:
    """Return the axis about which body and task can be turned by any angle, unit, or None."""
    if problem.body.space == 2:
        return None
    for axis in _axes_of(faces):
        beside = problem.origin - (problem.origin @ axis) * axis
        if np.max(np.abs(beside)) <= SAME * problem.body.size and leaves_invariant(
            problem.task, wrench_map(unit_rotation(axis))
        ):
            return axis
    return None


def _axes_of(faces: Sequence[CellFace]) -> list[FloatArray]:
    """Return the axes of revolution that all faces share."""
    if all(isinstance(face, DiscFace | RevolvedFace) for face in faces):
        return [np.eye(3)[2]]
    face = faces[0]
    if len(faces) > 1 or not isinstance(face, EllipsoidFace):
        return []
    return [np.eye(3)[i] for i in range(3) if face.a[i - 1] == face.a[i - 2]]


def unit_rotation(axis: FloatArray) -> FloatArray:
    """Return the rotation by one radian about a coordinate axis."""
    i = int(np.argmax(np.abs(axis)))
    c, s = np.cos(TURN), np.sin(TURN)
    result = np.eye(3)
    j, k = (i + 1) % 3, (i + 2) % 3
    result[j, j], result[j, k], result[k, j], result[k, k] = c, -s, s, c
    return result


def wrench_map(rotation: FloatArray) -> FloatArray:
    """Return how wrenches about a fixed point turn under R: forces by R, moments by det(R) R."""
    space = len(rotation)
    handed = float(np.round(np.linalg.det(rotation)))
    result = np.zeros((3, 3) if space == 2 else (6, 6))
    result[:space, :space] = rotation
    result[space:, space:] = handed if space == 2 else handed * rotation
    return result


def leaves_invariant(task: Task, matrix: FloatArray) -> bool:
    """Return whether a linear map of wrenches is known to map a task onto itself."""
    if isinstance(task, TaskSum):
        return all(leaves_invariant(part, matrix) for part in task.tasks)
    if isinstance(task, TaskEllipsoid):
        shape = task.axes.T @ task.axes
        scale = np.sqrt(np.maximum(np.diag(shape), 0.0)) + np.abs(task.center)
        turned, blocks = matrix @ shape @ matrix.T, _blocks(scale)
        near = np.all(np.abs(turned - shape) <= SAME * np.outer(blocks, blocks))
        return bool(near and np.all(np.abs(matrix @ task.center - task.center) <= SAME * np.max(blocks)))
    if isinstance(task, TaskPolytope):
        scale = _blocks(np.max(np.abs(task.wrenches), axis=0))
        images, given = (w / scale for w in (task.wrenches @ matrix.T, task.wrenches))
        apart = np.max(np.abs(images[:, None] - given[None]), axis=2)
        return bool(np.max(apart.min(axis=1)) <= SAME and np.max(apart.min(axis=0)) <= SAME)
    return False


def _blocks(scale: FloatArray) -> FloatArray:
    """Return for each component the largest of its kind: forces by forces, moments by moments; 1 where all are zero."""
    space = 2 if len(scale) == 3 else 3
    force, moment = float(np.max(scale[:space])), float(np.max(scale[space:]))
    sizes = np.array([force] * space + [moment] * (len(scale) - space))
    return np.where(sizes > 0.0, sizes, 1.0)
