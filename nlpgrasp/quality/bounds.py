"""Certified intervals of quality measures, for grasps and stacks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from nlpgrasp.common.formatting import format_interval
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError

SHOWN = 4  # least number of digits printed


@dataclass(frozen=True)
class Bounds:
    """A certified interval that contains the true value of a quality measure.

    Parameters
    ----------
    lower, upper : float
        ``lower <= true value <= upper``, in the unit of the measure.
    worst_direction : (d,) array, optional
        Direction of wrench space that attains ``upper``; with ``upper == 0`` it proves that the grasp cannot exert the
        task: no force in the contacts' cones does positive work along it.
    torque_scale : float, optional
        Metres: the length that turned torques into forces, where the measure needs one.
    kind : str
        The measure, for example ``"mu"`` or, for a task that is not centred, ``"mu_tilde"``; empty if not stated.
    task_beta : float, optional
        For mu of a centred task ellipsoid: the paper's scale of the given task (3.3-3).
    limit : str
        Reason why the interval is wider than the tolerance; empty otherwise.
    trust : str
        What the interval rests on besides real arithmetic, for example a user's own support function; else empty.
    vertices : (v, l) array, optional
        Variables of the finger forces behind the vertices of the polytope that proves ``lower``, as a proof file states
        them (docs/proof_format.md); kept by a solve, so that its proof is not computed again.
    """

    lower: float
    upper: float
    worst_direction: FloatArray | None = field(default=None, compare=False)
    torque_scale: float | None = field(default=None, compare=False, kw_only=True)
    kind: str = field(default="", compare=False, kw_only=True)
    task_beta: float | None = field(default=None, compare=False, kw_only=True)
    limit: str = field(default="", compare=False, kw_only=True)
    trust: str = field(default="", compare=False, kw_only=True)
    vertices: FloatArray | None = field(default=None, compare=False, repr=False, kw_only=True)

    @property
    def beta(self) -> Bounds | None:
        """Interval times the task's beta, which is the paper's mu (3.3-4a); None if not mu of a centred ellipsoid.

        The scale is beta of ``A_beta``. None for measures other than mu of a centred task ellipsoid.
        """
        if self.task_beta is None:
            return None
        return Bounds(self.task_beta * self.lower, self.task_beta * self.upper, kind="beta")

    @property
    def gap(self) -> float:
        """Relative width ``(upper - lower) / upper`` of the interval; 0 when both are 0."""
        return (self.upper - self.lower) / self.upper if self.upper > 0.0 else 0.0

    def reciprocal(self, scale: float = 1.0) -> Bounds:
        """Return the interval of ``scale`` over a value that is at least 0, rounded outwards."""
        lower = float(np.nextafter(scale / self.upper, 0.0)) if self.upper > 0.0 else np.inf
        upper = float(np.nextafter(scale / self.lower, np.inf)) if self.lower > 0.0 else np.inf
        return Bounds(lower, upper, trust=self.trust)

    def of_measure(self, kind: str, task_beta: float | None = None) -> Self:
        """Return a copy labelled with a measure and, if any, the paper's task scale."""
        return replace(self, kind=kind, task_beta=task_beta)

    def to_dict(self) -> dict[str, float]:
        """Return the interval as JSON data, with any torque scale and without the worst direction."""
        data = {"lower": self.lower, "upper": self.upper}
        return data if self.torque_scale is None else {**data, "torque_scale": self.torque_scale}

    @classmethod
    def from_dict(cls, data: Mapping[str, float], name: str) -> Self:
        """Return the interval from the data of ``to_dict``.

        Raises
        ------
        InputError
            When it is empty or a bound is NaN; ``name`` is shown in the message.
        """
        if not data["lower"] <= data["upper"]:
            raise InputError(name, f"lower {data['lower']} > upper {data['upper']}", "lower <= upper")
        return cls(data["lower"], data["upper"], torque_scale=data.get("torque_scale"))

    def __contains__(self, value: float) -> bool:
        return self.lower <= value <= self.upper

    def __str__(self) -> str:
        return f"[{', '.join(format_interval(self.lower, self.upper, SHOWN))}]"

    def __repr__(self) -> str:
        kind = f", kind={self.kind!r}" if self.kind else ""
        return f"{type(self).__name__}({', '.join(format_interval(self.lower, self.upper, SHOWN))}{kind})"


@dataclass(frozen=True)
class StackBounds:
    """Certified intervals of the grasps of a stack; a sequence of ``Bounds``.

    Parameters
    ----------
    lower, upper : (b,) array
        As in ``Bounds``, one entry per grasp.
    worst_directions : (b, d) array
        As in ``Bounds``; NaN for a grasp without one.
    torque_scale : float, optional
        Metres: the length that turned torques into forces, where the measure needs one.
    kind : str
        The measure, as in ``Bounds``.
    task_beta : float, optional
        As in ``Bounds``.
    limits : tuple of b str
        As ``limit`` in ``Bounds``, one entry per grasp; empty if no interval is wider than the tolerance.
    trusts : tuple of b str
        As ``trust`` in ``Bounds``, likewise.
    """

    lower: FloatArray
    upper: FloatArray
    worst_directions: FloatArray
    torque_scale: float | None = None
    kind: str = ""
    task_beta: float | None = None
    limits: tuple[str, ...] = ()
    trusts: tuple[str, ...] = ()

    @classmethod
    def of(cls, bounds: Sequence[Bounds]) -> StackBounds:
        """Return the combined intervals of several grasps."""
        directions = [b.worst_direction for b in bounds if b.worst_direction is not None]
        size = len(directions[0]) if directions else 0
        rows = [np.full(size, np.nan) if b.worst_direction is None else b.worst_direction for b in bounds]
        return cls(
            np.array([b.lower for b in bounds], dtype=float),
            np.array([b.upper for b in bounds], dtype=float),
            np.array(rows).reshape(len(bounds), size),
            bounds[0].torque_scale if bounds else None,
            bounds[0].kind if bounds else "",
            bounds[0].task_beta if bounds else None,
            tuple(b.limit for b in bounds) if any(b.limit for b in bounds) else (),
            tuple(b.trust for b in bounds) if any(b.trust for b in bounds) else (),
        )

    def __len__(self) -> int:
        return len(self.lower)

    def __getitem__(self, index: int) -> Bounds:
        y = self.worst_directions[index]
        direction = None if not y.size or np.isnan(y).any() else y
        limit, trust = (texts[index] if texts else "" for texts in (self.limits, self.trusts))
        scale, lower, upper = self.torque_scale, float(self.lower[index]), float(self.upper[index])
        bounds = Bounds(lower, upper, direction, torque_scale=scale, limit=limit, trust=trust)
        return bounds.of_measure(self.kind, self.task_beta)

    def __iter__(self) -> Iterator[Bounds]:
        return (self[i] for i in range(len(self)))

    def __repr__(self) -> str:
        kind = f" of {self.kind}" if self.kind else ""
        scale = "" if self.torque_scale is None else f", torque_scale={self.torque_scale:g} m"
        positive = int(np.sum(self.lower > 0.0))
        largest = f", the largest in {self[int(np.argmax(self.lower))]}" if positive else ""
        return f"StackBounds({len(self)} intervals{kind}, {positive} above 0{largest}{scale})"
