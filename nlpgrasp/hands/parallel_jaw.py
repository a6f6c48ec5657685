"""Parallel-jaw gripper: two opposed jaws that close along a line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import casadi as ca
import numpy as np

from nlpgrasp.common.given.angles import angle
from nlpgrasp.common.given.lengths import of_a_hand
from nlpgrasp.common.rows import Placement, Row
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, number, within
from nlpgrasp.errors import InputError
from nlpgrasp.hands.base import Hand, HandVariable
from nlpgrasp.hands.jaw_pose import APPROACH_AXIS, CLOSING_AXIS, Cone, Distance, Jaws, named, own_axes

MOST_TILT = 0.5 * np.pi * (1.0 - 1e-9)
LARGEST_PART = 2.0  # metres: largest dimension of a gripper's finger


@dataclass(frozen=True)
class ParallelJaw(Hand):
    """Two flat jaws that face each other, for two contacts (usually soft ones).

    The line between the contacts is within an angle of both inward normals: jaws close along one line and touch
    flat. The opening is the distance of the contacts along it.

    A solution states the gripper's pose in ``hand``: ``palm_pose`` (of the gripper's own frame: its closing axis from
    contact 0 to contact 1, its approach axis along the approach), ``opening``, and ``approach``: its ``direction``, and
    its penetration ``depth``. The contacts do not determine the rotation about the closing line: of 36 directions the
    clearest of the body, tables and obstacles is taken, within the cones of ``Approach`` (docs/hands.md).

    Parameters
    ----------
    opening : float
        Greatest distance between the jaws, metres.
    closed : float
        Least distance between them, metres.
    tilt : float
        Largest angle between a contact's normal and the closing direction, radians: compliant pads give a little.
    finger_length : float
        From the middle between the pads back to the gripper's frame, metres; 0 puts the frame between the pads.
    finger_thickness : float
        Of a finger in the closing direction, outwards from its pad, metres; 0 checks the pads' lines alone.
    closing_axis : str or (3,) sequence of float
        Direction of the closing line in the gripper's own frame, from the jaw at contact 0 to that at contact 1:
        ``"x"``, ``"y"``, ``"z"``, with a sign such as ``"-x"``, or a unit direction. The Franka hand closes along y.
    approach_axis : str or (3,) sequence of float
        Direction in which the gripper moves to the body, in its own frame, at right angles to ``closing_axis``.
    """

    kind: ClassVar[str] = "parallel_jaw"
    opening: float
    closed: float = 0.0
    tilt: float = 0.05
    finger_length: float = 0.0
    finger_thickness: float = 0.0
    closing_axis: str | Sequence[float] = CLOSING_AXIS
    approach_axis: str | Sequence[float] = APPROACH_AXIS
    count: int = field(default=2, init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "closed", number("ParallelJaw.closed", self.closed, at_least=0.0))
        opening = of_a_hand("ParallelJaw.opening", number("ParallelJaw.opening", self.opening, above=0.0))
        if opening <= self.closed:
            raise InputError("ParallelJaw.opening", f"{opening:g} m", f"more than closed, {self.closed:g} m")
        object.__setattr__(self, "opening", opening)
        object.__setattr__(self, "tilt", angle("ParallelJaw.tilt", self.tilt, MOST_TILT, "less than a right angle"))
        for name in ("finger_length", "finger_thickness"):
            length = number(f"ParallelJaw.{name}", getattr(self, name), at_least=0.0)
            object.__setattr__(self, name, of_a_hand(f"ParallelJaw.{name}", length, LARGEST_PART))
        with within("ParallelJaw."):
            axes = own_axes(self.closing_axis, self.approach_axis)
        object.__setattr__(self, "closing_axis", named(axes[:, 0]))
        object.__setattr__(self, "approach_axis", named(axes[:, 2]))

    @property
    def tip_radii(self) -> tuple[float, ...]:
        """Radii of the two flat pads: zero."""
        return (0.0, 0.0)

    def variables(self, bounds: FloatArray) -> list[HandVariable]:
        """Return no variables: the contacts determine the jaws."""
        return []

    def rows(self, placement: Placement, variables: dict[str, Expression]) -> list[Row]:
        """Return constraints on the opening and on the angle of each normal to the closing line."""
        (p, q), (m, n) = placement.positions, placement.normals
        between = q - p
        squared = ca.sumsqr(between)
        length = ca.sqrt(squared + 1e-12 * placement.size**2)
        cosine = float(np.cos(self.tilt))
        return [
            Row("opening of the jaws", squared, self.closed**2, self.opening**2, placement.size**2, unit="m2"),
            Row("opposed jaws", ca.dot(m, n), upper=-float(np.cos(2.0 * self.tilt))),
            Row("facing", ca.dot(m, between) - cosine * length, 0.0, scale=placement.size, part="jaw 0"),
            Row("facing", -ca.dot(n, between) - cosine * length, 0.0, scale=placement.size, part="jaw 1"),
        ]

    def closing(self, positions: Sequence[Expression]) -> Expression:
        """Return the line from one contact to the other."""
        return positions[1] - positions[0]

    def at_contacts(self, points: FloatArray, size: float, distance: Distance, cones: Sequence[Cone] = ()) -> Json:
        """Return pose, opening and approach of the gripper, as JSON data."""
        axes = self.closing_axis, self.approach_axis
        return Jaws(points, self.finger_length, self.finger_thickness, tuple(cones), *axes).posture(size, distance)

    def to_dict(self) -> Json:
        """Return limits, fingers, and axes other than x and z, as JSON data."""
        axes = {"closing_axis": self.closing_axis, "approach_axis": self.approach_axis}
        usual = {"closing_axis": CLOSING_AXIS, "approach_axis": APPROACH_AXIS}
        others = {k: a if isinstance(a, str) else list(a) for k, a in axes.items() if a != usual[k]}
        return {
            "type": self.kind,
            "opening": self.opening,
            "closed": self.closed,
            "tilt": self.tilt,
            "finger_length": self.finger_length,
            "finger_thickness": self.finger_thickness,
            **others,
        }
