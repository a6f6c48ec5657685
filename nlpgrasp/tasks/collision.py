"""Task ellipsoid of collision events along a motion (Example 3-4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.validation import SMALLEST, array, number, read_only
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.enclosing_ellipsoid import GAP, enclose
from nlpgrasp.tasks.task_ellipsoid import TaskEllipsoid


@dataclass(frozen=True)
class CollisionEvent:
    """A possible collision: a push of the environment on the body.

    Parameters
    ----------
    point : (3,) array
        Point of impact, body frame, metres.
    direction : (3,) array
        Of the push, body frame.
    likelihood : float
        Relative likelihood, which scales the force of the event.
    """

    point: ArrayLike
    direction: ArrayLike
    likelihood: float = 1.0

    def __post_init__(self) -> None:
        for name in ("point", "direction"):
            object.__setattr__(self, name, read_only(array(f"CollisionEvent.{name}", getattr(self, name), (3,))))
        if not np.linalg.norm(np.asarray(self.direction)) > SMALLEST:
            raise InputError("CollisionEvent.direction", self.direction, "a direction that is not zero")
        likelihood = number("CollisionEvent.likelihood", self.likelihood, above=0.0)
        object.__setattr__(self, "likelihood", likelihood)


def collision_task(events: Sequence[CollisionEvent], force: float = 1.0) -> TaskEllipsoid:
    """Return the minimum-volume ellipsoid around zero and the wrenches that the fingers exert against the pushes.

    Events of likelihoods r_i in both directions of the six axes give the ellipsoid of (3.3-1) with semi-axes in these
    ratios; an event without its opposite shifts the centre, as c_1 does there.

    Parameters
    ----------
    events : sequence of CollisionEvent
        At least one.
    force : float
        Of an event of likelihood 1, newtons.

    Warns
    -----
    UserWarning
        When the wrenches do not span wrench space: the ellipsoid is flat, and the directions are named.
    """
    if not isinstance(events, list | tuple) or not events or not all(isinstance(e, CollisionEvent) for e in events):
        raise InputError("events", events, "at least one CollisionEvent")
    size = number("force", force, above=0.0)
    wrenches = [np.zeros(6)]
    for event in events:
        direction, point = np.asarray(event.direction), np.asarray(event.point)
        push = size * event.likelihood * direction / np.linalg.norm(direction)
        wrenches.append(-np.concatenate([push, np.cross(point, push)]))
    ellipsoid = enclose(np.array(wrenches), 0.0, None, None, GAP)
    return TaskEllipsoid.from_axes(ellipsoid.axes, ellipsoid.center).given_about(np.zeros(3))
