"""Check of reductions by continuous symmetry: some contacts may be restricted to a line or a point."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.tasks import Task
from nlpgrasp.verify.bound.cells.ellipsoid import Ellipsoid
from nlpgrasp.verify.bound.cells.outlines import Faces, FlatFace
from nlpgrasp.verify.bound.faces import is_among
from nlpgrasp.verify.bound.motions import keeps_body, keeps_task, on_wrenches
from nlpgrasp.verify.bound.places import Places

RADIAN = 1.0  # an irrational share of a turn: invariance under it implies invariance under all turns
SAME = 1e-9


class Turning:
    """Body, task and torque origin of a problem, for tests of rotational symmetry without constraints.

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

    def about(self, axis: FloatArray) -> bool:
        """Return whether rotations about a unit axis (3,) through the frame's origin leave everything invariant."""
        R = Rotation.from_rotvec(RADIAN * axis).as_matrix()
        stays = float(np.max(np.abs(R @ self.origin - self.origin))) <= SAME * self.size
        same_task = keeps_task(self.task, on_wrenches(R))
        return stays and same_task and keeps_body(self.body, R, np.zeros(3), SAME * self.size)


def wrong_with(groups: Sequence[Json], turning: Turning, faces: Faces, places: Sequence[Places]) -> str:
    """Return why the stated reductions are not allowed, or do not cover their line; empty if they are.

    Two reductions are allowed. On a body of revolution, one contact on the half-plane at angle 0, for an ellipsoid on
    any half-plane through the axis. On a sphere, one contact at a pole and one on a meridian through it.
    """
    turned = [group for group in groups if group["turned"] is not None]
    if not turned:
        return ""
    if len(turning.origin) != 3 or any(own.limited for own in places):
        return "constraints, or a body in the plane, do not turn"
    if any(len(group["contacts"]) != 1 for group in turned):
        return "several contacts are turned as one"
    ways = sorted(str(group["turned"]) for group in turned)
    roots = {str(group["turned"]): [cell for _, cell in group["roots"]] for group in turned}
    if ways == ["half-plane"]:
        own = places[turned[0]["contacts"][0]]
        return _half_plane(roots["half-plane"], turning, {n: f for n, f in faces.items() if n in own.faces})
    if ways in (["pole"], ["meridian", "pole"]):
        return _pole(roots["pole"], roots.get("meridian"), turning)
    return f"nothing can be turned to {', '.join(ways)}"


def _half_plane(roots: Sequence[Json], turning: Turning, faces: Faces) -> str:
    axis = np.array([0.0, 0.0, 1.0])
    if turning.body["type"] in ("sphere", "ellipsoid"):
        ends = _arcs(roots)
        if ends is None or not all(_is_on(Ellipsoid(cell), turning) for cell in roots):
            return "the cells are no half-plane of the body"
        axis = ends
    if not turning.about(axis):
        return "body and task are not the same after every turn"
    for name, face in faces.items():
        if turning.body["type"] in ("sphere", "ellipsoid"):
            continue
        if isinstance(face, FlatFace):
            return "a flat face does not turn"
        if face is None:
            return "a mesh does not turn"
        at_zero = [{**cell, "angles": [0.0, 0.0]} for cell in face]
        if not all(is_among(cell, roots, turning.size) for cell in at_zero):
            return f"the cells do not cover the half-plane of {name}"
    return ""


def _pole(pole: Sequence[Json], meridian: Sequence[Json] | None, turning: Turning) -> str:
    if not _round(turning.body) or len(pole) != 1:
        return "only a sphere has every point for a pole"
    point = Ellipsoid(pole[0])
    if not _is_on(point, turning) or len(point.corners) != 1:
        return "the pole is no point of the sphere"
    if not all(turning.about(axis) for axis in np.eye(3)):
        return "body and task are not the same after every turn"
    ends = None if meridian is None else _arcs(meridian)
    if meridian is not None:
        on = all(_is_on(Ellipsoid(cell), turning) for cell in meridian)
        if not on or ends is None or np.max(np.abs(np.abs(ends @ point.corners[0]) - 1.0)) > SAME:
            return "the cells are no meridian through the pole"
    return ""


def _round(body: Json) -> bool:
    """Return whether a body is a sphere, also as an ellipsoid with equal semi-axes."""
    return body["type"] == "sphere" or (body["type"] == "ellipsoid" and len(set(body["semi_axes"])) == 1)


def _is_on(cell: Ellipsoid, turning: Turning) -> bool:
    axes = turning.body["radius"] if turning.body["type"] == "sphere" else np.asarray(turning.body["semi_axes"])
    return bool(np.all(np.abs(cell.axes - axes) <= SAME * turning.size))


def _arcs(roots: Sequence[Json]) -> FloatArray | None:
    """Return the axis of two quarter circles that meet in one point at right angles to it; None for other arcs."""
    cells = [Ellipsoid(cell) for cell in roots if cell["kind"] == "ellipsoid"]
    if len(cells) != 2 or any(len(cell.corners) != 2 for cell in cells):
        return None
    (first, side), (last, again) = (cell.corners for cell in cells)
    straight = max(np.max(np.abs(side - again)), np.max(np.abs(first + last)), abs(float(first @ side)))
    return np.asarray(first) if straight <= SAME else None
