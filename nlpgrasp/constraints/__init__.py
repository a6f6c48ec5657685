"""Constraints on contacts and hand: forbidden regions, tables, obstacles, workspaces."""

from nlpgrasp.constraints.approach import Approach
from nlpgrasp.constraints.base import PlacementConstraint
from nlpgrasp.constraints.expression import Constraint
from nlpgrasp.constraints.forbid import Forbid
from nlpgrasp.constraints.obstacle import Obstacle
from nlpgrasp.constraints.regions import BoxRegion, HalfSpace, Region
from nlpgrasp.constraints.registry import constraint_from_dict, register
from nlpgrasp.constraints.rim import Rim
from nlpgrasp.constraints.spread import Spread
from nlpgrasp.constraints.symmetric import Symmetric
from nlpgrasp.constraints.table import Table
from nlpgrasp.constraints.workspace import Workspace

__all__ = [
    "Approach",
    "BoxRegion",
    "Constraint",
    "Forbid",
    "HalfSpace",
    "Obstacle",
    "PlacementConstraint",
    "Region",
    "Rim",
    "Spread",
    "Symmetric",
    "Table",
    "Workspace",
    "constraint_from_dict",
    "register",
]
