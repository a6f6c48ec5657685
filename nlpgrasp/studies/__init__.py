"""Studies of many solves: tasks that change, fine manipulation, how many contacts."""

from nlpgrasp.studies.dynamic import follow_task
from nlpgrasp.studies.dynamic_grasp import DynamicGrasp, DynamicStep
from nlpgrasp.studies.fine_motion import FineManipulation, FingerMove, FingerPath, fine_manipulation
from nlpgrasp.studies.how_many import ContactCurve, how_many_contacts
from nlpgrasp.studies.palm import BlockedDirection, PalmPath, palm_path

__all__ = [
    "BlockedDirection",
    "ContactCurve",
    "DynamicGrasp",
    "DynamicStep",
    "FineManipulation",
    "FingerMove",
    "FingerPath",
    "PalmPath",
    "fine_manipulation",
    "follow_task",
    "how_many_contacts",
    "palm_path",
]
