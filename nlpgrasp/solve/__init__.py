"""Solve a problem: starts -> first program -> ascent -> surface -> certificate -> what is worth knowing after."""

from nlpgrasp.solve.analyse import analyse
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.solve import solve

__all__ = ["SolveOptions", "analyse", "solve"]
