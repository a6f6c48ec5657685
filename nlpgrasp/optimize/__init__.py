"""Search for the best grasp: propose candidates, refine them, certify."""

from nlpgrasp.optimize.global_search import best_possible
from nlpgrasp.optimize.options import SolveOptions

__all__ = ["SolveOptions", "best_possible"]
