"""User-defined constraint given by a CasADi expression."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from inspect import Parameter, signature
from typing import ClassVar, NoReturn

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.registry import incomplete_data
from nlpgrasp.common.scalar_constraints import ScalarConstraint, SymbolicCandidate
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, format_known_names
from nlpgrasp.constraints.base import PlacementConstraint
from nlpgrasp.errors import InputError

SEES_HAND = 3  # number of arguments of an expression that uses the hand's variables


class _HandVariables(dict[str, Expression]):
    """The hand's variables by name; unknown names raise an InputError."""

    def __missing__(self, name: str) -> NoReturn:
        expected = (
            f"a variable of the hand: {format_known_names([name], self)}" if self else "a hand with joints or a palm"
        )
        raise InputError("Constraint.expression hand", repr(name), expected)


@dataclass(frozen=True)
class Constraint(PlacementConstraint):
    """A user-defined constraint ``lower <= expression <= upper`` on contacts and hand.

    Parameters
    ----------
    name : str
        Shown in reports.
    expression : callable
        ``expression(positions, normals)`` of two lists of k CasADi columns, positions in metres and inward unit
        normals; returns a CasADi expression of any shape, or a list of scalars. With a third argument without default,
        ``expression(positions, normals, hand)``, it also takes the hand's variables by name, as ``ng.formulate``
        prints them: ``hand["joints"]``, ``hand["palm position"]``.
    lower, upper : float or (m,) array
        Limits of each of the m elements, in the expression's own unit; infinite for none.

    Examples
    --------
    Keep fingers 0 and 1 level: ``Constraint("level", lambda p, n: p[0][2] - p[1][2], 0.0, 0.0)``.
    Keep the palm above: ``Constraint("palm above", lambda p, n, hand: hand["palm position"][2], 0.05)``.
    """

    kind: ClassVar[str] = "expression"
    name: str
    expression: Callable[..., Expression]
    lower: ArrayLike = -np.inf
    upper: ArrayLike = np.inf

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InputError("Constraint.name", self.name, "a non-empty name")
        if not callable(self.expression):
            raise InputError(
                f"Constraint {self.name!r}.expression", self.expression, "a function of (positions, normals)"
            )
        low, high = (self._limit(value) for value in (self.lower, self.upper))
        if low.size > 1 and high.size > 1 and low.shape != high.shape:
            raise InputError(f"Constraint {self.name!r}", f"limits of shape {low.shape} and {high.shape}", "one shape")
        object.__setattr__(self, "lower", low)
        object.__setattr__(self, "upper", high)
        if np.any(np.isnan(low)) or np.any(np.isnan(high)) or np.any(low > high):
            limits = f"{low.tolist()} to {high.tolist()}"
            raise InputError(f"Constraint {self.name!r}", limits, "lower limits below upper limits")

    def _limit(self, value: ArrayLike) -> FloatArray:
        try:
            return np.array(value, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            raise InputError(f"Constraint {self.name!r}", value, "limits that are numbers") from None

    @property
    def _uses_hand(self) -> bool:
        """Whether the expression takes the hand's variables as a third argument."""
        try:
            parameters = signature(self.expression).parameters.values()
        except (TypeError, ValueError):
            return False
        positional = (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD)
        return sum(p.kind in positional and p.default is Parameter.empty for p in parameters) == SEES_HAND

    def rows(self, placement: SymbolicCandidate) -> list[ScalarConstraint]:
        """Return one scalar constraint per element of the expression."""
        field = f"Constraint {self.name!r}.expression"
        if self._uses_hand and placement.hand is None:
            return []
        hand = [_HandVariables(placement.hand or {})] if self._uses_hand else []
        try:
            value = self.expression(list(placement.positions), list(placement.normals), *hand)
            value = ca.vec(ca.vertcat(*value) if isinstance(value, list | tuple) else ca.SX(value))
        except InputError:
            raise
        except Exception as error:
            reason = f"{type(error).__name__}: {error}"
            raise InputError(field, reason, "CasADi operations on the positions and normals") from None
        count = int(value.shape[0])
        if count == 0:
            raise InputError(field, "nothing", "at least one scalar")
        try:
            lower = np.broadcast_to(np.ravel(self.lower, order="F"), count)  # columns first, as CasADi's vec
            upper = np.broadcast_to(np.ravel(self.upper, order="F"), count)
        except ValueError:
            raise InputError(field, f"{count} elements", "as many limits as elements, or one") from None
        parts = [""] if count == 1 else [f"[{i}]" for i in range(count)]
        return [
            ScalarConstraint(self.name, value[i], float(lower[i]), float(upper[i]), part=parts[i]) for i in range(count)
        ]

    def to_dict(self) -> Json:
        """Return name and limits as JSON data, without the expression."""
        lower, upper = ([v if np.isfinite(v) else None for v in np.ravel(x).tolist()] for x in (self.lower, self.upper))
        return {"type": self.kind, "name": self.name, "lower": lower, "upper": upper}

    @classmethod
    def from_dict(cls, data: Json) -> NoReturn:
        """Raise: the JSON data do not contain the function."""
        raise incomplete_data("constraint of type expression", "its function, which stays in the script that made it")
