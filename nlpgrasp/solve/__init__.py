"""Starts, transcription, IPOPT, exchange, certificate."""

from nlpgrasp.solve.fine_manipulation import FineManipulation, fine_manipulation
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.solve import solve

__all__ = ["FineManipulation", "SolveOptions", "fine_manipulation", "solve"]
