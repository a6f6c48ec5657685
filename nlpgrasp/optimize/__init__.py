"""Search for the best grasp: candidates, local search, worker processes, warm starts."""

from nlpgrasp.optimize.global_search import best_possible
from nlpgrasp.optimize.options import SolveOptions

__all__ = ["SolveOptions", "best_possible"]
