"""Blocks of a nonlinear program: which variables, parameters and rows belong together, and what they are called."""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca

from nlpgrasp.common.rows import Label
from nlpgrasp.problem.rows import hand_name

HAND = "hand"  # kind of the hand's variables


@dataclass(frozen=True)
class Range:
    """Where a block is among all variables, parameters or rows.

    Parameters
    ----------
    start, stop : int
        Half-open.
    scale : float
        What one unit of the solver's value is worth in the user's units.
    """

    start: int
    stop: int
    scale: float = 1.0

    @property
    def range(self) -> slice:
        """The range as a slice."""
        return slice(self.start, self.stop)

    @property
    def size(self) -> int:
        """Number of entries."""
        return self.stop - self.start


@dataclass(frozen=True)
class Block(Range):
    """Variables or parameters that belong together.

    Parameters
    ----------
    start, stop, scale
        As in ``Range``.
    kind : str
        For example ``"position"``, ``"forces"`` or ``"hand"``.
    index : int or str, optional
        Which of its kind: a finger, a direction, or the hand's own name of its variable.
    offset : tuple of float
        What the solver's zero is worth in the user's units.
    unit : str
        Of the user's values; empty where there is none or they differ.
    """

    kind: str = field(kw_only=True)
    index: int | str | None = field(default=None, kw_only=True)
    offset: tuple[float, ...] = field(default=(), kw_only=True)
    unit: str = field(default="", kw_only=True)

    @property
    def name(self) -> str:
        """Kind and index: ``"position 2"``, ``"hand joints"``, ``"beta"``."""
        return block_name(self.kind, self.index)

    @property
    def public_name(self) -> str:
        """The name for users: a hand's variables by their own names, ``"joints"`` or ``"palm position"``."""
        return hand_name(str(self.index)) if self.kind == HAND else self.name


@dataclass(frozen=True)
class RowBlock(Range):
    """Rows that say the same of one thing each.

    Parameters
    ----------
    start, stop, scale
        As in ``Range``.
    label : Label
    equation : str
        Of the paper.
    """

    label: Label = field(kw_only=True)
    equation: str = field(default="", kw_only=True)

    @property
    def kind(self) -> str:
        """Kind that the label states."""
        return self.label.kind

    @property
    def name(self) -> str:
        """The label written out."""
        return self.label.name


@dataclass(frozen=True)
class FaceRows:
    """Rows that tie a contact to its face: at least ``lower``, at most zero."""

    label: Label
    size: int
    scale: float
    lower: float = 0.0


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


def block_name(kind: str, index: int | str | None) -> str:
    """Return how a block of variables or parameters is called."""
    return kind if index is None else f"{kind} {index}"
