"""The kinds of constraint that a file may hold."""

from __future__ import annotations

from typing import TypeVar

from nlpgrasp.common.registry import Registry, read
from nlpgrasp.common.types import Json
from nlpgrasp.constraints.approach import Approach
from nlpgrasp.constraints.base import PlacementConstraint
from nlpgrasp.constraints.expression import Constraint
from nlpgrasp.constraints.forbid import Forbid
from nlpgrasp.constraints.obstacle import Obstacle
from nlpgrasp.constraints.spread import Spread
from nlpgrasp.constraints.symmetric import Symmetric
from nlpgrasp.constraints.table import Table
from nlpgrasp.constraints.workspace import Workspace

Kind = TypeVar("Kind", bound=PlacementConstraint)
CONSTRAINTS: Registry[PlacementConstraint] = Registry("constraint.type")


def register(constraint: type[Kind]) -> type[Kind]:
    """Add a kind of constraint, of this package or another, to those that files may hold; also as a decorator.

    Parameters
    ----------
    constraint : subclass of PlacementConstraint
        With ``kind``, the name that its ``to_dict`` gives as ``type``. A class that is not a dataclass needs
        ``from_dict`` as well.

    Raises
    ------
    InputError
        When another constraint has that name.
    """
    CONSTRAINTS.add(constraint.kind, constraint)
    return constraint


def constraint_from_dict(data: Json) -> PlacementConstraint:
    """Return the constraint that ``to_dict`` wrote, of any registered kind.

    Raises
    ------
    InputError
        When the type is unknown, the numbers make no constraint, or the data do not say all of it.
    """
    return read(CONSTRAINTS, "constraint", data)


register(Approach)
register(Constraint)
register(Forbid)
register(Obstacle)
register(Spread)
register(Symmetric)
register(Table)
register(Workspace)
