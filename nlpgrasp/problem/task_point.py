"""Warnings about implausible points of application of task forces."""

from __future__ import annotations

import numpy as np

from nlpgrasp.bodies import Body
from nlpgrasp.common.shown.once import say_once
from nlpgrasp.tasks import Task
from nlpgrasp.tasks.base import parts_of
from nlpgrasp.tasks.ranges import component_ranges

FAR = 0.1  # of the body's size: distance of the frame's origin from the centroid
LONG, LONGEST = 100.0, 2.0  # moment arm that is implausible: times the body's size, and metres


def warn_of_point(task: Task, body: Body) -> None:
    """Warn, once, about a disturbance without point on a body whose frame's origin is off its centroid.

    Scans and CAD parts often have their origin at a foot or a flange: a force that acts there has a moment arm about
    the centroid, and requires far more torque than the disturbance states.

    Parameters
    ----------
    task : Task
        As given, before its moments are taken about the problem's torque origin.
    body : Body
    """
    _warn_of_arm(task, body)
    away = float(np.linalg.norm(body.centroid))
    if away > FAR * body.size and any(part.point_left_out for part in parts_of(task)):
        say_once(
            f"disturbance: without a point its force acts at the origin of the body's frame, {1e3 * away:.3g} mm from "
            "the body's centroid: state point=body.centroid, or point=[0, 0, 0] where that is meant"
        )


def _warn_of_arm(task: Task, body: Body) -> None:
    """Warn, once, about moments whose arms are too long for the body.

    Typical causes are a point in millimetres and moments in newton-millimetres.
    """
    most, space = np.max(np.abs(component_ranges(task)), axis=0), body.space
    force, moment = float(np.max(most[:space])), float(np.max(most[space:]))
    if force > 0.0 and moment / force > max(LONG * body.size, LONGEST):
        told = f"moments up to {moment:.3g} N m beside forces up to {force:.3g} N, an arm of {moment / force:.3g} m"
        say_once(f"task: {told} on a body of {2.0 * body.size:.3g} m: moments are newton-metres, and points metres")
