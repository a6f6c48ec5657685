"""Studies that solve several problems: changing tasks, numbers and types of contacts, fine manipulation."""

from nlpgrasp.analysis.manipulability import FingerManipulability, Manipulability, Transmission, manipulability
from nlpgrasp.analysis.mu_rates import MuRates, Rate, mu_rates
from nlpgrasp.analysis.sensitivity import Sensitivity, sensitivity
from nlpgrasp.motion.approach_path import BlockedDirection
from nlpgrasp.motion.finger_motion import FingerPath
from nlpgrasp.motion.palm_path import PalmPath, palm_path
from nlpgrasp.studies.contact_numbers import ContactCurve, how_many_contacts
from nlpgrasp.studies.contact_types import TypeAssignment, TypeChoice, TypeUpgrade, choose_contact_types
from nlpgrasp.studies.dynamic_grasping import DynamicGrasp, DynamicStep, follow_task
from nlpgrasp.studies.fine_manipulation import FineManipulation, fine_manipulation
from nlpgrasp.studies.finger_moves import FingerMove
from nlpgrasp.studies.first_choice import FirstChoice, Reason, first_choice
from nlpgrasp.studies.purposes import PurposeComparison

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
    "MuRates",
    "PalmPath",
    "PurposeComparison",
    "Rate",
    "Reason",
    "Sensitivity",
    "Transmission",
    "TypeAssignment",
    "TypeChoice",
    "TypeUpgrade",
    "choose_contact_types",
    "fine_manipulation",
    "first_choice",
    "follow_task",
    "how_many_contacts",
    "manipulability",
    "mu_rates",
    "palm_path",
    "sensitivity",
]
