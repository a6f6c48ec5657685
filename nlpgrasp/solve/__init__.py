"""Solving: propose candidates, refine them, certify, bound, analyse."""

from nlpgrasp.solve.analyse import analyse
from nlpgrasp.solve.best_possible import best_possible
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.solve import solve

__all__ = ["SolveOptions", "analyse", "best_possible", "solve"]
