"""Registry of constraint types for JSON files."""

from __future__ import annotations

from typing import TypeVar

from nlpgrasp.common.registry import Registry, from_registered
from nlpgrasp.common.types import Json
from nlpgrasp.constraints.approach import Approach
from nlpgrasp.constraints.base import PlacementConstraint
from nlpgrasp.constraints.expression import Constraint
from nlpgrasp.constraints.forbid import Forbid
from nlpgrasp.constraints.obstacle import Obstacle
from nlpgrasp.constraints.rim import Rim
from nlpgrasp.constraints.spread import Spread
from nlpgrasp.constraints.symmetric import Symmetric
from nlpgrasp.constraints.table import Table
from nlpgrasp.constraints.workspace import Workspace

Kind = TypeVar("Kind", bound=PlacementConstraint)
CONSTRAINTS: Registry[PlacementConstraint] = Registry("constraint.type")


def register(constraint: type[Kind]) -> type[Kind]:
    """Register a constraint type for JSON files; usable as a decorator.

    Parameters
    ----------
    constraint : subclass of PlacementConstraint
        Its ``kind`` is the ``type`` in its ``to_dict``. A class that is not a dataclass also needs ``from_dict``.

    Raises
    ------
    InputError
        When another constraint type has that name.
    """
    CONSTRAINTS.add(constraint.kind, constraint)
    return constraint


def constraint_from_dict(data: Json) -> PlacementConstraint:
    """Return a constraint of any registered type from the data of its ``to_dict``.

    Raises
    ------
    InputError
        When the type is unknown, or the data are invalid or incomplete.
    """
    return from_registered(CONSTRAINTS, "constraint", data)


register(Approach)
register(Constraint)
register(Forbid)
register(Obstacle)
register(Rim)
register(Spread)
register(Symmetric)
register(Table)
register(Workspace)
