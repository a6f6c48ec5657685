"""Quality measures of given grasps with certified bounds, independent of CasADi."""

from nlpgrasp.quality.bounds import Bounds, StackBounds
from nlpgrasp.quality.certificate.wrench_set import WrenchSet
from nlpgrasp.quality.convex_tasks import equivalence_constants, mu_1, mu_tilde
from nlpgrasp.quality.forces.forces import FingerForces, finger_forces
from nlpgrasp.quality.measures import delta, mu
from nlpgrasp.quality.other_tools.min_weight import min_weight
from nlpgrasp.quality.other_tools.pyramids import ferrari_canny, pyramid_volume, pyramid_wrenches
from nlpgrasp.quality.other_tools.singular_values import isotropy, smallest_singular_value
from nlpgrasp.quality.screening import screen
from nlpgrasp.quality.stability import Stability, allowed_twists, is_stable
from nlpgrasp.quality.volume import Volume, nu

__all__ = [
    "Bounds",
    "FingerForces",
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
    "screen",
    "smallest_singular_value",
]
