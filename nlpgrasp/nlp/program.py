"""A nonlinear program under construction: named variables, parameters and constraint blocks.

One canonical form: maximise a scalar subject to ``lower <= g(z; theta) <= upper`` and bounds on z. Every
block of rows has a name, so that a report says "friction, finger 2, direction 17" and never "g[57]".
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.rows import Clearance, Label, Row
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.nlp.blocks import Block, DistancePart, FacePart, FaceRows, Range, RowBlock, block_name
from nlpgrasp.nlp.repeats import Copy
from nlpgrasp.nlp.slots import Slots

HAND = "hand"  # kind of the hand's variables


@dataclass
class Program:
    """Variables, parameters, rows and an objective, filled block by block."""

    variables: list[Block] = field(default_factory=list)
    parameters: list[Block] = field(default_factory=list)
    rows: list[RowBlock] = field(default_factory=list)
    distance_parts: list[DistancePart] = field(default_factory=list)
    face_parts: list[FacePart] = field(default_factory=list)
    copies: list[Copy] = field(default_factory=list)  # of rows that repeat, where derivatives are made from one
    slots: Slots | None = None  # rows of one function, before all others
    contained: int = 0  # rows of containment come first, this many
    placement: slice = field(default_factory=lambda: slice(0, 0))  # rows of constraints and hand; faces follow them
    objective: ca.SX = field(default_factory=ca.SX)
    _z: list[ca.SX] = field(default_factory=list)
    _theta: list[ca.SX] = field(default_factory=list)
    _g: list[ca.SX] = field(default_factory=list)
    _bounds: list[tuple[FloatArray, FloatArray]] = field(default_factory=list)
    _limits: list[tuple[FloatArray, FloatArray]] = field(default_factory=list)

    def variable(
        self,
        kind: str,
        size: int,
        lower: ArrayLike,
        upper: ArrayLike,
        scale: float = 1.0,
        index: int | str | None = None,
    ) -> ca.SX:
        """Add variables and return their symbols (size,)."""
        symbol = ca.SX.sym(block_name(kind, index).replace(" ", "_"), size)
        start = _end(self.variables)
        self.variables.append(Block(start, start + size, scale, kind=kind, index=index))
        self._z.append(symbol)
        self._bounds.append((_filled(lower, size), _filled(upper, size)))
        return symbol

    def parameter(self, kind: str, size: int, index: int | None = None) -> ca.SX:
        """Add parameters and return their symbols (size,)."""
        symbol = ca.SX.sym(block_name(kind, index).replace(" ", "_"), size)
        start = _end(self.parameters)
        self.parameters.append(Block(start, start + size, kind=kind, index=index))
        self._theta.append(symbol)
        return symbol

    def constrain(self, row: Row) -> None:
        """Add a row, or a column of them, divided by its scale."""
        expression: ca.SX = row.expression
        self._g.append(ca.vec(expression) / row.scale)
        self._add_rows(row, expression.numel(), (row.lower / row.scale, row.upper / row.scale), row.scale)

    def constrain_slots(self, kind: str, part: str, slots: Slots) -> None:
        """Add a row for each slot, at least zero; call this first. They are not among ``g``."""
        for j in range(slots.count):
            self._add_rows(Label(kind, part=f"{part} {j}"), 1, (0.0, np.inf))
        self.slots = slots

    def constrain_distance(self, item: Clearance) -> None:
        """Add a row through a distance, divided by its scale; call these after ``constrain``."""
        if not self.distance_parts or self.distance_parts[-1].function is not item.distance:
            self.distance_parts.append(DistancePart(item.distance, [], []))
        part = self.distance_parts[-1]
        part.points.append(item.point)
        part.scales.append(item.scale)
        self._add_rows(item, 1, (item.lower / item.scale, np.inf), item.scale)

    def constrain_face(self, rows: Sequence[FaceRows], function: ca.Function, position: Block, linear: ca.SX) -> None:
        """Add rows ``function(position) + linear``, a contact's own; call these last."""
        for row in rows:
            self._add_rows(row.label, row.size, (row.lower, 0.0))
        self.face_parts.append(FacePart(function, position, linear))

    def _add_rows(self, label: Label, size: int, limits: tuple[float, float], scale: float = 1.0) -> None:
        start = _end(self.rows)
        self.rows.append(RowBlock(start, start + size, scale, label=label.label))
        self._limits.append((_filled(limits[0], size), _filled(limits[1], size)))

    def block(self, kind: str, index: int | str | None = None) -> Block:
        """Return the one block of variables or parameters of a kind, or with an index the one of that."""
        wanted = block_name(kind, index)
        return next(b for b in (*self.variables, *self.parameters) if b.name == wanted)

    def blocks(self, kind: str) -> list[Block]:
        """Return all blocks of variables of a kind, in order."""
        return [b for b in self.variables if b.kind == kind]

    @property
    def hand_blocks(self) -> list[tuple[str, Block]]:
        """The hand's variables: their own names, and where they are."""
        return [(str(b.index), b) for b in self.blocks(HAND)]

    @property
    def hand_symbols(self) -> dict[str, ca.SX]:
        """The hand's variables in the hand's units, by their own names."""
        return {name: b.scale * self.z[b.range] for name, b in self.hand_blocks}

    def rows_of(self, kind: str) -> list[int]:
        """Return all rows of a kind."""
        return [i for b in self.rows if b.kind == kind for i in range(b.start, b.stop)]

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
        """All rows that are SX expressions, one column: after slots, before rows through distances and face rows."""
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
        """Lower and upper bounds of the variables, (n,) each, solver units."""
        return _stacked(self._bounds)

    def within(self, name: str, lower: FloatArray, upper: FloatArray) -> Program:
        """Return the same program with other bounds, (m,) each, of one of the hand's variables, in the hand's units."""
        block = self.block(HAND, name)
        result = copy(self)
        result._bounds = list(self._bounds)
        result._bounds[self.variables.index(block)] = lower / block.scale, upper / block.scale
        return result

    @property
    def limits(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper limits of the rows, (m,) each, face rows last."""
        return _stacked(self._limits)


def _end(blocks: Sequence[Range]) -> int:
    """Return where the next block begins."""
    return blocks[-1].stop if blocks else 0


def _filled(value: ArrayLike, size: int) -> FloatArray:
    return np.array(np.broadcast_to(np.asarray(value, dtype=float), size))


def _stacked(pairs: list[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    if not pairs:
        return np.zeros(0), np.zeros(0)
    return np.concatenate([p[0] for p in pairs]), np.concatenate([p[1] for p in pairs])
