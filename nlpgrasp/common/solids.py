"""Protocol and registry of bodies for constraints, which do not import the bodies package."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, Self, runtime_checkable

from nlpgrasp.common.registry import Registry, read
from nlpgrasp.common.types import Json

if TYPE_CHECKING:  # certificates reach common, and no CasADi
    import casadi as ca


@runtime_checkable
class Solid(Protocol):
    """Protocol of bodies as constraints use them: dimension and signed distance."""

    @property
    def space(self) -> int:
        """Dimension of the body's points: 2 or 3."""

    @property
    def distance_function(self) -> ca.Function:
        """Compiled signed distance: a ``casadi.Function`` of a point, in metres."""

    def to_dict(self) -> Json:
        """Return the body as JSON data."""


class StatedSolid(Solid, Protocol):
    """Protocol of bodies that can be stored in files."""

    @classmethod
    def from_dict(cls, data: Json) -> Self:
        """Return the body from the data of its ``to_dict``."""


SOLIDS: Registry[StatedSolid] = Registry("body.type")  # filled by nlpgrasp.bodies


def solid_from_dict(data: object) -> Solid:
    """Return a body of any registered type from the data of its ``to_dict``.

    Raises
    ------
    InputError
        When the type is unknown, or the data are invalid or incomplete.
    """
    return read(SOLIDS, "body", data)
