"""Bodies and tasks that look the same after any turn: one contact, or two, can be turned to a line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.best.cells.base import Cell, Surface
from nlpgrasp.best.cells.curved.ellipsoid import EllipsoidCell, EllipsoidFace
from nlpgrasp.best.cells.curved.revolved import RevolvedFace
from nlpgrasp.best.cells.disc import DiscFace
from nlpgrasp.best.scope.places import Places
from nlpgrasp.best.scope.symmetry import keeps, wrench_map
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.problem.problem import GraspProblem

TURN = 1.0  # radians: a turn by it belongs to no symmetry but a continuous one
SAME = 1e-9

Roots = dict[Surface, Sequence[Cell]]
Turned = tuple[str, Roots]


def pinned(problem: GraspProblem, faces: Sequence[Surface], own: Sequence[Places]) -> list[Turned]:
    """Return where it is enough for the first contact to be, or the first two, and cells; none where nothing turns.

    On a sphere, for a task that any turn leaves as it is, the first contact can be turned to the pole and the second to
    a meridian. On a body of revolution, for a task that turns about its axis leave as it is, the first contact can be
    turned to the half-plane at angle 0.
    """
    if any(places.allowed.limited for places in own):
        return []
    axis = _axis(problem, faces)
    if axis is None:
        return []
    side = np.eye(3)[int(np.argmin(axis))]
    used = [[face for face in faces if face.name in places.faces] for places in own]
    sphere = faces[0] if isinstance(faces[0], EllipsoidFace) and np.ptp(faces[0].a) == 0.0 else None
    centred = float(np.max(np.abs(problem.origin))) <= SAME * problem.body.size
    if isinstance(sphere, EllipsoidFace) and centred and keeps(problem.task, wrench_map(turn_about(side))):
        pole: Roots = {sphere: [EllipsoidCell(axis[None], sphere.patches)]}
        meridian: Roots = {sphere: sphere.half_plane(axis, side)}
        return [("pole", pole), ("meridian", meridian)][: len(own)]
    first: Roots = {}
    for face in used[0]:
        if isinstance(face, EllipsoidFace):
            first[face] = face.half_plane(axis, side)
        elif isinstance(face, DiscFace | RevolvedFace):
            first[face] = face.pinned()
    return [("half-plane", first)]


def _axis(problem: GraspProblem, faces: Sequence[Surface]) -> FloatArray | None:
    """Return the axis about which body and task can be turned by any angle, unit, or None."""
    if problem.body.space == 2:
        return None
    for axis in _axes_of(faces):
        beside = problem.origin - (problem.origin @ axis) * axis
        if np.max(np.abs(beside)) <= SAME * problem.body.size and keeps(problem.task, wrench_map(turn_about(axis))):
            return axis
    return None


def _axes_of(faces: Sequence[Surface]) -> list[FloatArray]:
    """Return the axes of revolution that all faces share."""
    if all(isinstance(face, DiscFace | RevolvedFace) for face in faces):
        return [np.eye(3)[2]]
    face = faces[0]
    if len(faces) > 1 or not isinstance(face, EllipsoidFace):
        return []
    return [np.eye(3)[i] for i in range(3) if face.a[i - 1] == face.a[i - 2]]


def turn_about(axis: FloatArray) -> FloatArray:
    """Return the rotation by one radian about a coordinate axis."""
    i = int(np.argmax(np.abs(axis)))
    c, s = np.cos(TURN), np.sin(TURN)
    result = np.eye(3)
    j, k = (i + 1) % 3, (i + 2) % 3
    result[j, j], result[j, k], result[k, j], result[k, k] = c, -s, s, c
    return result
