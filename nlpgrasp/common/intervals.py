"""Interval arithmetic: bounds of a CasADi expression over boxes of its arguments.

An expression is evaluated operation by operation on intervals in place of numbers (Moore, Kearfott and Cloud,
"Introduction to Interval Analysis", 2009, doi:10.1137/1.9780898717716); each result is rounded outwards. The bounds are
never too narrow; they are wide where an argument occurs many times, and narrow with the box. Where an operation is not
defined all over a box, such as a division by an interval with zero, its ends are infinite or not a number.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.validation import FloatArray

if TYPE_CHECKING:  # verification loads it for bodies with charts alone
    import casadi as ca


@dataclass(frozen=True)
class Interval:
    """Intervals, (n,) each: their ends, and the operations of expressions on them.

    Parameters
    ----------
    lower, upper : (n,) arrays
    """

    lower: FloatArray
    upper: FloatArray

    @classmethod
    def of(cls, value: Interval | ArrayLike) -> Interval:
        """Return a number as an interval."""
        if isinstance(value, Interval):
            return value
        number = np.asarray(value, dtype=float)
        return cls(number, number)

    @classmethod
    def rounded(cls, lower: FloatArray, upper: FloatArray, units: int = 1) -> Interval:
        """Return the interval between results of floating-point operations, right to some units in the last place."""
        for _ in range(units):
            lower, upper = np.nextafter(lower, -np.inf), np.nextafter(upper, np.inf)
        return cls(lower, upper)

    @property
    def largest(self) -> FloatArray:
        """Largest absolute value, (n,)."""
        return np.maximum(np.abs(self.lower), np.abs(self.upper))

    def __neg__(self) -> Interval:
        return Interval(-self.upper, -self.lower)

    def __add__(self, other: Interval | float) -> Interval:
        b = Interval.of(other)
        return Interval.rounded(self.lower + b.lower, self.upper + b.upper)

    __radd__ = __add__

    def __sub__(self, other: Interval | float) -> Interval:
        return self + -Interval.of(other)

    def __rsub__(self, other: float) -> Interval:
        return -self + other

    def __mul__(self, other: Interval | float) -> Interval:
        b = Interval.of(other)
        first, second = self.lower * b.lower, self.lower * b.upper
        third, fourth = self.upper * b.lower, self.upper * b.upper
        lower = np.minimum(np.minimum(first, second), np.minimum(third, fourth))
        upper = np.maximum(np.maximum(first, second), np.maximum(third, fourth))
        return Interval.rounded(lower, upper)

    __rmul__ = __mul__

    def __truediv__(self, other: Interval | float) -> Interval:
        b = Interval.of(other)
        has_zero = (b.lower <= 0.0) & (b.upper >= 0.0)
        lower, upper = np.where(has_zero, -np.inf, 1.0 / b.upper), np.where(has_zero, np.inf, 1.0 / b.lower)
        return self * Interval.rounded(lower, upper)

    def __rtruediv__(self, other: float) -> Interval:
        return Interval.of(other) / self

    def rising(self, function: Callable[[FloatArray], Any], least: float = -np.inf) -> Interval:
        """Return the interval of a function that rises, defined above a least argument."""
        lower, upper = (np.asarray(function(np.maximum(end, least))) for end in (self.lower, self.upper))
        return Interval.rounded(lower, upper, 4)

    def absolute(self) -> Interval:
        """Return the absolute values."""
        return Interval(np.maximum(np.maximum(self.lower, -self.upper), 0.0), self.largest)

    def square(self) -> Interval:
        """Return the squares."""
        size = self.absolute()
        square = Interval.rounded(size.lower**2, size.upper**2)
        return Interval(np.maximum(square.lower, 0.0), square.upper)

    def sqrt(self) -> Interval:
        """Return the square roots of the parts that have one."""
        return self.rising(np.sqrt, 0.0)

    def exp(self) -> Interval:
        """Return the exponentials."""
        return self.rising(np.exp)

    def log(self) -> Interval:
        """Return the natural logarithms of the parts that have one."""
        return self.rising(np.log, 0.0)

    def sin(self) -> Interval:
        """Return the sines."""
        return self._wave(0.5 * np.pi, np.sin)

    def cos(self) -> Interval:
        """Return the cosines."""
        return self._wave(0.0, np.cos)

    def _wave(self, crest: float, function: Callable[[FloatArray], FloatArray]) -> Interval:
        """Return the interval of a wave with a crest there, and troughs half a turn away."""
        first, second = function(self.lower), function(self.upper)
        ends = Interval.rounded(np.minimum(first, second), np.maximum(first, second), 4)
        meets = [
            np.floor((self.upper - x) / (2.0 * np.pi) + 1e-12) >= np.ceil((self.lower - x) / (2.0 * np.pi) - 1e-12)
            for x in (crest, crest + np.pi)
        ]
        return Interval(np.where(meets[1], -1.0, ends.lower), np.where(meets[0], 1.0, ends.upper))

    def power(self, exponent: float) -> Interval:
        """Return the powers with a constant exponent: of all numbers if it is whole, else of those above zero."""
        if exponent < 0.0:
            return 1.0 / self.power(-exponent)
        if exponent != round(exponent):
            return self.rising(lambda x: x**exponent, 0.0)
        return (self if exponent % 2.0 else self.absolute()).rising(lambda x: x**exponent)


def length_bound(components: Sequence[Interval]) -> FloatArray:
    """Return an upper bound on the lengths of vectors, (n,), given their components."""
    return np.asarray(np.sqrt(sum(component.largest**2 for component in components)) * (1.0 + 1e-12))


@cache
def _operations() -> dict[int, Callable[..., Any]]:
    """Return what operations of CasADi do with numbers of any kind that state them."""
    import casadi as ca

    return {
        ca.OP_ASSIGN: lambda a: a,
        ca.OP_ADD: lambda a, b: a + b,
        ca.OP_SUB: lambda a, b: a - b,
        ca.OP_MUL: lambda a, b: a * b,
        ca.OP_DIV: lambda a, b: a / b,
        ca.OP_NEG: lambda a: -a,
        ca.OP_INV: lambda a: 1.0 / a,
        ca.OP_TWICE: lambda a: 2.0 * a,
        ca.OP_SQ: lambda a: a.square(),
        ca.OP_SQRT: lambda a: a.sqrt(),
        ca.OP_EXP: lambda a: a.exp(),
        ca.OP_LOG: lambda a: a.log(),
        ca.OP_SIN: lambda a: a.sin(),
        ca.OP_COS: lambda a: a.cos(),
    }


class UnknownOperationError(Exception):
    """An expression has an operation that has no bounds here."""


def evaluate(function: ca.Function, arguments: Sequence[Any], constant: Callable[[float], Any]) -> list[list[Any]]:
    """Return the elements of each output of a function of one argument, an ``SX`` column, on numbers of another kind.

    Parameters
    ----------
    function : casadi.Function
        Of ``SX`` expressions, with one input.
    arguments : sequence
        One for each element of the input.
    constant : callable
        A float to a number of that kind.

    Raises
    ------
    UnknownOperationError
        On an operation that has no bounds here, or a power whose exponent is not constant.
    """
    import casadi as ca

    work: dict[int, Any] = {}
    constants: dict[int, float] = {}
    outputs = [[constant(0.0)] * function.nnz_out(i) for i in range(function.n_out())]
    for k in range(function.n_instructions()):
        operation, inputs, results = (
            function.instruction_id(k),
            function.instruction_input(k),
            function.instruction_output(k),
        )
        if operation == ca.OP_OUTPUT:
            outputs[results[0]][results[1]] = work[inputs[0]]
            continue
        value: float | None = None
        if operation == ca.OP_CONST:
            value = float(function.instruction_constant(k))
            work[results[0]] = constant(value)
        elif operation == ca.OP_INPUT:
            work[results[0]] = arguments[inputs[1]]
        elif operation in (ca.OP_POW, ca.OP_CONSTPOW):
            exponent = constants.get(inputs[1])
            if exponent is None:
                raise UnknownOperationError("a power whose exponent is not constant")
            work[results[0]] = work[inputs[0]].power(exponent)
        elif operation in _operations():
            work[results[0]] = _operations()[operation](*(work[i] for i in inputs))
        else:
            raise UnknownOperationError(f"operation {operation} of CasADi ({function.name()})")
        constants.pop(results[0], None)
        if value is not None:
            constants[results[0]] = value
    return outputs


def interval_bounds(function: ca.Function, lower: FloatArray, upper: FloatArray) -> list[list[Interval]]:
    """Return bounds of the elements of each output of a function over boxes, (n, q) lower and upper corners.

    Raises
    ------
    UnknownOperationError
        As ``evaluate``.
    """
    boxes = [Interval(a, b) for a, b in zip(lower.T, upper.T, strict=True)]
    with np.errstate(all="ignore"):
        return evaluate(function, boxes, lambda value: Interval.of(np.full(len(lower), value)))
