"""Upper bound on mu over all placements of a problem's contacts, by branch and bound."""

from nlpgrasp.best.result import BestPossible

__all__ = ["BestPossible"]
