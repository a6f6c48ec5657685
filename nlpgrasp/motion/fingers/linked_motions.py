"""Finger motions of a URDF hand from the posture of its grasp, one finger at a time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.finger_path import FingerPath
from nlpgrasp.motion.fingers.finger_joints import FingerJoints
from nlpgrasp.motion.fingers.walk import Walk
from nlpgrasp.motion.paths.footpath import Footpath, Station
from nlpgrasp.motion.paths.strides import SLIDING, Foothold, Stride
from nlpgrasp.motion.space import Surroundings
from nlpgrasp.problem.problem import GraspProblem

SLIDES = np.linspace(0.0, 1.0, 201)  # candidate sliding coordinates, which a solution does not state


class LinkedMotions:
    """Finger motions of a URDF hand.

    Parameters
    ----------
    problem : GraspProblem
        Problem with the constraints to keep.
    hand : URDFHand
    values : dict
        Of the hand's variables in the first grasp.
    paths : sequence of k sequences of Station
        Path of each finger from its contact to its new one.
    lift : float
        Height of a lifted finger above the surface, metres.
    """

    def __init__(
        self, problem: GraspProblem, hand: URDFHand, values: Values, paths: Sequence[Sequence[Station]], lift: float
    ) -> None:
        self.body, self.hand, self.paths, self.lift = problem.body, hand, paths, lift
        self.around = Surroundings(problem, hand)
        self.fingers = [FingerJoints(hand, i, self.around, problem.body.size) for i in range(hand.count)]
        self._first = self._with_slides(values)
        self._footpaths: dict[tuple[int, float], Footpath] = {}

    def start(self) -> Values:
        """Return the values of the hand's variables in the first grasp."""
        return self._first

    def taken(self, posture: Values, finger: int, slides: bool) -> tuple[FingerPath, Values]:
        """Return the path of a finger from a posture to its new contact, and the final posture."""
        lift = 0.0 if slides else self.lift
        if (finger, lift) not in self._footpaths:
            arm = self.hand.tips[finger][1].standoff + lift
            self._footpaths[finger, lift] = Footpath(self.body, self.paths[finger], arm, self.around.tolerance)
        return Walk(self.fingers[finger], Stride(self._footpaths[finger, lift], lift)).taken(posture)

    def _with_slides(self, values: Values) -> Values:
        """Return the values with the sliding coordinates of tips nearest to their contacts."""
        count = sum(tip.slides for _, tip in self.hand.tips)
        if not count:
            return values
        result = {**values, "slides": np.full(count, 0.5)}
        for joints, path in zip(self.fingers, self.paths, strict=True):
            if joints.slide is not None:
                hold = Foothold(path[0].point, path[0].normal, 0.0, SLIDING)
                off = []
                for share in SLIDES:
                    result["slides"][joints.slide] = share
                    off.append(joints.off(result, hold))
                result["slides"][joints.slide] = SLIDES[int(np.argmin(off))]
        return result
