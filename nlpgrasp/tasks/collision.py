"""Contact events along a motion, as a task: Example 3-4."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.validation import SMALLEST, array, number, read_only
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.ellipsoid import TaskEllipsoid
from nlpgrasp.tasks.learnt.enclosing import GAP, enclose


@dataclass(frozen=True)
class CollisionEvent:
    """A push of the surroundings that may happen.

    Parameters
    ----------
    point : (3,) array
        Where the body is hit, body frame, metres.
    direction : (3,) array
        In which it is pushed, body frame.
    likelihood : float
        How likely this is, over the other events: the reach of the task's ellipsoid against it.
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
    """Return the least ellipsoid around what the fingers exert against each of the events, and against none.

    Events of likelihoods r_i along the two senses of the six axes give the ellipsoid of (3.3-1) with semi-axes in
    these ratios; an event without its opposite moves the centre, as c_1 does there.

    Parameters
    ----------
    events : sequence of CollisionEvent
        At least one.
    force : float
        Of an event of likelihood 1, newtons.

    Warns
    -----
    UserWarning
        When the events leave some wrenches out: the ellipsoid is flat, and the directions are named.
    """
    if not isinstance(events, list | tuple) or not events or not all(isinstance(e, CollisionEvent) for e in events):
        raise InputError("events", events, "at least one CollisionEvent")
    size = number("force", force, above=0.0)
    wrenches = [np.zeros(6)]
    for event in events:
        direction, point = np.asarray(event.direction), np.asarray(event.point)
        push = size * event.likelihood * direction / np.linalg.norm(direction)
        wrenches.append(-np.concatenate([push, np.cross(point, push)]))
    found = enclose(np.array(wrenches), 0.0, None, None, GAP)
    return TaskEllipsoid.from_axes(found.axes, found.center).given_about(np.zeros(3))
