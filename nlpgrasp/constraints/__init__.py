"""Constraints: where contacts must not be."""

from nlpgrasp.constraints.base import PlacementConstraint
from nlpgrasp.constraints.expression import Constraint
from nlpgrasp.constraints.forbid import Forbid
from nlpgrasp.constraints.regions import BoxRegion, HalfSpace, Region
from nlpgrasp.constraints.spread import Spread
from nlpgrasp.constraints.table import Table

__all__ = [
    "BoxRegion",
    "Constraint",
    "Forbid",
    "HalfSpace",
    "PlacementConstraint",
    "Region",
    "Spread",
    "Table",
]
