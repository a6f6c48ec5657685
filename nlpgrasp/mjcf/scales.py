"""Characteristic units of a scene's dynamics: length, force, mass and time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.grasp.grasp import Grasp

STIFFNESS, DAMPING = 20.0, 1.0  # of a fingertip, in characteristic units


@dataclass(frozen=True)
class Scales:
    """Characteristic units of a grasp's dynamics, from which time step and stiffness follow at any size.

    Parameters
    ----------
    length : float
        Root mean square distance of the contacts from their mean, metres.
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
        """Characteristic time, seconds: that in which the force moves the object by the length."""
        return float(np.sqrt(self.mass * self.length / self.force))

    @property
    def stiffness(self) -> float:
        """Stiffness of a fingertip that is held in place, N / m."""
        return STIFFNESS * self.force / self.length

    @property
    def damping(self) -> float:
        """Near-critical damping of a fingertip, N s / m."""
        return DAMPING * float(np.sqrt(STIFFNESS)) * self.mass / self.time


def scales(grasp: Grasp, force: float, mass: float) -> Scales:
    """Return the characteristic units of a grasp."""
    spread = float(np.sqrt(np.mean(np.sum((grasp.points - grasp.points.mean(axis=0)) ** 2, axis=1))))
    return Scales(spread or grasp.mean_arm, force, mass)
