"""A diagnosis as JSON data and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from nlpgrasp.solution.findings import Conflict, WhyNot


def why_not_data(found: WhyNot | None) -> dict[str, Any] | None:
    """Return the diagnosis as JSON data."""
    if found is None:
        return None
    return {
        "conflicts": [asdict(c) for c in found.conflicts],
        "direction": None if found.direction is None else found.direction.tolist(),
        "reasons": list(found.reasons),
        "advice": list(found.advice),
        "locally_infeasible": found.locally_infeasible,
    }


def why_not_of(data: Mapping[str, Any] | None) -> WhyNot | None:
    """Return the diagnosis of JSON data."""
    if data is None:
        return None
    direction = data.get("direction")
    return WhyNot(
        tuple(Conflict(**c) for c in data["conflicts"]),
        None if direction is None else np.array(direction, dtype=float),
        tuple(data["reasons"]),
        tuple(data["advice"]),
        data["locally_infeasible"],
    )
