"""How good any placement could be: a certified bound over all of them."""

from nlpgrasp.best.best_possible import best_possible
from nlpgrasp.best.result import BestPossible

__all__ = ["BestPossible", "best_possible"]
