"""What constraints know of bodies, and how they get one from a file: the two rooms do not import each other."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, Self, runtime_checkable

from nlpgrasp.common.registry import Registry, read
from nlpgrasp.common.types import Json

if TYPE_CHECKING:  # certificates reach common, and no CasADi
    import casadi as ca


@runtime_checkable
class Solid(Protocol):
    """What constraints know of a body."""

    @property
    def space(self) -> int:
        """Dimension of the body's points: 2 or 3."""

    @property
    def distance_function(self) -> ca.Function:
        """A ``casadi.Function`` from a point to the signed distance, metres."""

    def to_dict(self) -> Json:
        """Return the body as JSON data."""


class StatedSolid(Solid, Protocol):
    """A body that files may hold."""

    @classmethod
    def from_dict(cls, data: Json) -> Self:
        """Return the body that ``to_dict`` wrote."""


SOLIDS: Registry[StatedSolid] = Registry("body.type")  # filled by nlpgrasp.bodies


def solid_from_dict(data: object) -> Solid:
    """Return the body that ``to_dict`` wrote, of any registered kind.

    Raises
    ------
    InputError
        When the type is unknown, the numbers make no body, or the data do not say all of it.
    """
    return read(SOLIDS, "body", data)
