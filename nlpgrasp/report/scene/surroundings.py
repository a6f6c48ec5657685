"""Surroundings of a body: tables and obstacles of a problem or a solution file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.bodies import Body, Box
from nlpgrasp.bodies.mesh.triangles import triangles
from nlpgrasp.common.shown.drawing import Triangles
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.constraints import Obstacle, PlacementConstraint, Table
from nlpgrasp.errors import InputError
from nlpgrasp.solution.solution import GraspSolution

MOST = 1000  # most triangles of an obstacle
WIDE, THICK = 2.5, 0.05  # half width of a table, thickness of a planar one, in body sizes


@dataclass(frozen=True)
class Surroundings:
    """Tables and obstacles around a body.

    Parameters
    ----------
    heights : tuple of float
        Heights of the tables' tops, metres: along z, or along y for a planar body.
    obstacles : tuple of (str, Triangles)
        Names and triangles, body frame.
    unseen : tuple of str
        Obstacles whose surface the file does not contain, such as meshes.
    """

    heights: tuple[float, ...]
    obstacles: tuple[tuple[str, Triangles], ...]
    unseen: tuple[str, ...]


def surroundings(solution: GraspSolution) -> Surroundings:
    """Return the tables and obstacles of a solution's problem."""
    kinds = {kind.kind: kind for kind in (Table, Obstacle)}
    read: list[PlacementConstraint] = []
    unread = []
    for data in solution.problem.get("constraints", []):
        if (kind := kinds.get(data.get("type"))) is not None:
            try:
                read.append(kind.from_dict(data))
            except InputError:
                unread.append(str(data.get("name", kind.kind)))
    found = around(read)
    return replace(found, unseen=(*unread, *found.unseen))


def around(constraints: Iterable[PlacementConstraint]) -> Surroundings:
    """Return the tables and obstacles among the constraints of a problem."""
    heights, seen, unseen = [], [], []
    for constraint in constraints:
        if isinstance(constraint, Table):
            heights.append(constraint.height)
        elif isinstance(constraint, Obstacle):
            try:
                seen.append((constraint.name, placed(constraint)))
            except InputError:
                unseen.append(constraint.name)
    return Surroundings(tuple(heights), tuple(seen), tuple(unseen))


def placed(obstacle: Obstacle) -> Triangles:
    """Return an obstacle's surface in its pose, body frame.

    Raises
    ------
    InputError
        When its body is not one of this package's, so that its surface is unknown.
    """
    if not isinstance(obstacle.body, Body):
        raise InputError("Obstacle.body", obstacle.body, "a body")
    vertices, faces = triangles(obstacle.body, MOST)
    turn, at = np.eye(3), np.zeros(3)
    turn[: obstacle.body.space, : obstacle.body.space] = obstacle.rotation
    if obstacle.position is not None:
        at[: obstacle.body.space] = np.asarray(obstacle.position)
    return Triangles(vertices @ turn.T + at, faces)


def slab(height: float, body: FloatArray, size: float) -> Triangles:
    """Return the front view of a table under a planar body: a bar whose top is at the table's height.

    Parameters
    ----------
    height : float
        Along y, metres.
    body : (n, 3) array
        The drawn body's vertices.
    size : float
        The drawn body's, metres.
    """
    vertices, faces = triangles(Box([2.0 * WIDE * size, THICK * size, float(np.ptp(body[:, 2])) or THICK * size]))
    middle = (body.min(axis=0) + body.max(axis=0)) / 2.0
    return Triangles(vertices + np.array([middle[0], height - THICK * size / 2.0, 0.0]), faces)
