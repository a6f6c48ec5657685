"""A nonlinear program under construction: named variables, parameters and constraint blocks.

One canonical form: maximise a scalar subject to ``lower <= g(z; theta) <= upper`` and bounds on z. Every
block of rows has a name, so that a report says "friction, finger 2, direction 17" and never "g[57]".
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.validation import FloatArray

HAND = "hand "  # what the names of the hand's variables begin with


@dataclass(frozen=True)
class Block:
    """A named range of variables, parameters or rows.

    Parameters
    ----------
    name : str
    start, stop : int
        Half-open range.
    scale : float
        What one unit of the solver's value is worth in the user's units.
    """

    name: str
    start: int
    stop: int
    scale: float = 1.0

    @property
    def range(self) -> slice:
        """The range as a slice."""
        return slice(self.start, self.stop)


@dataclass
class FacePart:
    """Rows that see the program only through one contact position: the body's surface there.

    ``rows(p)`` plus a linear expression of the variables. Kept apart because a mesh's spline exists as
    ``MX`` only, while everything else is an ``SX`` graph that evaluates many times faster.
    """

    function: ca.Function  # p (space,) scaled -> rows
    position: Block
    linear: ca.SX  # as many as rows


@dataclass
class DistancePart:
    """Rows ``distance(point(z)) / scale`` through a body's distance, kept apart for the same reason."""

    function: ca.Function  # point (space,) metres -> metres
    points: list[ca.SX]  # columns of the variables
    scales: list[float]


@dataclass
class Program:
    """Variables, parameters, rows and an objective, filled block by block."""

    variables: list[Block] = field(default_factory=list)
    parameters: list[Block] = field(default_factory=list)
    rows: list[Block] = field(default_factory=list)
    distance_parts: list[DistancePart] = field(default_factory=list)
    face_parts: list[FacePart] = field(default_factory=list)
    contained: int = 0  # rows of containment come first, this many
    placement: slice = field(default_factory=lambda: slice(0, 0))  # rows of constraints and hand; faces follow them
    objective: ca.SX = field(default_factory=ca.SX)
    _z: list[ca.SX] = field(default_factory=list)
    _theta: list[ca.SX] = field(default_factory=list)
    _g: list[ca.SX] = field(default_factory=list)
    _bounds: list[tuple[FloatArray, FloatArray]] = field(default_factory=list)
    _limits: list[tuple[FloatArray, FloatArray]] = field(default_factory=list)

    def variable(self, name: str, size: int, lower: ArrayLike, upper: ArrayLike, scale: float = 1.0) -> ca.SX:
        """Add variables and return their symbols (size,)."""
        symbol = ca.SX.sym(name.replace(" ", "_"), size)
        self._append(self.variables, self._z, name, symbol, scale)
        self._bounds.append((_filled(lower, size), _filled(upper, size)))
        return symbol

    def parameter(self, name: str, size: int) -> ca.SX:
        """Add parameters and return their symbols (size,)."""
        symbol = ca.SX.sym(name.replace(" ", "_"), size)
        self._append(self.parameters, self._theta, name, symbol, 1.0)
        return symbol

    def constrain(self, name: str, expression: ca.SX, lower: float, upper: float, scale: float = 1.0) -> None:
        """Add rows ``lower <= expression <= upper``, limits in the user's units, divided by ``scale``."""
        rows = ca.vec(expression) / scale
        self._append(self.rows, self._g, name, rows, scale)
        size = rows.shape[0]
        self._limits.append((_filled(lower / scale, size), _filled(upper / scale, size)))

    def constrain_distance(self, name: str, function: ca.Function, point: ca.SX, lower: float, scale: float) -> None:
        """Add the row ``lower <= function(point)``, divided by ``scale``; call these after ``constrain``."""
        if not self.distance_parts or self.distance_parts[-1].function is not function:
            self.distance_parts.append(DistancePart(function, [], []))
        part = self.distance_parts[-1]
        part.points.append(point)
        part.scales.append(scale)
        start = self.rows[-1].stop if self.rows else 0
        self.rows.append(Block(name, start, start + 1, scale))
        self._limits.append((_filled(lower / scale, 1), _filled(np.inf, 1)))

    def constrain_face(
        self, names: list[tuple[str, int, float, float]], function: ca.Function, position: str, linear: ca.SX
    ) -> None:
        """Add rows ``function(position) + linear`` given as (name, size, lower, upper); call these last."""
        for name, size, lower, upper in names:
            start = self.rows[-1].stop if self.rows else 0
            self.rows.append(Block(name, start, start + size))
            self._limits.append((_filled(lower, size), _filled(upper, size)))
        self.face_parts.append(FacePart(function, self.block(position), linear))

    def block(self, name: str) -> Block:
        """Return the variable or parameter block of a name."""
        return next(b for b in (*self.variables, *self.parameters) if b.name == name)

    def has(self, name: str) -> bool:
        """Return whether there is a variable block of this name."""
        return any(b.name == name for b in self.variables)

    @property
    def hand_blocks(self) -> list[tuple[str, Block]]:
        """The hand's variables: their own names, and where they are."""
        return [(b.name.removeprefix(HAND), b) for b in self.variables if b.name.startswith(HAND)]

    @property
    def hand_symbols(self) -> dict[str, ca.SX]:
        """The hand's variables in the hand's units, by their own names."""
        return {name: b.scale * self.z[b.range] for name, b in self.hand_blocks}

    def rows_named(self, beginning: str) -> list[int]:
        """Return the rows of the blocks whose names begin so."""
        return [i for b in self.rows if b.name.startswith(beginning) for i in range(b.start, b.stop)]

    def row_name(self, row: int) -> str:
        """Return the name of a row, with its index in the block when that has several."""
        block = next(b for b in self.rows if b.start <= row < b.stop)
        return block.name if block.stop - block.start == 1 else f"{block.name} [{row - block.start}]"

    @property
    def z(self) -> ca.SX:
        """All variables, one column."""
        return ca.vertcat(*self._z)

    @property
    def theta(self) -> ca.SX:
        """All parameters, one column."""
        return ca.vertcat(*self._theta) if self._theta else ca.SX(0, 1)

    @property
    def g(self) -> ca.SX:
        """All rows that are SX expressions, one column; rows through distances and face rows follow them."""
        return ca.vertcat(*self._g) if self._g else ca.SX(0, 1)

    @property
    def distances(self) -> int:
        """Number of rows through distances."""
        return sum(len(part.points) for part in self.distance_parts)

    @property
    def points(self) -> ca.SX:
        """Their points, one after another, one column."""
        return ca.vertcat(ca.SX(0, 1), *[point for part in self.distance_parts for point in part.points])

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the variables."""
        return _stacked(self._bounds)

    @property
    def limits(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper limits of the rows, face rows last."""
        return _stacked(self._limits)

    @staticmethod
    def _append(blocks: list[Block], symbols: list[ca.SX], name: str, symbol: ca.SX, scale: float) -> None:
        start = blocks[-1].stop if blocks else 0
        blocks.append(Block(name, start, start + symbol.shape[0], scale))
        symbols.append(symbol)


def _filled(value: ArrayLike, size: int) -> FloatArray:
    return np.array(np.broadcast_to(np.asarray(value, dtype=float), size))


def _stacked(pairs: list[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    if not pairs:
        return np.zeros(0), np.zeros(0)
    return np.concatenate([p[0] for p in pairs]), np.concatenate([p[1] for p in pairs])
