"""Regions of space for constraints: half-spaces, boxes and user-defined regions."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import ClassVar, NoReturn, Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.registry import JsonPart, Registry, from_registered, incomplete_data
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import array, number, replace_unchecked
from nlpgrasp.common.value_digest import expression_digest
from nlpgrasp.constraints.base import is_unit
from nlpgrasp.errors import InputError


class Region(JsonPart):
    """A region of space, given by an expression that is positive inside."""

    unit: ClassVar[str] = "m"  # of ``inside``

    @abstractmethod
    def inside(self, p: Expression) -> Expression:
        """Return an expression of a point that is positive inside the region and negative outside."""

    def dimension(self) -> int | None:
        """Return the dimension of the region's points, or None if it is arbitrary."""
        return None


@dataclass(frozen=True)
class HalfSpace(Region):
    """A half-space ``normal . p >= offset``.

    Parameters
    ----------
    normal : (2,) or (3,) array
        Not zero; normalised together with the offset.
    offset : float
        Metres, for a unit normal.
    """

    kind: ClassVar[str] = "half_space"
    normal: ArrayLike
    offset: float

    def __post_init__(self) -> None:
        n = array("HalfSpace.normal", self.normal, (None,))
        length = float(np.linalg.norm(n))
        if n.size not in (2, 3) or length == 0.0:
            raise InputError("HalfSpace.normal", self.normal, "a non-zero vector of 2 or 3 numbers")
        object.__setattr__(self, "offset", number("HalfSpace.offset", self.offset) / length)
        object.__setattr__(self, "normal", tuple(float(v) for v in n / length))

    def inside(self, p: Expression) -> Expression:
        """Return ``normal . p - offset``, metres."""
        return ca.dot(ca.DM(np.asarray(self.normal)), p) - self.offset

    def dimension(self) -> int | None:
        """Return the dimension of the normal: 2 or 3."""
        return int(np.size(self.normal))

    def to_dict(self) -> Json:
        """Return normal and offset as JSON data."""
        return {
            "type": self.kind,
            "normal": list(np.asarray(self.normal, dtype=float)),
            "offset": self.offset,
        }

    @classmethod
    def from_dict(cls, data: Json) -> Self:
        """Return the half-space from its JSON data, without rescaling a unit normal."""
        result, normal = super().from_dict(data), data["normal"]
        return (
            replace_unchecked(result, normal=tuple(normal), offset=float(data["offset"])) if is_unit(normal) else result
        )


@dataclass(frozen=True)
class BoxRegion(Region):
    """An axis-aligned box region.

    Parameters
    ----------
    lower, upper : (2,) or (3,) array
        Corners, metres, lower below upper in every axis.
    """

    kind: ClassVar[str] = "box_region"
    lower: ArrayLike
    upper: ArrayLike

    def __post_init__(self) -> None:
        low = array("BoxRegion.lower", self.lower, (None,))
        high = array("BoxRegion.upper", self.upper, (low.size,))
        if low.size not in (2, 3) or np.any(high <= low):
            raise InputError("BoxRegion", f"{low.tolist()} to {high.tolist()}", "a lower corner below the upper corner")
        object.__setattr__(self, "lower", tuple(low.tolist()))
        object.__setattr__(self, "upper", tuple(high.tolist()))

    def inside(self, p: Expression) -> Expression:
        """Return the distance of a point inside the box from the nearest side, metres, negative outside.

        Outside, the distance is that of the maximum norm.
        """
        result = None
        for i, (low, high) in enumerate(zip(np.asarray(self.lower), np.asarray(self.upper), strict=True)):
            depth = (high - low) / 2.0 - ca.fabs(p[i] - (low + high) / 2.0)
            result = depth if result is None else ca.fmin(result, depth)
        return result

    def dimension(self) -> int | None:
        """Return the dimension of the corners: 2 or 3."""
        return int(np.size(self.lower))

    def to_dict(self) -> Json:
        """Return both corners as JSON data."""
        return {
            "type": self.kind,
            "lower": list(np.asarray(self.lower)),
            "upper": list(np.asarray(self.upper)),
        }


@dataclass(frozen=True)
class ExpressionRegion(Region):
    """A region given by a user-defined function.

    Parameters
    ----------
    expression : callable
        ``expression(p)`` of a CasADi point: positive inside the region.
    field : str
        Name in messages.
    """

    kind: ClassVar[str] = "expression_region"
    unit: ClassVar[str] = ""
    expression: Callable[[Expression], Expression]
    field: str = "Forbid.region"

    def inside(self, p: Expression) -> Expression:
        """Return the user's expression at a point; raise unless it is a scalar."""
        try:
            value = self.expression(p)
        except InputError:
            raise
        except Exception as error:
            reason = f"{type(error).__name__}: {error}"
            raise InputError(self.field, reason, "CasADi operations on a point of the body's dimension") from None
        if getattr(value, "shape", None) != (1, 1):
            raise InputError(self.field, type(value).__name__, "a function that returns a scalar CasADi expression")
        return value

    def to_dict(self) -> Json:
        """Return the expression as text (for reading only), with its digest."""
        for space in (3, 2):
            p = ca.SX.sym("p", space)
            with suppress(RuntimeError, NotImplementedError):
                digest = expression_digest(self.expression, [p])
                return {"type": self.kind, "expression": str(self.expression(p)), "function": digest}
        raise InputError(self.field, "an expression", "CasADi operations on a point of the body's dimension")

    @classmethod
    def from_dict(cls, data: Json) -> NoReturn:
        """Raise: the expression's text cannot be turned back into a function."""
        raise incomplete_data(
            "region of type expression_region", "its function, which stays in the script that made it"
        )


REGIONS: Registry[Region] = Registry("region.type")
REGIONS.add(HalfSpace.kind, HalfSpace)
REGIONS.add(BoxRegion.kind, BoxRegion)
REGIONS.add(ExpressionRegion.kind, ExpressionRegion)


def region_from_dict(data: Json) -> Region:
    """Return a region from the data of its ``to_dict``.

    Raises
    ------
    InputError
        When the type is unknown, the data are invalid, or the region is a function.
    """
    return from_registered(REGIONS, "region", data)
