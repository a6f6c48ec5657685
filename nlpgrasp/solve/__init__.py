"""Starts, transcription, IPOPT, exchange, certificate."""

from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.solve import solve

__all__ = ["SolveOptions", "solve"]
