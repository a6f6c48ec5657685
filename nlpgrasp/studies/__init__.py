"""Studies of several solves: changing tasks, contact numbers and types, fine manipulation, manipulability."""

from nlpgrasp.analysis.ellipsoids import Transmission
from nlpgrasp.analysis.manipulability import FingerManipulability, Manipulability, manipulability
from nlpgrasp.analysis.sensitivity import Rate, Sensitivity, sensitivity
from nlpgrasp.motion.palm import BlockedDirection, PalmPath, palm_path
from nlpgrasp.studies.choices.curve import ContactCurve
from nlpgrasp.studies.choices.first_choice import first_choice
from nlpgrasp.studies.choices.how_many import how_many_contacts
from nlpgrasp.studies.choices.proposal import FirstChoice, Reason
from nlpgrasp.studies.choices.type_choice import TypeAssignment, TypeChoice, Upgrade
from nlpgrasp.studies.choices.types import choose_contact_types
from nlpgrasp.studies.dynamic import DynamicGrasp, DynamicStep, follow_task
from nlpgrasp.studies.fine_motion import FineManipulation, FingerMove, FingerPath, fine_manipulation

__all__ = [
    "BlockedDirection",
    "ContactCurve",
    "DynamicGrasp",
    "DynamicStep",
    "FineManipulation",
    "FingerManipulability",
    "FingerMove",
    "FingerPath",
    "FirstChoice",
    "Manipulability",
    "PalmPath",
    "Rate",
    "Reason",
    "Sensitivity",
    "Transmission",
    "TypeAssignment",
    "TypeChoice",
    "Upgrade",
    "choose_contact_types",
    "fine_manipulation",
    "first_choice",
    "follow_task",
    "how_many_contacts",
    "manipulability",
    "palm_path",
    "sensitivity",
]
