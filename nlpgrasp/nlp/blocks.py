"""Named blocks of variables, parameters and constraints of a nonlinear program."""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca

from nlpgrasp.common.scalar_constraints import Label
from nlpgrasp.problem.candidate_constraints import hand_variable_name

HAND = "hand"  # kind of the hand's variables


@dataclass(frozen=True)
class Range:
    """Index range of a block among all variables, parameters or scalar constraints.

    Parameters
    ----------
    start, stop : int
        Half-open.
    scale : float
        Size of a solver unit in the user's units.
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
    """A named block of variables or parameters.

    Parameters
    ----------
    start, stop, scale
        As in ``Range``.
    kind : str
        For example ``"position"``, ``"forces"`` or ``"hand"``.
    index : int or str, optional
        Of a finger or a direction, or the hand's own name of its variable.
    offset : tuple of float
        The solver's zero in the user's units.
    unit : str
        Of the user's values; empty if dimensionless or mixed.
    """

    kind: str = field(kw_only=True)
    index: int | str | None = field(default=None, kw_only=True)
    offset: tuple[float, ...] = field(default=(), kw_only=True)
    unit: str = field(default="", kw_only=True)

    @property
    def name(self) -> str:
        """Kind and index as one name, such as ``"position 2"``, ``"hand joints"`` or ``"beta"``."""
        return block_name(self.kind, self.index)

    @property
    def public_name(self) -> str:
        """Displayed name; hand variables have names of their own, ``"joints"`` or ``"palm position"``."""
        return hand_variable_name(str(self.index)) if self.kind == HAND else self.name


@dataclass(frozen=True)
class ConstraintBlock(Range):
    """A block of scalar constraints with a common label.

    Parameters
    ----------
    start, stop, scale
        As in ``Range``.
    label : Label
    equation : str
        Its number in the paper.
    """

    label: Label = field(kw_only=True)
    equation: str = field(default="", kw_only=True)

    @property
    def kind(self) -> str:
        """Kind of the constraints, from their label."""
        return self.label.kind

    @property
    def name(self) -> str:
        """Name of the block in reports."""
        return self.label.name


@dataclass(frozen=True)
class FaceConstraints:
    """Label, size and limits of a block of surface constraints on a spline surface, ``lower <= g <= 0``."""

    label: Label
    size: int
    scale: float
    lower: float = 0.0


@dataclass
class SplineSurface:
    """Values of a contact's surface constraints on a spline surface: a function of the position plus a linear term.

    Separate because a mesh's spline exists only as ``MX``, while everything else is an ``SX`` graph that evaluates many
    times faster.
    """

    function: ca.Function  # p (space,) scaled -> rows
    position: Block
    linear: ca.SX  # one entry per row


@dataclass
class DistancePart:
    """Clearance constraints ``distance(point(z)) / scale`` that share a distance function.

    They are separate because the distance of a mesh exists only as ``MX``.
    """

    function: ca.Function  # point (space,) metres -> metres
    points: list[ca.SX]  # columns of the variables
    scales: list[float]


@dataclass(frozen=True)
class ConstraintCopy:
    """Variables, constraint indices and parameters of one copy of repeated constraints.

    The constraints are ``g(s, f_j; theta_j)`` with shared variables s; see ``Repeats``.

    Parameters
    ----------
    variables, rows : Range
    parameters : SX
        A column.
    """

    variables: Range
    rows: Range
    parameters: ca.SX


def block_name(kind: str, index: int | str | None) -> str:
    """Return the name of a block of variables or parameters."""
    return kind if index is None else f"{kind} {index}"
