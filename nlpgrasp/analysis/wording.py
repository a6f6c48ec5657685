"""Text of violated constraints."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.rows import Row
from nlpgrasp.solution.findings import Conflict


def conflict_of(name: str, row: Row, value: float) -> Conflict:
    """Return the conflict of a violated constraint: squared lengths as lengths, cosines as angles."""
    least = value < row.lower
    bound = row.lower if least else row.upper
    relation = "exactly" if row.lower == row.upper else "at least" if least else "at most"
    if row.unit == "m2":
        value, bound = float(np.sqrt(max(value, 0.0))), float(np.sqrt(max(bound, 0.0)))
    if row.unit == "cos":
        value, bound = (float(np.degrees(np.arccos(np.clip(c, -1.0, 1.0)))) for c in (value, bound))
        relation = {"at least": "at most", "at most": "at least"}.get(relation, relation)
    return Conflict(name, row.name, value, bound, relation, {"m2": "m", "cos": "degrees"}.get(row.unit, row.unit))
