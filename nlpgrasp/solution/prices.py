"""What limits cost: the change of mu by a small step of each."""

from __future__ import annotations

from dataclasses import dataclass

from nlpgrasp.solution.schema.types import PriceData

RANGE = " of range"  # ends the unit of a joint's limit, which has two sides


@dataclass(frozen=True)
class ShadowPrice:
    """What a little more of a limit would buy.

    Parameters
    ----------
    name : str
        The limit, for example ``"Spread.max"``.
    value : float
        As it is, SI units.
    step : float
        How much more, SI units.
    unit : str
        The step in words, for example ``"1 mm"``.
    gain : float
        By how much mu rises with the step, to first order, on the solver's surface.
    """

    name: str
    value: float
    step: float
    unit: str
    gain: float

    def to_dict(self) -> PriceData:
        """Return the price as JSON data."""
        return {"name": self.name, "value": self.value, "step": self.step, "unit": self.unit, "gain": self.gain}

    @classmethod
    def from_dict(cls, data: PriceData) -> ShadowPrice:
        """Return the price that ``to_dict`` wrote."""
        return cls(**data)

    @property
    def what(self) -> str:
        """The step in words."""
        if self.unit.endswith(RANGE):
            return f"{self.unit.removesuffix(RANGE)} more at {self.name}"
        return f"raising {self.name} by {self.unit}"

    def words(self, label: str) -> str:
        """Return what the step changes of the measure of this name."""
        return f"{self.what} changes {label} by {self.gain:+.3g}"

    def __str__(self) -> str:
        return self.words("mu")
