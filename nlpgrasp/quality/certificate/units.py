"""Scaling of torques to units of force."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.grasp.stack import GraspStack


def over_length(grasp: Grasp | GraspStack, torque_scale: float) -> FloatArray:
    """Return factors (d,) for wrench components that give torques as ``torque / torque_scale``."""
    scale = number("torque_scale", torque_scale, above=0.0)
    return np.array([1.0] * grasp.space + [1.0 / scale] * (grasp.dimension - grasp.space))
