"""Palm path to a grasp (Section 1.2): straight approach with open fingers, then closing."""

from nlpgrasp.solve.phases.approach import BlockedDirection
from nlpgrasp.studies.palm.palm_path import palm_path
from nlpgrasp.studies.palm.records import PalmPath

__all__ = ["BlockedDirection", "PalmPath", "palm_path"]
