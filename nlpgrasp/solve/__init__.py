"""Solve a problem: starts -> first program -> ascent -> surface -> certificate -> what is worth knowing after."""

from nlpgrasp.solve.extras import with_extras
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.solve import solve

__all__ = ["SolveOptions", "solve", "with_extras"]
