"""Clearances of a hand's link spheres from body, obstacles and each other, with bounds between postures.

Links and round fingertips are covered by balls, whose centres are fixed to their links. While the joints go from q to
q + d on a straight line, parameter t from 0 to 1, a turning joint j moves a centre with a speed of at most
``|d_j| R_j``, where R_j is the most that the centre can be away from the joint's axis: the lengths of all links between
them, with what sliding joints add, and the centre's own distance from its link's origin (triangle inequality). A
sliding joint moves it with ``|d_j|``. The centre's way is then at most ``sum_j |d_j| R_j``, in whatever posture the
hand is.

The distance to a thing changes by no more than a ball's centre moves. Where a ball has the clearances a and b in two
postures, and its centre moves along a way of length l from one to the other, then after a part s of the way the
clearance is at least ``max(a - s, b - (l - s)) >= (a + b - l) / 2``. Two balls that are kept apart count with the sum
of their ways. So nothing is jumped over, however thin it is: to get past a plate a ball's centre must be in it, and
the bound is then below the ball's radius below zero. A step is made smaller until the bound says that no ball is
deeper in anything than a tolerance; where both ends are clear, any step with ``l`` up to twice the tolerance does.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.hands.link_spheres import SphereFit
from nlpgrasp.hands.self_collision import watched_links
from nlpgrasp.motion.distance_fields import fields_of
from nlpgrasp.problem.problem import GraspProblem

TOLERANCE = 1e-3  # of the hand's span: tolerated penetration of a sphere
TIP_SHARE = 0.2  # of its radius: tolerated penetration of a round tip in the body it touches, as in the program
IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]


class CollisionModel:
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
        self.hand, self.balls = hand, LinkSphereModel(hand)
        self.fields = fields_of(problem.body, problem.constraints, hand.count)
        self.tolerance = TOLERANCE * hand.tree.span
        self.seen = np.arange(len(self.balls.radii))
        self.pairs, self.apart = self.balls.pairs, self.balls.apart

    def of_joints(self, joints: IntArray) -> CollisionModel:
        """Return the model restricted to the spheres that some of the free joints move."""
        result = copy(self)
        moves = np.any(self.balls.reach[:, joints] > 0.0, axis=1)
        result.seen = np.flatnonzero(moves)
        moved = np.any(moves[self.balls.pairs], axis=1)
        result.pairs, result.apart = self.balls.pairs[moved], self.balls.apart[moved]
        return result

    def of_palm(self) -> CollisionModel:
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

    def clearance_change_bounds(self, before: Values, after: Values) -> FloatArray:
        """Return bounds on the change of each clearance between two postures, (n,), metres."""
        ways = self.balls.path_length_bounds(before, after)
        shift = float(np.linalg.norm(after["palm_position"] - before["palm_position"]))
        i, j = self.pairs.T
        return np.concatenate([*[ways[self.seen]] * len(self.fields), ways[i] + ways[j] - 2.0 * shift])

    def between(self, before: Values, after: Values, ends: tuple[FloatArray, FloatArray]) -> FloatArray:
        """Return a lower bound on each clearance between two postures, whose clearances are ``ends``."""
        a, b = ends
        return np.asarray((a + b - self.clearance_change_bounds(before, after)) / 2.0)

    def of_tips(self) -> BoolArray:
        """Return the mask of clearances between fingertips and body, (n,)."""
        rest = (len(self.fields) - 1) * len(self.seen) + len(self.pairs)
        return np.concatenate([self.balls.fingers[self.seen] >= 0, np.zeros(rest, bool)])

    def least_clearances(self) -> FloatArray:
        """Return the least admissible clearances, (n,), metres: of fingertips from the body as in the program."""
        least = np.zeros(len(self.fields) * len(self.seen) + len(self.pairs))
        tips = self.balls.fingers[self.seen] >= 0
        least[: len(tips)] = np.where(tips, -TIP_SHARE * self.balls.radii[self.seen], 0.0)
        return least

    def is_of_pair(self) -> BoolArray:
        """Return the mask of clearances between two spheres of the hand, (n,)."""
        things = len(self.fields) * len(self.seen)
        return np.arange(things + len(self.pairs)) >= things

    def describe_clearance(self, index: int) -> str:
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


class LinkSphereModel:
    """Spheres around the links, those of round fingertips last.

    Parameters
    ----------
    hand : URDFHand

    Attributes
    ----------
    links : tuple of str
        The link of each ball.
    radii : (s,) array
        Metres.
    fingers : (s,) int array
        Whose fingertip a ball is; -1 for balls of links.
    """

    def __init__(self, hand: URDFHand) -> None:
        self.hand = hand
        links, centres, radii, fingers = list[str](), list[FloatArray](), list[float](), list[int]()
        for link, fit in hand.fits.items():
            links += [link] * len(fit.radii)
            centres += list(fit.centres)
            radii += fit.radii.tolist()
            fingers += [-1] * len(fit.radii)
        for finger, (link, tip) in enumerate(hand.tips):
            if tip.standoff > 0.0:
                links.append(link)
                centres.append(tip.centre)
                radii.append(tip.standoff)
                fingers.append(finger)
        self.links, self.radii, self.fingers = tuple(links), np.array(radii), np.array(fingers, int)
        self._centres = np.array(centres).reshape(-1, 3)
        self._where = [hand.tree.used_links.index(link) for link in links]
        self._sliding = np.array([f >= 0 and hand.tips[f][1].slides for f in fingers], bool)

    def places(self, values: Values) -> FloatArray:
        """Return the sphere centres (s, 3), metres, body frame, for values of the hand's variables."""
        tree = self.hand.tree
        base = tree.palm_frame(values)
        frames = np.asarray(tree.link_function(values["joints"]).full()).reshape(4, -1, 4)[:3, self._where]  # (3, s, 4)
        in_palm = np.einsum("isj,sj->si", frames[..., :3], self._link_frame_centres(values)) + frames[..., 3].T
        return np.asarray(in_palm @ base[:3, :3].T + base[:3, 3])

    def _link_frame_centres(self, values: Values) -> FloatArray:
        """Return the centres in their links' frames; a sliding tip contact's depends on the hand's variables."""
        if "slides" not in values:
            return self._centres
        result, slides = self._centres.copy(), iter(values["slides"])
        for finger, (_, tip) in enumerate(self.hand.tips):
            if tip.slides:
                result[self.fingers == finger] = np.asarray(tip.ball_centre(np.eye(4), next(slides))).ravel()
        return result

    @cached_property
    def reach(self) -> FloatArray:
        """Bound on each sphere's motion per unit of each free joint, (s, joints), metres."""
        robot = self.hand.robot
        index = {joint.name: i for i, joint in enumerate(robot.free_joints)}
        result = np.zeros((len(self.links), len(index)))
        for s, link in enumerate(self.links):
            length = float(np.linalg.norm(self._centres[s])) + (self.hand.tree.span if self._sliding[s] else 0.0)
            for joint in reversed(robot.chain(link)):
                if joint.moves:
                    driver, multiplier, _ = robot.driving_joint(joint)
                    result[s, index[driver]] += abs(multiplier) * (length if joint.is_revolute else 1.0)
                    length += 0.0 if joint.is_revolute else max(abs(joint.lower), abs(joint.upper))
                length += float(np.linalg.norm(joint.xyz))
        return result

    def path_length_bounds(self, before: Values, after: Values) -> FloatArray:
        """Return a bound on each centre's path length, (s,), metres, along a straight joint path between postures.

        The palm may move along, but not turn.
        """
        shift = float(np.linalg.norm(after["palm_position"] - before["palm_position"]))
        turned = np.abs(after["joints"] - before["joints"])
        slid = float(np.max(np.abs(after["slides"] - before["slides"]))) if "slides" in after else 0.0
        return np.asarray(self.reach @ turned + shift + self._sliding * slid * self.hand.tree.span)

    @property
    def pairs(self) -> IntArray:
        """Pairs of spheres checked for self-collision, (m, 2): of links that no single joint connects."""
        return self._self_collision_pairs[0]

    @property
    def apart(self) -> FloatArray:
        """Least centre distance of each pair, (m,), metres."""
        return self._self_collision_pairs[1]

    @cached_property
    def _self_collision_pairs(self) -> tuple[IntArray, FloatArray]:
        """Return the pairs of spheres checked for self-collision, (m, 2), and their least centre distances, (m,)."""
        numbers = {link: np.flatnonzero([name == link for name in self.links]) for link in dict.fromkeys(self.links)}
        fits = {link: SphereFit(self._centres[own], self.radii[own], 0.0) for link, own in numbers.items()}
        pairs, overlaps = [np.zeros((0, 2), int)], [np.zeros(0)]
        for both in watched_links(self.hand.tree, fits) if self.hand.self_collision else ():
            a, b = (numbers[link] for link in both.links)
            pairs.append(np.stack(np.meshgrid(a, b, indexing="ij"), axis=-1).reshape(-1, 2))
            overlaps.append(np.full(len(pairs[-1]), both.overlap))
        every = np.concatenate(pairs)
        return every, self.radii[every].sum(axis=1) - np.concatenate(overlaps)
