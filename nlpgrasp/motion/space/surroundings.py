"""Clearances of a hand from body, obstacles and itself, with bounds between two postures.

The distance to a thing changes by no more than a ball's centre moves. Where a ball has the clearances a and b in two
postures, and its centre moves along a way of length l from one to the other, then after a part s of the way the
clearance is at least ``max(a - s, b - (l - s)) >= (a + b - l) / 2``. Two balls that are kept apart count with the sum
of their ways. So nothing is jumped over, however thin it is: to get past a plate a ball's centre must be in it, and
the bound is then below the ball's radius below zero. A step is made smaller until the bound says that no ball is
deeper in anything than a tolerance; where both ends are clear, any step with ``l`` up to twice the tolerance does.
"""

from __future__ import annotations

from copy import copy

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.space.link_balls import LinkBalls
from nlpgrasp.problem.fields import fields_of
from nlpgrasp.problem.problem import GraspProblem

IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]
TOLERANCE = 1e-3  # of the hand's span: tolerated penetration of a sphere
TIP_SHARE = 0.2  # of its radius: tolerated penetration of a round tip in the body it touches, as in the program


class Surroundings:
    """Collision model of a hand among the body, the obstacles of its constraints, and its own links.

    Clearances are one array: those of each ball from each thing, one thing after another, then those of pairs of balls.

    Parameters
    ----------
    problem : GraspProblem
        With a URDF hand; its constraints that speak of links, such as tables and obstacles, are in the way.
    hand : URDFHand

    Attributes
    ----------
    tolerance : float
        Metres.
    seen : (m,) int array
        The balls whose clearances from things are looked at: all.
    pairs : (r, 2) int array
        The pairs of balls that are looked at.
    apart : (r,) array
        The least distance of their centres, metres.
    """

    def __init__(self, problem: GraspProblem, hand: URDFHand) -> None:
        self.hand, self.balls = hand, LinkBalls(hand)
        self.fields = fields_of(problem.body, problem.constraints, hand.count)
        self.tolerance = TOLERANCE * hand.tree.span
        self.seen = np.arange(len(self.balls.radii))
        self.pairs, self.apart = self.balls.pairs, self.balls.apart

    def of_joints(self, joints: IntArray) -> Surroundings:
        """Return the model restricted to the spheres that some of the free joints move."""
        result = copy(self)
        moves = np.any(self.balls.reach[:, joints] > 0.0, axis=1)
        result.seen = np.flatnonzero(moves)
        moved = np.any(moves[self.balls.pairs], axis=1)
        result.pairs, result.apart = self.balls.pairs[moved], self.balls.apart[moved]
        return result

    def of_palm(self) -> Surroundings:
        """Return the model without self-collision, for motions of the palm alone."""
        result = copy(self)
        result.pairs, result.apart = self.pairs[:0], self.apart[:0]
        return result

    def clearances(self, values: Values) -> FloatArray:
        """Return all clearances, (n,), metres."""
        places, radii = self.balls.places(values), self.balls.radii
        if not len(self.seen):
            return np.zeros(0)
        found = [field.distance(places[self.seen]) - radii[self.seen] for field in self.fields]
        found[0] -= np.where(self.balls.fingers[self.seen] < 0, self.hand.clearance, 0.0)
        i, j = self.pairs.T
        return np.concatenate([*found, np.linalg.norm(places[i] - places[j], axis=1) - self.apart])

    def swept(self, before: Values, after: Values) -> FloatArray:
        """Return bounds on the change of each clearance between two postures, (n,), metres."""
        ways = self.balls.swept(before, after)
        shift = float(np.linalg.norm(after["palm_position"] - before["palm_position"]))
        i, j = self.pairs.T
        return np.concatenate([*[ways[self.seen]] * len(self.fields), ways[i] + ways[j] - 2.0 * shift])

    def between(self, before: Values, after: Values, ends: tuple[FloatArray, FloatArray]) -> FloatArray:
        """Return a lower bound on each clearance between two postures, whose clearances are ``ends``."""
        a, b = ends
        return np.asarray((a + b - self.swept(before, after)) / 2.0)

    def of_tips(self) -> BoolArray:
        """Return the mask of clearances between fingertips and body, (n,)."""
        rest = (len(self.fields) - 1) * len(self.seen) + len(self.pairs)
        return np.concatenate([self.balls.fingers[self.seen] >= 0, np.zeros(rest, bool)])

    def allowed(self) -> FloatArray:
        """Return the least admissible clearances, (n,), metres: of fingertips from the body as in the program."""
        least = np.zeros(len(self.fields) * len(self.seen) + len(self.pairs))
        tips = self.balls.fingers[self.seen] >= 0
        least[: len(tips)] = np.where(tips, -TIP_SHARE * self.balls.radii[self.seen], 0.0)
        return least

    def of_pairs(self) -> BoolArray:
        """Return the mask of clearances between two spheres of the hand, (n,)."""
        things = len(self.fields) * len(self.seen)
        return np.arange(things + len(self.pairs)) >= things

    def say(self, index: int) -> str:
        """Return the names of the sphere and the obstacle of a clearance, as text."""
        count = len(self.seen)
        if index < len(self.fields) * count:
            which, ball = divmod(index, count)
            return f"{self._ball(int(self.seen[ball]))} against {self.fields[which].name}"
        i, j = self.pairs[index - len(self.fields) * count]
        return f"{self._ball(int(i))} against {self._ball(int(j))}"

    def moved_by(self, index: int) -> BoolArray:
        """Return the mask of free joints that move a sphere of a clearance, (m,)."""
        count = len(self.seen)
        things = len(self.fields) * count
        balls = [self.seen[index % count]] if index < things else self.pairs[index - things]
        return np.asarray(np.any(self.balls.reach[balls] > 0.0, axis=0))

    def _ball(self, ball: int) -> str:
        tip = self.balls.fingers[ball] >= 0
        return f"fingertip {self.balls.links[ball]}" if tip else f"link {self.balls.links[ball]}"
