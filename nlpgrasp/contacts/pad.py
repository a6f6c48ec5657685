"""What line and plane contacts share: optional friction, and variables that begin with a force or its size."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.errors import InputError


def friction_fields(
    name: str, friction: float | None, torsion: float | None, mean_arm: float
) -> tuple[float | None, float | None]:
    """Return the checked coefficients; torsion that was left out is that of even pressure, ``friction mean_arm``."""
    if friction is None:
        if torsion is not None:
            raise InputError(f"{name}.torsional_friction", torsion, "none without friction")
        return None, None
    checked = number(f"{name}.friction", friction, above=0.0)
    torsion = checked * mean_arm if torsion is None else torsion
    return checked, number(f"{name}.torsional_friction", torsion, above=0.0)


def friction_coefficients(friction: float | None, torsion: float | None) -> dict[str, float]:
    """Return the coefficients that there are, by their fields' names."""
    both = {"friction": friction, "torsional_friction": torsion}
    return {name: value for name, value in both.items() if value is not None}


def pressing_variables(normal: FloatArray, rough: bool, size: int) -> FloatArray:
    """Return variables (n,) of unit force along the normal: the force itself where there is friction, or its size."""
    return np.concatenate([normal if rough else np.ones(1), np.zeros(size)])[:size]
