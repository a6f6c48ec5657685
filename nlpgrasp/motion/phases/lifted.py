"""Lift of hand and body: largest collision-free height."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.bodies import Body, Mesh
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.constraints import Table
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.space.surroundings import Surroundings
from nlpgrasp.problem.fields import Field, fields_of
from nlpgrasp.problem.problem import GraspProblem

LIFT = 0.2  # metres, height of the lift
STEP = 2e-3  # metres, least step of the collision check
SAMPLES = 4000  # of the body's surface


def lifted(around: Surroundings, problem: GraspProblem, values: Values) -> Json:
    """Return direction and distance of a lift: along the table's normal, the last axis, as far as that is free.

    The links' balls and samples of the body's surface are looked at, at steps as long as their distance from obstacles
    or of two millimetres; they may stay as near as they are in the grasp. From a table they all move away.

    Parameters
    ----------
    around : Surroundings
    problem : GraspProblem
    values : dict
        Of the hand's variables in the grasp.

    Returns
    -------
    dict
        ``direction``, ``distance`` in metres, and, where it is less than 0.2 m, the ``reason``.
    """
    up, body = np.eye(3)[-1], problem.body
    above = [constraint for constraint in problem.constraints if not isinstance(constraint, Table)]
    others = fields_of(body, above, around.hand.count)[1:] if above else []
    height, reason = LIFT, ""
    if others:
        samples = body_samples(body, np.random.default_rng(0))
        points = np.concatenate([around.balls.places(values), samples])
        radii = np.concatenate([around.balls.radii, np.zeros(len(samples))])
        height, blocked_by = _free(others, points, radii, around.tolerance)
        reason = f"{blocked_by} is in the way of a lift by {1e3 * LIFT:.0f} mm" if blocked_by else ""
    return {"direction": up.tolist(), "distance": height, **({"reason": reason} if reason else {})}


def body_samples(body: Body, rng: np.random.Generator) -> FloatArray:
    """Return samples (m, 3) of the body's surface; of a mesh its vertices too."""
    if isinstance(body, Mesh):
        vertices = np.asarray(body.mesh.vertices, dtype=float)
        return np.concatenate([vertices, body.surface_samples(SAMPLES, rng)[0]])
    each = max(SAMPLES // len(body.face_names), 50)
    return np.concatenate([body.sample(name, each, rng) for name in body.face_names])


def _free(fields: Sequence[Field], points: FloatArray, radii: FloatArray, tolerance: float) -> tuple[float, str]:
    """Return the collision-free height of spheres (m, 3), metres, and the obstacle where it is less than the lift."""
    first = [field.distance(points) - radii for field in fields]
    least, height, rooms, up = [np.minimum(room, 0.0) for room in first], 0.0, first, np.eye(3)[-1]
    while height < LIFT:
        near = min(float(np.min(room - start)) for room, start in zip(rooms, least, strict=True))
        above = min(height + max(STEP, near), LIFT)
        rooms = [field.distance(points + above * up) - radii for field in fields]
        for field, room, start in zip(fields, rooms, least, strict=True):
            if np.any(room < start - tolerance):
                return height, field.name
        height = above
    return LIFT, ""
