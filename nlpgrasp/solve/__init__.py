"""Starts, transcription, IPOPT, exchange, certificate."""

from nlpgrasp.solve.dynamic import follow_task
from nlpgrasp.solve.dynamic_grasp import DynamicGrasp, DynamicStep
from nlpgrasp.solve.fine_manipulation import FineManipulation, fine_manipulation
from nlpgrasp.solve.how_many import ContactCurve, how_many_contacts
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.solve import solve

__all__ = [
    "ContactCurve",
    "DynamicGrasp",
    "DynamicStep",
    "FineManipulation",
    "SolveOptions",
    "fine_manipulation",
    "follow_task",
    "how_many_contacts",
    "solve",
]
