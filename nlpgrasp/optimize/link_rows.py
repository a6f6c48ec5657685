"""Clearances of a hand's links as inequalities of the program, linearised in the hand's variables at a posture.

Points of links stay outside body and surroundings, pairs of parts stay apart. All are distances of the shapes
themselves; the program holds value and gradient of each at the posture where a step begins, as its parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
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
class LinkRows:
    """Points of links and pairs of parts whose clearances a program holds.

    Parameters
    ----------
    clearance : HandClearance
    points : tuple of LinkPoint
    pairs : tuple of int
        Indices of ``clearance.pairs``.
    """

    clearance: HandClearance
    points: tuple[LinkPoint, ...] = ()
    pairs: tuple[int, ...] = ()

    def with_more(self, points: Sequence[LinkPoint], pairs: Sequence[int]) -> LinkRows:
        """Return the rows with further points and pairs, which come first."""
        joined = tuple(dict.fromkeys((*points, *self.points))), tuple(dict.fromkeys((*pairs, *self.pairs)))
        return replace(self, points=joined[0], pairs=joined[1])

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
        model, frames = self.clearance, self.clearance.moving_frames(values)
        links, hand = frames.links, self.clearance.hand
        result, slopes = list[FloatArray](), list[FloatArray]()

        def by_twist(x: FloatArray, links_of_x: Sequence[str], n: FloatArray) -> FloatArray:
            groups = np.array([links.group[link] for link in links_of_x], int)
            return frames.rows(x, groups, n, frames.t[:, 0], np.zeros(len(x), int))

        for number in range(len(model.fields)):
            points = [point for point in self.points if point.field == number]
            names = [point.link for point in points]
            if points:
                poses = np.array([links.pose[name] for name in names])
                local = np.array([point.position for point in points])
                groups = np.array([links.group[name] for name in names], int)
                at = (poses[:, :3, :3] @ local[:, :, None])[..., 0] + poses[:, :3, 3]
                x = frames.points(at, groups)[0]
                distance = model.exact_distance(number)
                step = 1e-6 * np.concatenate([np.eye(3), -np.eye(3)])
                ahead, behind = distance((x + step[:, None]).reshape(-1, 3)).reshape(2, 3, -1)
                beyond = 2e-4 if number else 0.0  # as points of the surface stand for it
                result.append(distance(x) - [max(hand.least_clearance(name), beyond) for name in names])
                slopes.append(by_twist(x, names, (ahead - behind).T / 2e-6))
        if self.pairs:
            pairs = model.pairs[list(self.pairs)]
            _, index, value, ends, n = model.parts.near_pairs(model.parts.frames(values)[None], pairs, 0.05)
            sides = [
                by_twist(ends[:, i], [model.parts.parts[part].link for part in pairs[index, i]], n) for i in range(2)
            ]
            result.append(value)
            slopes.append(sides[1] - sides[0])
        return np.concatenate([np.zeros(0), *result]), np.concatenate([np.zeros((0, links.size)), *slopes])
