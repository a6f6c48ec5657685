"""Quality measures of given grasps with certified bounds, independent of CasADi."""

from nlpgrasp.quality.bounds import Bounds, StackBounds
from nlpgrasp.quality.force_problem import FingerForces, finger_forces
from nlpgrasp.quality.measures import delta, equivalence_constants, mu, mu_1, mu_tilde, support
from nlpgrasp.quality.other_measures import (
    ferrari_canny,
    isotropy,
    min_weight,
    pyramid_volume,
    pyramid_wrenches,
    smallest_singular_value,
)
from nlpgrasp.quality.own_measures import GraspMeasure, register_measure
from nlpgrasp.quality.screening import screen
from nlpgrasp.quality.stability import Stability, allowed_twists, is_stable
from nlpgrasp.quality.volume import Volume, nu
from nlpgrasp.quality.wrench_set import WrenchSet

__all__ = [
    "Bounds",
    "FingerForces",
    "GraspMeasure",
    "Stability",
    "StackBounds",
    "Volume",
    "WrenchSet",
    "allowed_twists",
    "delta",
    "equivalence_constants",
    "ferrari_canny",
    "finger_forces",
    "is_stable",
    "isotropy",
    "min_weight",
    "mu",
    "mu_1",
    "mu_tilde",
    "nu",
    "pyramid_volume",
    "pyramid_wrenches",
    "register_measure",
    "screen",
    "smallest_singular_value",
    "support",
]
