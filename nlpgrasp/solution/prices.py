"""Shadow prices of limits: the first-order change of mu per small step of each."""

from __future__ import annotations

from dataclasses import dataclass

from nlpgrasp.solution.schema.types import PriceData

RANGE = " of range"  # suffix of the unit of a joint's limits, which have two sides


@dataclass(frozen=True)
class ShadowPrice:
    """Shadow price of a limit.

    Parameters
    ----------
    name : str
        The limit, for example ``"Spread.max"``.
    value : float
        Current limit, SI units.
    step : float
        Step of the limit, SI units.
    unit : str
        The step as text, for example ``"1 mm"``.
    gain : float
        First-order rise of mu with the step, on the solver's surface.
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
        """The step as text."""
        if self.unit.endswith(RANGE):
            return f"{self.unit.removesuffix(RANGE)} more at {self.name}"
        return f"raising {self.name} by {self.unit}"

    def words(self, label: str) -> str:
        """Return the effect of the step on the measure of this name, as text."""
        return f"{self.what} changes {label} by {self.gain:+.3g}"

    def __str__(self) -> str:
        return self.words("mu")
