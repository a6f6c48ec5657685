"""Contact models: admissible contact forces and their friction cones."""

from nlpgrasp.contacts.base import ContactModel, Work, contact_from_dict
from nlpgrasp.contacts.bilateral import BilateralContact
from nlpgrasp.contacts.friction import FrictionContact
from nlpgrasp.contacts.line import LineContact
from nlpgrasp.contacts.plane import PlaneContact
from nlpgrasp.contacts.point import PointContact
from nlpgrasp.contacts.registry import register
from nlpgrasp.contacts.soft import SoftContact

__all__ = [
    "BilateralContact",
    "ContactModel",
    "FrictionContact",
    "LineContact",
    "PlaneContact",
    "PointContact",
    "SoftContact",
    "Work",
    "contact_from_dict",
    "register",
]
