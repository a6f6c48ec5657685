"""Spheres covering a hand's links: centres by forward kinematics, and bounds on their motion.

A ball's centre is fixed to its link. While the joints go from q to q + d on a straight line, parameter t from 0 to 1,
a turning joint j moves the centre with a speed of at most ``|d_j| R_j``, where R_j is the most that the centre can be
away from the joint's axis: the lengths of all links between them, with what sliding joints add, and the centre's own
distance from its link's origin (triangle inequality). A sliding joint moves it with ``|d_j|``. The centre's way is then
at most ``sum_j |d_j| R_j``, in whatever posture the hand is.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.hands.spheres.link_spheres import SphereFit
from nlpgrasp.hands.spheres.self_collision import watched_links

IntArray = NDArray[np.intp]


class LinkBalls:
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
        in_palm = np.einsum("isj,sj->si", frames[..., :3], self._own_centres(values)) + frames[..., 3].T
        return np.asarray(in_palm @ base[:3, :3].T + base[:3, 3])

    def _own_centres(self, values: Values) -> FloatArray:
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
                    driver, multiplier, _ = robot.follows(joint)
                    result[s, index[driver]] += abs(multiplier) * (length if joint.turns else 1.0)
                    length += 0.0 if joint.turns else max(abs(joint.lower), abs(joint.upper))
                length += float(np.linalg.norm(joint.xyz))
        return result

    def swept(self, before: Values, after: Values) -> FloatArray:
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
        return self._watched[0]

    @property
    def apart(self) -> FloatArray:
        """Least centre distance of each pair, (m,), metres."""
        return self._watched[1]

    @cached_property
    def _watched(self) -> tuple[IntArray, FloatArray]:
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
