"""Studies of many solves: tasks that change, fine manipulation, how many contacts."""

from nlpgrasp.studies.dynamic import follow_task
from nlpgrasp.studies.dynamic_grasp import DynamicGrasp, DynamicStep
from nlpgrasp.studies.fine_manipulation import FineManipulation, fine_manipulation
from nlpgrasp.studies.how_many import ContactCurve, how_many_contacts

__all__ = [
    "ContactCurve",
    "DynamicGrasp",
    "DynamicStep",
    "FineManipulation",
    "fine_manipulation",
    "follow_task",
    "how_many_contacts",
]
