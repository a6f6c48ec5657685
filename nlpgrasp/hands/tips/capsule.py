"""Capsule fingertip: contact on its round ends or anywhere along its side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from nlpgrasp.common.rows import Row
from nlpgrasp.common.shown.drawing import Triangles
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.tips.base import SLACK, Touch, equal
from nlpgrasp.hands.tips.cylinder import CylinderTip
from nlpgrasp.hands.tips.patches import FINE, dome, tube

ROUNDING = 1e-4  # largest depth of a contact inside the capsule, as a share of the axis' length


@dataclass(frozen=True)
class CapsuleTip(CylinderTip):
    """A capsule between two points of its axis: side and both round ends.

    With s from 0 to 1 along the axis and v = u . n the contact normal's share of the axis' direction u,
    ``a + s (b - a) = p - r n`` puts a ball that touches at p on the axis. It touches where the capsule does, if v = 0
    within the axis, v >= 0 at b and v <= 0 at a: ``(1 - s) max(v, 0) = 0`` and ``s max(-v, 0) = 0``. The program has
    ``(1 - s) v <= e`` and ``-s v <= e`` with e = 1e-4, which are smooth and have interior points; p is then inside the
    capsule by at most e times the axis' length (docs/hands.md).

    Parameters
    ----------
    radius : float
        Metres, greater than zero.
    start, end : (3,) array
        Centres of the round ends, metres, link frame; searches begin at ``end``, the finger's.
    """

    kind: ClassVar[str] = "capsule"

    @property
    def centre(self) -> FloatArray:
        """Centre of the distal round end, (3,), metres, link frame: the usual place of contact."""
        return np.array(self.end, dtype=float)

    @property
    def first_slide(self) -> float:
        """Initial sliding coordinate 1: the distal end."""
        return 1.0

    def surface(self, sides: int = FINE) -> Triangles:
        """Return side and both round ends as triangles."""
        start, end = self.ends
        along = (end - start) / np.linalg.norm(end - start)
        caps = [(start, dome(-along, 0.5 * np.pi, sides)), (end, dome(along, 0.5 * np.pi, sides))]
        parts = [tube(self.radius, start, end, sides)]
        parts += [Triangles(centre + self.radius * cap.vertices, cap.faces) for centre, cap in caps]
        first = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
        faces = [part.faces + number for part, number in zip(parts, first, strict=True)]
        return Triangles(np.concatenate([part.vertices for part in parts]), np.concatenate(faces))

    def most_radius(self, centres: FloatArray) -> FloatArray:
        """Return the largest radii of spheres about points (m, 3) within the capsule's own radius, (m,), metres.

        Behind the start, the finger may continue as thick as the capsule.
        """
        a, b = self.ends
        t = np.minimum((centres - a) @ (b - a) / np.sum((b - a) ** 2), 1.0)
        off = np.linalg.norm(centres - a - t[:, None] * (b - a), axis=1)
        return np.asarray(np.maximum(self.radius - off - SLACK, 0.0))

    def rows(self, touch: Touch) -> list[Row]:
        """Return ``a + s (b - a) = p - r n``, and that n tilts beyond the side only at the ends."""
        a, b = self.ends
        along = ca.mtimes(touch.pose[:3, :3], ca.DM((b - a) / np.linalg.norm(b - a)))
        leans = ca.dot(along, touch.n)
        return [
            *equal(touch, self.ball_centre(touch.pose, touch.slide), touch.p - self.radius * touch.n),
            touch.row("over the end", (1.0 - touch.slide) * leans, -np.inf, ROUNDING),
            touch.row("over the start", -touch.slide * leans, -np.inf, ROUNDING),
        ]
