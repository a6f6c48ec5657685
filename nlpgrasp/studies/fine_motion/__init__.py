"""Fine motion (Section 3.5.1): fingers that move one at a time within their hand's limits."""

from nlpgrasp.motion.finger_path import FingerPath
from nlpgrasp.studies.fine_motion.fine_manipulation import fine_manipulation
from nlpgrasp.studies.fine_motion.records import FineManipulation, FingerMove

__all__ = ["FineManipulation", "FingerMove", "FingerPath", "fine_manipulation"]
