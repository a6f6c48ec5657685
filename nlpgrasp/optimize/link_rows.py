"""Clearances of a hand's links as inequalities of the program, linearised in the hand's variables at a posture.

Points of links stay outside body and surroundings, points of the body outside links, pairs of parts stay apart. All
are distances of the shapes themselves; the program holds value and gradient of each at the posture where a step begins,
as its parameters.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.common.spatial import cross_matrix
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.clearance import HandClearance

ROWS = 40  # inequalities of the program


@dataclass(frozen=True)
class LinkPoint:
    """Point of a link's surface that is kept outside a solid.

    Parameters
    ----------
    link : str
    position : tuple of three floats
        Metres, link frame.
    field : int
        Number of the solid among the fields of a ``HandClearance``.
    """

    link: str
    position: tuple[float, float, float]
    field: int = 0


@dataclass(frozen=True)
class BodyPoint:
    """Point of the body, as of an edge, that is kept outside a link's part.

    Parameters
    ----------
    part : int
        Number of the part in ``HandClearance.parts``.
    position : tuple of three floats
        Metres, body frame.
    """

    part: int
    position: tuple[float, float, float]


@dataclass(frozen=True)
class LinkRows:
    """Points of links, points of the body and pairs of parts whose clearances a program holds.

    Parameters
    ----------
    clearance : HandClearance
    points : tuple of LinkPoint
    pairs : tuple of int
        Indices of ``clearance.pairs``.
    body_points : tuple of BodyPoint
    """

    clearance: HandClearance
    points: tuple[LinkPoint, ...] = ()
    pairs: tuple[int, ...] = ()
    body_points: tuple[BodyPoint, ...] = ()

    def with_more(self, more: LinkRows) -> LinkRows:
        """Return the rows with further ones, which come first."""
        return replace(
            self,
            points=tuple(dict.fromkeys((*more.points, *self.points))),
            pairs=tuple(dict.fromkeys((*more.pairs, *self.pairs))),
            body_points=tuple(dict.fromkeys((*more.body_points, *self.body_points))),
        )

    def parameters(self, values: Values) -> FloatArray:
        """Return the program's parameters (q,) at values of the hand's variables.

        Of each of ``ROWS`` inequalities ``a . q + b >= 0`` on palm position, palm quaternion and joints q, metres, the
        gradient a, all first components first, then b. Rows without a distance have ``b = 1``.
        """
        slopes, offsets = np.zeros((ROWS, 7 + self.clearance.hand.tree.joint_limits.shape[1])), np.ones(ROWS)
        value, by_twist = self.rows(values)
        chosen = self.held(value)
        w, v = values["palm_quaternion"][0], values["palm_quaternion"][1:]
        # the turn of a change of the quaternion: twice the vector part of its product with the inverse
        turn = 2.0 * np.column_stack([-v, w * np.eye(3) + cross_matrix(v)])
        slopes[: len(chosen)] = np.column_stack(
            [by_twist[chosen, :3], by_twist[chosen, 3:6] @ turn, by_twist[chosen, 6:]]
        )
        q = np.concatenate([values["palm_position"], values["palm_quaternion"], values["joints"]])
        offsets[: len(chosen)] = value[chosen] - slopes[: len(chosen)] @ q
        return np.concatenate([slopes.T.ravel(), offsets])

    def held(self, clearances: FloatArray) -> IntArray:
        """Return which of all clearances (r,) the program holds, in its order: the ``ROWS`` least ones."""
        return np.argsort(clearances, kind="stable")[:ROWS]

    def rows(self, values: Values) -> tuple[FloatArray, FloatArray]:
        """Return the clearances (r,), metres, less those required, and their derivatives by the twist (r, 6 + m).

        The twist is about the palm's origin.
        """
        model, moving = self.clearance, self.clearance.moving_frames(values)
        links, hand = moving.links, model.hand
        result, slopes = [np.zeros(0)], [np.zeros((0, links.size))]
        for number in range(len(model.fields)):
            points = [point for point in self.points if point.field == number]
            if points:
                names, distance = [point.link for point in points], model.exact_distance(number)
                x = moving.points(*links.in_groups(names, np.array([point.position for point in points])))[0]
                beyond = 2e-4 if number else 0.0  # as points of the surface stand for it
                result.append(distance(x) - [max(hand.least_clearance(name), beyond) for name in names])
                slopes.append(model.point_slopes(distance, x, names, moving))
        if self.body_points:
            parts = np.array([point.part for point in self.body_points])
            value, by_twist = model.body_point_rows(parts, [point.position for point in self.body_points], moving)
            result.append(value - [hand.least_clearance(model.parts.parts[i].link) for i in parts])
            slopes.append(by_twist)
        if self.pairs:
            _, value, by_twist = model.pair_rows(values, model.pairs[list(self.pairs)], 0.05)
            result.append(value)
            slopes.append(by_twist)
        return np.concatenate(result), np.concatenate(slopes)
