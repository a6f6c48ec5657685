"""Robustness as JSON data and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nlpgrasp.common.validation import array
from nlpgrasp.quality import Bounds
from nlpgrasp.solution.findings import Robustness
from nlpgrasp.solution.quality_data import bounds_data, check_interval


def robust_data(found: Robustness | None) -> dict[str, Any] | None:
    """Return what is left at the worst placement found as JSON data."""
    if found is None:
        return None
    return {
        "offset": found.offset,
        "friction_share": found.friction_share,
        "mu": bounds_data(found.mu, None),
        "positions": found.points.tolist(),
        "normals": found.normals.tolist(),
    }


def robust_of(data: Mapping[str, Any] | None, name: str) -> Robustness | None:
    """Return the robustness of validated JSON data."""
    if data is None:
        return None
    check_interval(data["mu"], f"{name}: quality.robust.mu")
    points = array(f"{name}: quality.robust.positions", data["positions"], (None, None))
    normals = array(f"{name}: quality.robust.normals", data["normals"], points.shape)
    bounds = Bounds(data["mu"]["lower"], data["mu"]["upper"])
    return Robustness(data["offset"], data["friction_share"], bounds, points, normals)
