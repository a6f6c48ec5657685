"""Quality of a given grasp, with certified bounds; numpy and scipy only."""

from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.measures import delta, mu
from nlpgrasp.quality.wrench_set import WrenchSet

__all__ = ["Bounds", "WrenchSet", "delta", "mu"]
