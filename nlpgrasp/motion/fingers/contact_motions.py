"""Finger motions of hands without links: free fingertips and parallel jaws.

Such a hand constrains its contacts jointly. Its constraints are evaluated at waypoints ``STEP`` apart: between two, no
distance of two contacts or from an obstacle differs by more than half of it from those at both ends. The palm point may
move: any point that all fingertips reach is allowed, and the set of these points is convex and changes continuously
with the fingertips, so that the palm can follow.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import casadi as ca
import numpy as np

from nlpgrasp.common.rows import Placement, Row
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.base import Hand
from nlpgrasp.motion.finger_path import FingerPath
from nlpgrasp.motion.fingers.smallest_ball import smallest_ball
from nlpgrasp.motion.fingers.stopped import place
from nlpgrasp.motion.paths.footpath import Footpath, Station
from nlpgrasp.motion.paths.strides import Foothold, Stride
from nlpgrasp.problem.fields import fields_of
from nlpgrasp.problem.problem import GraspProblem

STEP = 5e-3  # distance of waypoints, as a share of the body's size
ENOUGH = 1e-6  # feasibility tolerance, relative to the constraint's scale
PALM = "palm"

Contacts = tuple[FloatArray, FloatArray]  # points and inward unit normals


class ContactMotions:
    """Finger motions of hands that are given by their contacts alone; arguments as for ``LinkedMotions``."""

    def __init__(
        self, problem: GraspProblem, hand: Hand, contacts: Contacts, paths: Sequence[Sequence[Station]], lift: float
    ) -> None:
        self.body, self.hand, self.paths, self.lift, self._first = problem.body, hand, paths, lift, contacts
        self.fields = fields_of(problem.body, problem.constraints, hand.count)[1:]
        size, space, k = problem.body.size, problem.body.space, hand.count
        p, n = ([ca.SX.sym(f"{name}{i}", space) for i in range(k)] for name in "pn")
        variables = hand.symbols(problem.body.bounds)
        self.rows = list(hand.rows(Placement(p, n, hand.tip_radii, size), variables))
        inputs = [ca.horzcat(*p), ca.horzcat(*n), ca.vertcat(ca.SX(0, 1), *variables.values())]
        self._values = ca.Function("rows", inputs, [ca.vertcat(ca.SX(0, 1), *[row.expression for row in self.rows])])
        self.variables = tuple(variables)

    def start(self) -> Contacts:
        """Return points and normals of the first grasp."""
        return self._first

    def taken(self, posture: Contacts, finger: int, slides: bool) -> tuple[FingerPath, Contacts]:
        """Return the path of a finger to its new contact, and all contacts at its end."""
        lift, step = 0.0 if slides else self.lift, STEP * self.body.size
        radius = self.hand.tip_radii[finger]
        stride = Stride(Footpath(self.body, self.paths[finger], radius + lift, step), lift)
        edges = np.unique([0.0, *stride.turns])
        counts = [max(int(np.ceil((b - a) / step)), 1) for a, b in itertools.pairwise(edges)]
        ways = [np.linspace(a, b, c + 1)[1:] for a, b, c in zip(edges[:-1], edges[1:], counts, strict=True)]
        holds, clearances, reason = list[Foothold](), list[float](), ""
        for way in np.concatenate([[0.0], *ways]):
            hold = stride.at(float(way))
            clear, reason = self._broken(posture, finger, hold)
            if reason:
                reason = f"{reason}, {place(hold)}"
                break
            holds.append(hold)
            clearances.append(clear)
        points = np.array([h.point for h in holds]).reshape(len(holds), -1)
        along, phases = np.array([h.along for h in holds]), tuple(h.phase for h in holds)
        stopped = (holds[-1].along if holds else 0.0) if reason else None
        path = FingerPath(
            not reason, reason, points, along, phases, np.array(clearances), stopped_at=stopped, tolerance=step / 2.0
        )
        return path, posture if reason else self._with(posture, finger, hold)

    def _with(self, posture: Contacts, finger: int, hold: Foothold) -> Contacts:
        """Return the contacts with one finger at a foothold."""
        points, normals = (part.copy() for part in posture)
        points[finger], normals[finger] = hold.point, hold.normal
        return points, normals

    def _broken(self, posture: Contacts, finger: int, hold: Foothold) -> tuple[float, str]:
        """Return the fingertip's clearance, and the violated constraint at a foothold, as text."""
        points, normals = self._with(posture, finger, hold)
        radii = np.asarray(self.hand.tip_radii)
        tips = points - radii[:, None] * normals
        clearances = [float(field.distance(tips[finger][None])[0] - radii[finger]) for field in self.fields]
        for field, clear in zip(self.fields, clearances, strict=True):
            if clear < -ENOUGH * self.body.size:
                return clear, f"fingertip {finger} against {field.name}"
        values = np.asarray(self._values(points.T, normals.T, self._own(tips)).full()).ravel()
        for row, value in zip(self.rows, values, strict=True):
            if max(row.lower - value, value - row.upper) > ENOUGH * row.scale:
                return min(clearances, default=np.inf), _said(row, float(value))
        return min(clearances, default=np.inf), ""

    def _own(self, tips: FloatArray) -> FloatArray:
        """Return the hand's own variables for fingertip centres (k, space): the centre of their smallest ball."""
        if self.variables == (PALM,):
            return smallest_ball(tips)[0]
        start = self.hand.start(tips)
        return np.concatenate([np.zeros(0), *[start[name] for name in self.variables]])


def _said(row: Row, value: float) -> str:
    """Return the violation of a constraint, as text."""
    low = value < row.lower
    limit, side = (row.lower, "at least") if low else (row.upper, "at most")
    if row.unit == "m2":
        return f"{row.name} would be {1e3 * np.sqrt(value):.1f} mm, {side} {1e3 * np.sqrt(limit):.1f} mm"
    return f"{row.name} would be {value:.4g}, {side} {limit:.4g}"
