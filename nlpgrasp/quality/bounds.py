"""Certified intervals."""

from __future__ import annotations

from dataclasses import dataclass, field

from nlpgrasp.validation import FloatArray


@dataclass(frozen=True)
class Bounds:
    """An interval that contains the true value.

    Parameters
    ----------
    lower, upper : float
        ``lower <= true value <= upper``.
    worst_direction : (d,) array, optional
        The direction that attains ``upper``; with ``upper == 0`` it proves that the grasp is not force-closed
        against the task: no force in the contacts' cones does positive work along it.
    """

    lower: float
    upper: float
    worst_direction: FloatArray | None = field(default=None, compare=False)

    @property
    def gap(self) -> float:
        """``upper - lower`` relative to ``upper`` (0 when both are 0)."""
        return (self.upper - self.lower) / self.upper if self.upper > 0.0 else 0.0

    def __contains__(self, value: float) -> bool:
        return self.lower <= value <= self.upper

    def __str__(self) -> str:
        return f"[{self.lower:.5g}, {self.upper:.5g}]"
