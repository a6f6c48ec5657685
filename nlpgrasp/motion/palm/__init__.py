"""Palm path to a grasp (Section 1.2): straight approach with open fingers, then closing."""

from nlpgrasp.motion.palm.palm_path import palm_path
from nlpgrasp.motion.palm.records import PalmPath
from nlpgrasp.motion.phases.approach import BlockedDirection

__all__ = ["BlockedDirection", "PalmPath", "palm_path"]
