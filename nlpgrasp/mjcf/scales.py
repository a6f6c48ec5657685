"""The units that make a grasp's dynamics the same at any size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.grasp.grasp import Grasp

STIFFNESS, DAMPING = 20.0, 1.0  # of a fingertip, in these units


@dataclass(frozen=True)
class Scales:
    """The units that make a grasp's dynamics the same at any size: time steps and stiffnesses follow from them.

    Parameters
    ----------
    length : float
        Root mean square distance of the contacts from their middle, metres.
    force : float
        Newtons.
    mass : float
        Of the object, kilograms.
    """

    length: float
    force: float
    mass: float

    @property
    def time(self) -> float:
        """Seconds in which the force moves the object by the length."""
        return float(np.sqrt(self.mass * self.length / self.force))

    @property
    def stiffness(self) -> float:
        """Of a fingertip that is held in place, N / m."""
        return STIFFNESS * self.force / self.length

    @property
    def damping(self) -> float:
        """Of a fingertip, N s / m: near critical."""
        return DAMPING * float(np.sqrt(STIFFNESS)) * self.mass / self.time


def scales(grasp: Grasp, force: float, mass: float) -> Scales:
    """Return the units of a grasp."""
    spread = float(np.sqrt(np.mean(np.sum((grasp.points - grasp.points.mean(axis=0)) ** 2, axis=1))))
    return Scales(spread or grasp.mean_arm, force, mass)
