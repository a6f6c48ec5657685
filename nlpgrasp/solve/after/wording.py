"""Numbers and directions in words."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.rows import Row
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.solution.findings import Conflict

SMALL = 0.3  # of the largest component: not worth a word


def conflict_of(name: str, row: Row, value: float) -> Conflict:
    """Return the conflict of a broken row: squares of lengths as lengths, cosines as angles."""
    least = value < row.lower
    bound = row.lower if least else row.upper
    relation = "exactly" if row.lower == row.upper else "at least" if least else "at most"
    if row.unit == "m2":
        value, bound = float(np.sqrt(max(value, 0.0))), float(np.sqrt(max(bound, 0.0)))
    if row.unit == "cos":
        value, bound = (float(np.degrees(np.arccos(np.clip(c, -1.0, 1.0)))) for c in (value, bound))
        relation = {"at least": "at most", "at most": "at least"}.get(relation, relation)
    return Conflict(name, row.name, value, bound, relation, {"m2": "m", "cos": "degrees"}.get(row.unit, row.unit))


def direction_words(wrench: FloatArray, space: int, length: float) -> str:
    """Return a wrench direction in words: its largest components, torques counted over a length (metres)."""
    if space == 2:
        labels = ["a force along x", "a force along y", "a torque"]
    else:
        labels = [*(f"a force along {a}" for a in "xyz"), *(f"a torque about {a}" for a in "xyz")]
    weight = np.abs(wrench) * np.where(np.arange(len(wrench)) < space, 1.0, length)
    parts = [
        label if wrench[i] > 0.0 else label.replace("along ", "along -").replace("about ", "about -")
        for i, label in enumerate(labels)
        if weight[i] >= SMALL * np.max(weight)
    ]
    numbers = np.array2string(wrench / max(float(np.linalg.norm(wrench)), 1e-300), precision=3, suppress_small=True)
    return f"{' with '.join(parts)} (direction {numbers})"
