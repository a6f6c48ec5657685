"""Quality measures as JSON data, and back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from nlpgrasp.errors import InputError
from nlpgrasp.quality import Bounds, Volume


def bounds_data(bounds: Bounds, kind: str | None) -> dict[str, Any] | None:
    """Return mu as JSON data, with its kind and direction where a kind is given."""
    if not math.isfinite(bounds.upper):
        return None
    data: dict[str, Any] = {"lower": bounds.lower, "upper": bounds.upper}
    if kind is not None:
        data["kind"] = kind
        data["worst_direction"] = None if bounds.worst_direction is None else bounds.worst_direction.tolist()
    return data


def measure_data(bounds: Bounds | None) -> dict[str, Any] | None:
    """Return delta or nu as JSON data."""
    if bounds is None:
        return None
    data: dict[str, Any] = {"lower": bounds.lower, "upper": bounds.upper, "torque_scale": bounds.torque_scale}
    if isinstance(bounds, Volume):
        data |= {"value": bounds.value, "error": bounds.error}
    return data


def delta_of(data: Mapping[str, Any] | None, name: str) -> Bounds | None:
    """Return delta from JSON data."""
    if data is None:
        return None
    check_interval(data, f"{name}: quality.delta")
    return Bounds(data["lower"], data["upper"], torque_scale=data["torque_scale"])


def nu_of(data: Mapping[str, Any] | None, name: str) -> Volume | None:
    """Return nu from JSON data."""
    if data is None:
        return None
    check_interval(data, f"{name}: quality.nu")
    return Volume(
        data["lower"], data["upper"], torque_scale=data["torque_scale"], value=data["value"], error=data["error"]
    )


def check_interval(data: Mapping[str, Any], field: str) -> None:
    """Refuse an interval that is empty."""
    if data["lower"] > data["upper"]:
        raise InputError(field, f"lower {data['lower']} > upper {data['upper']}", "lower <= upper")
