"""Upper bound on mu over all placements of a problem's contacts, by branch and bound."""

from nlpgrasp.global_bound.best_possible_result import BestPossible

__all__ = ["BestPossible"]
