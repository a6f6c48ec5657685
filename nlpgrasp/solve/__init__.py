"""Starts, transcription, IPOPT, exchange, certificate."""

from nlpgrasp.solve.dynamic import DynamicGrasp, DynamicStep, follow_task
from nlpgrasp.solve.fine_manipulation import FineManipulation, fine_manipulation
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.solve import solve

__all__ = [
    "DynamicGrasp",
    "DynamicStep",
    "FineManipulation",
    "SolveOptions",
    "fine_manipulation",
    "follow_task",
    "solve",
]
